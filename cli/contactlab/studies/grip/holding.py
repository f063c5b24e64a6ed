"""A held object under loads: how it creeps in six directions, and what shaking and pulling do.

A load is a force on the centre of mass of each body that it acts on, which is what tilted gravity
is. So the model's own gravity is off, or taken back, and all directions are runs of one model.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.studies.grip.bench import Rig
from contactlab.studies.grip.closing import Squeeze, pressing
from contactlab.studies.grip.rollouts import (
    body_frames,
    constant,
    contacts_of,
    placed,
    roll,
)

Trend = Literal["still", "steady", "fading", "growing", "uneven", "lost"]
_STANDARD = 9.81  # m/s2, where a model has no gravity
_WINDOWS = 4
_LOOKS = 40  # of a run
# A trend is steady while speeds of windows that follow each other differ by less than this share;
# a run is long enough if they differ by less than that one.
_ALIKE, _SETTLED = 0.1, 0.02
_STILL = 1e-6  # m/s: below it, nothing moves
_HORIZON = 10.0  # s, over which speeds are judged
_FOREVER = 1e6  # windows
_ENDLESS = 700.0  # logarithm of a number that is as good as infinite
_SHAKEN, _RATE, _SHAKING = 5.0, 5.0, 1.0  # m/s2, 1/s, s
_TURNING = 2.0  # s
# A pull is so long [s]; pulls are steps of this share of what Coulomb's law lets fingers bear, up
# to so much of it; an object slips if contacts bear this share less.
_PULLING, _FINEST, _MARGIN, _SLIPS = 0.04, 0.05, 1.5, 0.02


@dataclass(frozen=True)
class Drift:
    """An object's way under a load that stays.

    Attributes:
        name: of the direction in which the load pulls.
        seconds: of the run [s].
        speeds: (4,) mean speeds in quarters of the run [m/s], relative to the base.
        trend: of these.
        speed: at the end; where it fades, the mean over the ten seconds to come; where it is
            uneven, the mean of all quarters but the first [m/s].
        left: way that it can still go before the pads no longer cover it [m].
        lost: when that is [s]; infinite if never.
        path: (K, 3) in the base's frame [m].
    """

    name: str
    seconds: float
    speeds: tuple[float, ...]
    trend: Trend
    speed: float
    left: float
    lost: float
    path: Floats


@dataclass(frozen=True)
class Load:
    """What bodies weigh, and which of them a load acts on.

    Attributes:
        gravity: magnitude of what acts [m/s2].
        masses: (nbody,) masses that it acts on [kg].
        own: (3,) gravity of the model itself, which is taken back [m/s2].
        idle: name of what there is without it.
    """

    gravity: float
    masses: Floats
    own: Floats
    idle: str

    @classmethod
    def of_all(cls, rig: Rig, gravity: float) -> "Load":
        """Return a load on every body, as gravity is."""
        free = rig.model.body_mass * (1 - rig.model.body_gravcomp)
        return cls(gravity or _STANDARD, free, np.zeros(3), "without a load")

    @classmethod
    def of_object(cls, rig: Rig) -> "Load":
        """Return a load on the object alone, in place of its weight."""
        masses = np.where(rig.model.body_weldid == rig.body, rig.model.body_mass, 0.0)
        own = rig.model.opt.gravity.copy()
        return cls(float(np.linalg.norm(own)) or _STANDARD, masses, own, "as it is")

    def forces(self, accelerations: Floats) -> Floats:
        """Return (..., nbody, 6) forces of accelerations (..., 3) [N]."""
        found = np.zeros((*accelerations.shape[:-1], len(self.masses), 6))
        found[..., :3] = self.masses[:, None] * (accelerations - self.own)[..., None, :]
        return found


def directions(squeeze: Squeeze, names: tuple[str, str]) -> dict[str, Floats]:
    """Return six unit vectors in the world's frame, by name; `names` are those out and back."""
    across, side, out = squeeze.turn.T
    return {
        names[0]: out,
        names[1]: -out,
        "to one side": side,
        "to the other side": -side,
        "towards one finger": across,
        "towards the other finger": -across,
    }


def drifts(
    rig: Rig, held: Squeeze, load: Load, ways: dict[str, Floats], seconds: float
) -> tuple[Drift, ...]:
    """Load a held object in each direction, and say how it moves.

    The first is without a load on a bench, and as it is in a keyframe. What has not settled after
    some seconds, and may be the fastest, is watched for as long again.
    """
    names = [load.idle, *ways]
    forces = load.forces(load.gravity * np.array([*ways.values()]))
    forces = np.concatenate([np.zeros((1, rig.model.nbody, 6)), forces])
    axes = [held.turn[:, 0], *ways.values()]
    left = [way_left(rig, held, way) for way in axes]
    rows = constant(held.row, len(forces), 1)[:, 0]
    first = _watched(rig, held, rows, forces, seconds)
    found = [_drift(rig, *told) for told in zip(names, first, axes, left, strict=True)]
    fastest = max((drift.speed for drift in found if is_settled(drift)), default=0.0)
    again = [
        run
        for run, drift in enumerate(found)
        if not is_settled(drift) and max(drift.speed, drift.speeds[-1]) > fastest
    ]
    if again:
        rows = np.array([first[run].row for run in again])
        more = _watched(rig, held, rows, forces[again], seconds)
        for run, after in zip(again, more, strict=True):
            seen = first[run].and_then(after)
            found[run] = _drift(rig, names[run], seen, axes[run], left[run])
    return tuple(found)


class _Watched(NamedTuple):
    """A run under a load: its last state, places (K, 3), seconds, and what presses at its end."""

    row: Floats
    path: Floats
    seconds: float
    end: Squeeze | None

    def and_then(self, after: "_Watched") -> "_Watched":
        """Return this run with another that goes on, seen at every other place."""
        path = np.concatenate([self.path, after.path[1:]])[::2]
        return _Watched(after.row, path, self.seconds + after.seconds, after.end)


def _watched(
    rig: Rig, held: Squeeze, rows: Floats, forces: Floats, seconds: float
) -> list[_Watched]:
    """Go on from states (n, nstate) for some seconds, under forces (n, nbody, 6)."""
    steps, count = max(_LOOKS, round(seconds / rig.model.opt.timestep)), len(forces)
    controls = constant(held.control, count, steps)
    rolled = roll(rig.model, rows, controls, np.repeat(forces[:, None], steps, axis=1))
    looks = np.linspace(0, steps - 1, _LOOKS + 1).astype(int)
    found = list[_Watched]()
    for run in range(count):
        path = body_frames(rig.model, rolled.qpos[run, looks], rig.body, rig.base)
        row, end = rolled.rows[run], None
        if not rolled.failed[run] and np.isfinite(path).all():
            end = pressing(rig, row, held.control, held.turn, rolled.qpos[run, looks])
        if end is not None and not sum(end.forces):
            end = None
        found.append(_Watched(row, path, steps * rig.model.opt.timestep, end))
    return found


def is_settled(drift: Drift) -> bool:
    """Return whether a speed is one: the same in all quarters of the run but the first, or none."""
    _, *later = drift.speeds
    return drift.trend in ("still", "lost") or max(later) <= (1 + _SETTLED) * min(later)


def _is_touched(rig: Rig, row: Floats) -> bool:
    data = placed(rig.model, row)
    return any(contact.force > 0 for contact in contacts_of(rig.model, data, rig.body))


def _drift(rig: Rig, name: str, seen: _Watched, axis: Floats, left: float) -> Drift:
    """Return what a run comes to; it is lost if let, or gone too far and not between two sides."""
    path, duration, window = seen.path, seen.seconds, seen.seconds / _WINDOWS
    ends = path[:: _LOOKS // _WINDOWS]
    speeds = np.linalg.norm(np.diff(ends, axis=0), axis=1) / window
    told = tuple(float(speed) for speed in np.nan_to_num(speeds, nan=np.inf))
    gone: Floats = np.linalg.norm(path - path[0], axis=1)
    if seen.end is None or (gone.max() > left and not seen.end.is_held):
        out = np.flatnonzero(~(gone <= left))
        when = duration * (out[0] / _LOOKS if out.size else 1.0)
        return Drift(name, duration, told, "lost", math.inf, left, float(when), path)
    # Links of fingers may follow the object: what covers it at the end counts.
    left = way_left(rig, seen.end, axis)
    pace = pace_of(speeds)
    windows = _HORIZON / window
    speed = pace.way(windows) / windows if pace.trend == "fading" else pace.speed
    when = duration + window * pace.until(left / window)
    return Drift(name, duration, told, pace.trend, speed, left, when, path)


class Pace(NamedTuple):
    """How speeds of windows that follow each other go on: each change is a ratio of the last.

    Attributes:
        trend: of them.
        speed: of the last window, or the mean where they are uneven [m/s].
        change: of the last window against the one before [m/s].
        ratio: of each change over the one before.
    """

    trend: Trend
    speed: float
    change: float = 0.0
    ratio: float = 0.0

    def way(self, windows: float) -> float:
        """Return the way in so many windows to come, over the length of one [m/s]."""
        ratio, changed = self.ratio, windows * (windows + 1) / 2
        if ratio > 1 and windows * math.log(ratio) > _ENDLESS:
            return math.copysign(math.inf, self.change)
        if ratio != 1:
            power = ratio * (1 - ratio**windows) / (1 - ratio)
            changed = ratio / (1 - ratio) * (windows - power)
        return windows * self.speed + self.change * changed

    def until(self, way: float) -> float:
        """Return after how many windows a way, over the length of one, is gone; infinite if never.

        By halving: ways grow with time.
        """
        low, high = 0.0, _FOREVER
        if self.way(high) <= way:
            return math.inf
        while high - low > 1e-6 * (1 + low):
            middle = (low + high) / 2
            low, high = (low, middle) if self.way(middle) > way else (middle, high)
        return high


def pace_of(speeds: Floats) -> Pace:
    """Return how speeds of four windows [m/s] go on.

    The first is left out: in it the contacts take the load up. Changes of the other three are a
    geometric series (Aitken), which fades to a speed that may stay, but to none below zero, and
    grows no faster than the speeds do.
    """
    _, *later = speeds.tolist()
    one, two, last = (max(speed, _STILL) for speed in later)
    before, change = two - one, last - two
    if later[-1] < _STILL:
        return Pace("still", 0.0)
    if max(one, two, last) * (1 - _ALIKE) ** 2 < min(one, two, last):
        return Pace("steady", last)
    if before * change <= 0:
        return Pace("uneven", (one + two + last) / 3)
    trend = "fading" if change < 0 else "growing"
    return Pace(trend, last, change, min(change / before, last / two))


def way_left(rig: Rig, held: Squeeze, way: Floats) -> float:
    """Return how far an object can go until the middle of its contacts leaves it [m].

    Along the fingers' way it is the object's whole extent.
    """
    data = placed(rig.model, held.row)
    turn = data.xmat[rig.body].reshape(3, 3)
    middle = data.xpos[rig.body] + turn @ rig.middle
    reach = float(np.abs(turn.T @ way) @ rig.half)
    if abs(way @ held.turn[:, 0]) > math.sqrt(0.5):
        return 2 * reach
    touched = held.points.mean(axis=0) if len(held.points) else middle
    return max(reach + float((touched - middle) @ way), 0.0)


@dataclass(frozen=True)
class Trial:
    """What an object goes through beside a load that stays.

    Attributes:
        way: farthest that it was from its place [m].
        lost: whether the hand lost it.
    """

    way: float
    lost: bool


def shaken(rig: Rig, held: Squeeze, load: Load, down: Floats) -> Trial:
    """Shake a held object in a circle across the fingers' way, 5 m/s2 at 5 Hz, for a second."""
    return _trial(rig, held, inputs_of_shake(rig, held, load, load.gravity * down))


def inputs_of_shake(rig: Rig, held: Squeeze, load: Load, gravity: Floats) -> Floats:
    """Return (N, nbody, 6) forces of a shake under gravity (3,) [N]."""
    times = np.arange(0, _SHAKING, rig.model.opt.timestep)[:, None]
    _, side, out = held.turn.T
    angles = 2 * np.pi * _RATE * times
    return load.forces(gravity + _SHAKEN * (np.cos(angles) * side + np.sin(angles) * out))


def turned(rig: Rig, held: Squeeze, load: Load, down: Floats) -> Trial:
    """Turn gravity once about the fingers' way, in two seconds."""
    times = np.arange(0, _TURNING, rig.model.opt.timestep)[:, None]
    angles, axis = 2 * np.pi * times / _TURNING, held.turn[:, 0]
    turning = np.cos(angles) * down + np.sin(angles) * np.cross(axis, down)
    return _trial(rig, held, load.forces(load.gravity * turning))


def _trial(rig: Rig, held: Squeeze, forces: Floats) -> Trial:
    steps = len(forces)
    rolled = roll(rig.model, held.row[None], constant(held.control, 1, steps), forces[None])
    looks = np.linspace(0, steps - 1, _LOOKS + 1).astype(int)
    path = body_frames(rig.model, rolled.qpos[0, looks], rig.body, rig.base)
    way = float(np.linalg.norm(path - path[0], axis=1).max())
    reach = float(rig.half.max())
    lost = bool(rolled.failed[0]) or not way < 2 * reach or not _is_touched(rig, rolled.rows[0])
    return Trial(way if np.isfinite(way) else math.inf, lost)


def pulled(rig: Rig, held: Squeeze, load: Load, ways: dict[str, Floats]) -> tuple[str, float]:
    """Pull a held object without weight, each time a twentieth harder, until it slips.

    Returns the direction in which the fingers hold least, and what contacts bore there as it first
    slipped [N]. Pulls are short: regularised friction gives way under any, and what slides fast
    presses the pads apart.
    """
    limit = _coulomb(rig, held)
    shares = np.arange(_FINEST, _MARGIN, _FINEST)
    steps = max(8, round(_PULLING / rig.model.opt.timestep))
    forces = np.repeat(load.forces(np.zeros(3))[None], len(shares), axis=0)
    rows = constant(held.row, len(shares), 1)[:, 0]
    controls = constant(held.control, len(shares), steps)
    dof = int(rig.model.body_dofadr[rig.body])
    found = dict[str, float]()
    for name, way in ways.items():
        pulls = forces.copy()
        pulls[:, rig.body, :3] += limit * shares[:, None] * way
        applied = np.repeat(pulls[:, None], steps, axis=1)
        rolled = roll(rig.model, rows, controls, applied, borne=True)
        assert rolled.borne is not None
        borne = (-rolled.borne[:, steps // 2 :, dof : dof + 3] @ way).mean(axis=1)
        slips = borne < (1 - _SLIPS) * limit * shares
        found[name] = max(0.0, float(borne[int(slips.argmax()) if slips.any() else -1]))
    least = min(found, key=lambda name: found[name])
    return least, found[least]


def _coulomb(rig: Rig, held: Squeeze) -> float:
    """Return what Coulomb's law lets the contacts bear, were all of them pulled alike [N]."""
    found = contacts_of(rig.model, placed(rig.model, held.row), rig.body)
    return sum(each.friction * each.force for each in found)


def inputs_of_pull(rig: Rig, held: Squeeze, load: Load, way: Floats) -> Floats:
    """Return (N, nbody, 6) forces of a pull that grows past what fingers bear in a second [N]."""
    steps = max(_LOOKS, round(1 / rig.model.opt.timestep))
    most = _MARGIN * _coulomb(rig, held)
    forces = constant(load.forces(np.zeros(3)), 1, steps)[0]
    forces[:, rig.body, :3] += most * np.arange(1, steps + 1)[:, None] / steps * way
    return forces


def gravity_of(model: mujoco.MjModel) -> float:
    """Return the magnitude of a model's gravity, or the standard where it has none [m/s2]."""
    return float(np.linalg.norm(model.opt.gravity)) or _STANDARD


def weight(rig: Rig, load: Load) -> float:
    """Return what the object weighs [N]."""
    return float(rig.model.body_subtreemass[rig.body]) * load.gravity
