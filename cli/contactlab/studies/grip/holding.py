"""A held object under loads: its creep in six directions, and shaking, turning and pulling.

A load is a force on the center of mass of each body that it acts on, like tilted gravity. So the
model's own gravity is off, or cancelled, and all directions are runs of one model.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.schema.grip import GripTrend, GripTrial
from contactlab.studies.grip.closing import Squeeze, measure_squeeze
from contactlab.studies.grip.grip_fixture import GripFixture
from contactlab.studies.grip.rollouts import (
    body_frames,
    data_at,
    find_contacts,
    repeat_input,
    roll_out,
)


@dataclass(frozen=True)
class _LoadProtocol:
    """How a held object is loaded, shaken, turned and pulled, and how its motion is judged.

    Attributes:
        standard_gravity: for a model without gravity [m/s2].
        windows: quarters of a run, for the trend of its speed.
        samples: looks at the object in a run; a multiple of the windows.
        alike_speeds: a trend is steady if speeds of consecutive windows differ by less.
        settled_speeds: a run is long enough if they differ by less.
        least_speed: nothing moves below it [m/s].
        horizon: time that speeds are judged over [s]: a long pick and place.
        most_windows: end of an extrapolation, in windows.
        most_logarithm: largest logarithm of a finite number.
        shake_acceleration, shake_rate, shake_seconds: of the circular shake [m/s2, 1/s, s].
        turn_seconds: time of one turn of gravity [s].
        pull_seconds: time of a pull [s]: short, because friction creeps under any load.
        pull_step: step of pulls, as a share of the friction capacity.
        most_pull: largest pull, as a share of the friction capacity.
        slip_share: an object slips if the contacts carry this share less than the pull.
    """

    standard_gravity: float = 9.81
    windows: int = 4
    samples: int = 40
    alike_speeds: float = 0.1
    settled_speeds: float = 0.02
    least_speed: float = 1e-6
    horizon: float = 10.0
    most_windows: float = 1e6
    most_logarithm: float = 700.0
    shake_acceleration: float = 5.0
    shake_rate: float = 5.0
    shake_seconds: float = 1.0
    turn_seconds: float = 2.0
    pull_seconds: float = 0.04
    pull_step: float = 0.05
    most_pull: float = 1.5
    slip_share: float = 0.02


_LOADING = _LoadProtocol()


@dataclass(frozen=True)
class Drift:
    """Motion of an object under a constant load.

    Attributes:
        name: direction of the load.
        seconds: duration of the run [s].
        speeds: (4,) mean speeds in quarters of the run [m/s], relative to the fingers.
        trend: of these speeds.
        speed: at the end; if it fades, the mean over the next ten seconds; if it is uneven, the
            mean of all quarters except the first [m/s].
        distance_left: distance until the pads no longer cover it [m].
        lost: time of that [s]; infinite if never.
        path: (K, 3) from the middle of the bodies that hold it, in the base frame [m].
    """

    name: str
    seconds: float
    speeds: tuple[float, ...]
    trend: GripTrend
    speed: float
    distance_left: float
    lost: float
    path: Floats


@dataclass(frozen=True)
class Load:
    """A load on some bodies.

    Attributes:
        gravity: magnitude of the acceleration [m/s2].
        masses: (nbody,) masses that it acts on [kg].
        own: (3,) gravity of the model itself, which is cancelled [m/s2].
        idle: name of the case without the load.
    """

    gravity: float
    masses: Floats
    own: Floats
    idle: str

    @classmethod
    def of_all(cls, fixture: GripFixture, gravity: float) -> "Load":
        """Return a load on every body, like gravity."""
        free = fixture.model.body_mass * (1 - fixture.model.body_gravcomp)
        return cls(gravity or _LOADING.standard_gravity, free, np.zeros(3), "without a load")

    @classmethod
    def of_object(cls, fixture: GripFixture) -> "Load":
        """Return a load on the object alone, instead of its weight."""
        masses = np.where(fixture.model.body_weldid == fixture.body, fixture.model.body_mass, 0.0)
        own = fixture.model.opt.gravity.copy()
        return cls(float(np.linalg.norm(own)) or _LOADING.standard_gravity, masses, own, "as it is")

    def load_forces(self, accelerations: Floats) -> Floats:
        """Return (..., nbody, 6) forces of accelerations (..., 3) [N]."""
        forces = np.zeros((*accelerations.shape[:-1], len(self.masses), 6))
        forces[..., :3] = self.masses[:, None] * (accelerations - self.own)[..., None, :]
        return forces


def load_directions(squeeze: Squeeze, names: tuple[str, str]) -> dict[str, Floats]:
    """Return six unit vectors in the world frame, by name; `names` are those out and back."""
    across, side, out = squeeze.turn.T
    return {
        names[0]: out,
        names[1]: -out,
        "to one side": side,
        "to the other side": -side,
        "towards one finger": across,
        "towards the other finger": -across,
    }


def measure_drifts(
    fixture: GripFixture, squeeze: Squeeze, load: Load, ways: dict[str, Floats], seconds: float
) -> tuple[Drift, ...]:
    """Load a held object in each direction, and return its drifts.

    The first has no load, or is the unchanged keyframe. Runs that have not settled, and may be the
    fastest, are continued for the same duration.
    """
    names = [load.idle, *ways]
    forces = load.load_forces(load.gravity * np.array([*ways.values()]))
    forces = np.concatenate([np.zeros((1, fixture.model.nbody, 6)), forces])
    axes = [squeeze.turn[:, 0], *ways.values()]
    travels = [remaining_travel(fixture, squeeze, way) for way in axes]
    rows = repeat_input(squeeze.row, len(forces), 1)[:, 0]
    first = _observe_runs(fixture, squeeze, rows, forces, seconds)
    drifts = [
        _drift_of(fixture, *drift_inputs)
        for drift_inputs in zip(names, first, axes, travels, strict=True)
    ]
    fastest = max((drift.speed for drift in drifts if has_settled(drift)), default=0.0)
    again = [
        run
        for run, drift in enumerate(drifts)
        if not has_settled(drift) and max(drift.speed, drift.speeds[-1]) > fastest
    ]
    if again:
        rows = np.array([first[run].row for run in again])
        more = _observe_runs(fixture, squeeze, rows, forces[again], seconds)
        for run, after in zip(again, more, strict=True):
            longer_run = first[run].and_then(after)
            drifts[run] = _drift_of(fixture, names[run], longer_run, axes[run], travels[run])
    return tuple(drifts)


class _ObservedRun(NamedTuple):
    """A run under a load: last state, positions (K, 3), seconds, and the squeeze at its end."""

    row: Floats
    path: Floats
    seconds: float
    end: Squeeze | None

    def and_then(self, after: "_ObservedRun") -> "_ObservedRun":
        """Return this run continued by another, at every second sample."""
        path = np.concatenate([self.path, after.path[1:]])[::2]
        return _ObservedRun(after.row, path, self.seconds + after.seconds, after.end)


def _observe_runs(
    fixture: GripFixture, squeeze: Squeeze, rows: Floats, forces: Floats, seconds: float
) -> list[_ObservedRun]:
    """Continue from states (n, nstate) for some seconds, under forces (n, nbody, 6)."""
    steps, count = max(_LOADING.samples, round(seconds / fixture.model.opt.timestep)), len(forces)
    controls = repeat_input(squeeze.control, count, steps)
    rolled = roll_out(fixture.model, rows, controls, np.repeat(forces[:, None], steps, axis=1))
    looks = np.linspace(0, steps - 1, _LOADING.samples + 1).astype(int)
    observed, holders = list[_ObservedRun](), _find_holders(fixture, squeeze)
    for run in range(count):
        path = _measure_path(fixture, holders, rolled.qpos[run, looks])
        row, end = rolled.rows[run], None
        if not rolled.failed[run] and np.isfinite(path).all():
            end = measure_squeeze(
                fixture, row, squeeze.control, squeeze.turn, rolled.qpos[run, looks]
            )
        if end is not None and not sum(end.forces):
            end = None
        observed.append(_ObservedRun(row, path, steps * fixture.model.opt.timestep, end))
    return observed


def _find_holders(fixture: GripFixture, squeeze: Squeeze) -> list[int]:
    # The bodies that press on the object, except the world.
    model = fixture.model
    contacts = find_contacts(model, data_at(model, squeeze.row), fixture.body)
    bodies = {int(model.geom_bodyid[one.geom]) for one in contacts if one.force > 0}
    return sorted(body for body in bodies if model.body_weldid[body])


def _measure_path(fixture: GripFixture, holders: list[int], configurations: Floats) -> Floats:
    # The object (K, 3) relative to the middle of the bodies that hold it, in the base frame [m].
    # Jaws that are driven by forces give way to a load from the side, and the object with them: it
    # does not move in the hand.
    path = body_frames(fixture.model, configurations, fixture.body, fixture.base)
    if not holders:
        return path
    ways = [body_frames(fixture.model, configurations, each, fixture.base) for each in holders]
    return path - np.mean(ways, axis=0)


def has_settled(drift: Drift) -> bool:
    """Return whether the speed is constant after the first quarter, or zero."""
    _, *later = drift.speeds
    return drift.trend in ("still", "lost") or max(later) <= (1 + _LOADING.settled_speeds) * min(
        later
    )


def _drift_of(
    fixture: GripFixture, name: str, observed: _ObservedRun, axis: Floats, travel: float
) -> Drift:
    """Return the drift of a run; it is lost if it left the fingers."""
    path, duration, window = observed.path, observed.seconds, observed.seconds / _LOADING.windows
    ends = path[:: _LOADING.samples // _LOADING.windows]
    speeds = np.linalg.norm(np.diff(ends, axis=0), axis=1) / window
    window_speeds = tuple(float(speed) for speed in np.nan_to_num(speeds, nan=np.inf))
    distances: Floats = np.linalg.norm(path - path[0], axis=1)
    if observed.end is None or (distances.max() > travel and not observed.end.is_held):
        out = np.flatnonzero(~(distances <= travel))
        when = duration * (out[0] / _LOADING.samples if out.size else 1.0)
        return Drift(name, duration, window_speeds, "lost", math.inf, travel, float(when), path)
    # Links of fingers may follow the object, so the cover at the end counts.
    travel = remaining_travel(fixture, observed.end, axis)
    pace = fit_pace(speeds)
    windows = _LOADING.horizon / window
    speed = pace.travel_in(windows) / windows if pace.trend == "fading" else pace.speed
    when = duration + window * pace.windows_until(travel / window)
    return Drift(name, duration, window_speeds, pace.trend, speed, travel, when, path)


class Pace(NamedTuple):
    """Extrapolation of window speeds; each change is a constant ratio of the last one.

    Attributes:
        trend: of the speeds.
        speed: of the last window, or the mean if they are uneven [m/s].
        change: of the last window against the one before [m/s].
        ratio: of each change to the one before.
    """

    trend: GripTrend
    speed: float
    change: float = 0.0
    ratio: float = 0.0

    def travel_in(self, windows: float) -> float:
        """Return the travel in coming windows, over the length of a window [m/s]."""
        ratio, changed = self.ratio, windows * (windows + 1) / 2
        if ratio > 1 and windows * math.log(ratio) > _LOADING.most_logarithm:
            return math.copysign(math.inf, self.change)
        if ratio != 1:
            power = ratio * (1 - ratio**windows) / (1 - ratio)
            changed = ratio / (1 - ratio) * (windows - power)
        return windows * self.speed + self.change * changed

    def windows_until(self, way: float) -> float:
        """Return the number of windows that it takes to cover a distance; infinite if never.

        By bisection, since the travel grows with time.
        """
        low, high = 0.0, _LOADING.most_windows
        if self.travel_in(high) <= way:
            return math.inf
        while high - low > COARSE_ROUNDING * (1 + low):
            middle = (low + high) / 2
            low, high = (low, middle) if self.travel_in(middle) > way else (middle, high)
        return high


def fit_pace(speeds: Floats) -> Pace:
    """Extrapolate the speeds of four windows [m/s].

    The first is ignored, since contacts take up the load in it. The other changes form a geometric
    series (Aitken), which fades to a speed of at least zero, and grows no faster than the speeds.
    """
    _, *later = speeds.tolist()
    one, two, last = (max(speed, _LOADING.least_speed) for speed in later)
    before, change = two - one, last - two
    if later[-1] < _LOADING.least_speed:
        return Pace("still", 0.0)
    if max(one, two, last) * (1 - _LOADING.alike_speeds) ** 2 < min(one, two, last):
        return Pace("steady", last)
    if before * change <= 0:
        return Pace("uneven", (one + two + last) / 3)
    trend = "fading" if change < 0 else "growing"
    return Pace(trend, last, change, min(change / before, last / two))


def remaining_travel(fixture: GripFixture, squeeze: Squeeze, way: Floats) -> float:
    """Return the distance that an object can go until the middle of its contacts leaves it [m].

    From finger to finger it is the object's whole extent.
    """
    data = data_at(fixture.model, squeeze.row)
    turn = data.xmat[fixture.body].reshape(3, 3)
    middle = data.xpos[fixture.body] + turn @ fixture.middle
    reach = float(np.abs(turn.T @ way) @ fixture.half)
    if abs(way @ squeeze.turn[:, 0]) > math.sqrt(0.5):
        return 2 * reach
    touched = squeeze.points.mean(axis=0) if len(squeeze.points) else middle
    return max(reach + float((touched - middle) @ way), 0.0)


def shake_object(fixture: GripFixture, squeeze: Squeeze, load: Load, down: Floats) -> GripTrial:
    """Shake a held object in a circle across the fingers, 5 m/s2 at 5 Hz, for a second."""
    return _run_trial(fixture, squeeze, shake_forces(fixture, squeeze, load, load.gravity * down))


def shake_forces(fixture: GripFixture, squeeze: Squeeze, load: Load, gravity: Floats) -> Floats:
    """Return (N, nbody, 6) forces of a shake under gravity (3,) [N]."""
    times = np.arange(0, _LOADING.shake_seconds, fixture.model.opt.timestep)[:, None]
    _, side, out = squeeze.turn.T
    angles = 2 * np.pi * _LOADING.shake_rate * times
    return load.load_forces(
        gravity + _LOADING.shake_acceleration * (np.cos(angles) * side + np.sin(angles) * out)
    )


def turn_object(fixture: GripFixture, squeeze: Squeeze, load: Load, down: Floats) -> GripTrial:
    """Turn gravity once about the axis from finger to finger, in two seconds."""
    times = np.arange(0, _LOADING.turn_seconds, fixture.model.opt.timestep)[:, None]
    angles, axis = 2 * np.pi * times / _LOADING.turn_seconds, squeeze.turn[:, 0]
    turning = np.cos(angles) * down + np.sin(angles) * np.cross(axis, down)
    return _run_trial(fixture, squeeze, load.load_forces(load.gravity * turning))


def _run_trial(fixture: GripFixture, squeeze: Squeeze, forces: Floats) -> GripTrial:
    steps = len(forces)
    rolled = roll_out(
        fixture.model, squeeze.row[None], repeat_input(squeeze.control, 1, steps), forces[None]
    )
    looks = np.linspace(0, steps - 1, _LOADING.samples + 1).astype(int)
    path = _measure_path(fixture, _find_holders(fixture, squeeze), rolled.qpos[0, looks])
    way = float(np.linalg.norm(path - path[0], axis=1).max())
    reach = float(fixture.half.max())
    lost = bool(rolled.failed[0]) or not way < 2 * reach
    if not lost:
        data = data_at(fixture.model, rolled.rows[0])
        contacts = find_contacts(fixture.model, data, fixture.body)
        lost = not any(contact.force > 0 for contact in contacts)
    return GripTrial(distance=way, lost=lost)


def pull_object(
    fixture: GripFixture, squeeze: Squeeze, load: Load, ways: dict[str, Floats]
) -> tuple[str, float]:
    """Pull a weightless held object with growing force until it slips.

    Returns the direction of the smallest holding force, and the largest contact force until it
    slips [N]. Pulls are short: regularized friction creeps under any load, and fast sliding presses
    the pads apart.
    """
    limit = _friction_capacity(fixture, squeeze)
    shares = np.arange(0, _LOADING.most_pull, _LOADING.pull_step)
    steps = max(8, round(_LOADING.pull_seconds / fixture.model.opt.timestep))
    forces = np.repeat(load.load_forces(np.zeros(3))[None], len(shares), axis=0)
    rows = repeat_input(squeeze.row, len(shares), 1)[:, 0]
    controls = repeat_input(squeeze.control, len(shares), steps)
    dof = int(fixture.model.body_dofadr[fixture.body])
    force_by_way = dict[str, float]()
    for name, way in ways.items():
        pulls = forces.copy()
        pulls[:, fixture.body, :3] += limit * shares[:, None] * way
        applied = np.repeat(pulls[:, None], steps, axis=1)
        rolled = roll_out(fixture.model, rows, controls, applied, borne=True)
        assert rolled.borne is not None
        borne = (-rolled.borne[:, steps // 2 :, dof : dof + 3] @ way).mean(axis=1)
        # Contacts that stick carry the same share of each pull. The rest accelerates the object
        # together with a hand that gives way. Such a hand also moves without a pull.
        steps_up = np.arange(len(shares))
        sticking_forces = borne[0] + (borne[1] - borne[0]) * steps_up
        slips = borne < sticking_forces - _LOADING.slip_share * limit * shares
        # An object that is flung out has no contact left in the pull that it slips in.
        until = int(slips.argmax()) + 1 if slips.any() else len(borne)
        force_by_way[name] = max(0.0, float(borne[:until].max()))
    least = min(force_by_way, key=lambda name: force_by_way[name])
    return least, force_by_way[least]


def _friction_capacity(fixture: GripFixture, squeeze: Squeeze) -> float:
    """Return the friction force that Coulomb's law allows if all contacts are loaded alike [N]."""
    contacts = find_contacts(fixture.model, data_at(fixture.model, squeeze.row), fixture.body)
    return sum(each.friction * each.force for each in contacts)


def pull_forces(fixture: GripFixture, squeeze: Squeeze, load: Load, way: Floats) -> Floats:
    """Return (N, nbody, 6) forces of a pull that exceeds the holding force within a second [N]."""
    steps = max(_LOADING.samples, round(1 / fixture.model.opt.timestep))
    most = _LOADING.most_pull * _friction_capacity(fixture, squeeze)
    forces = repeat_input(load.load_forces(np.zeros(3)), 1, steps)[0]
    forces[:, fixture.body, :3] += most * np.arange(1, steps + 1)[:, None] / steps * way
    return forces


def gravity_magnitude(model: mujoco.MjModel) -> float:
    """Return the magnitude of the model's gravity, or standard gravity if it is zero [m/s2]."""
    return float(np.linalg.norm(model.opt.gravity)) or _LOADING.standard_gravity


def object_weight(fixture: GripFixture, load: Load) -> float:
    """Return the weight of the object [N]."""
    return float(fixture.model.body_subtreemass[fixture.body]) * load.gravity
