"""A held object under loads: how it creeps in six directions, and what shaking and pulling do.

A load is a force on the centre of mass of each body that it acts on, which is what tilted gravity
is. So the model's own gravity is off, or taken back, and all directions are runs of one model.
"""

import math
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.studies.grip.bench import Rig
from contactlab.studies.grip.closing import Squeeze
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
# A trend is steady while speeds of windows that follow each other differ by less than this share.
_ALIKE = 0.1
_STILL = 1e-6  # m/s: below it, nothing moves
_HORIZON = 10.0  # s, over which speeds are judged
_FOREVER = 1e6  # s
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
        speeds: (4,) mean speeds in quarters of the run [m/s], relative to the base.
        trend: of these.
        speed: at the end; where it fades, the mean over the ten seconds to come; where it is
            uneven, the mean of all quarters but the first [m/s].
        left: way that it can go before the pads no longer cover it [m].
        lost: when that is [s]; infinite if never.
        path: (K, 3) in the base's frame [m].
    """

    name: str
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
    """Load a held object in each direction for some seconds, and say how it moves.

    The first is without a load on a bench, and as it is in a keyframe.
    """
    steps = max(_LOOKS, round(seconds / rig.model.opt.timestep))
    vectors = np.array([*ways.values()])
    idle = np.zeros((1, rig.model.nbody, 6))
    forces = np.concatenate([idle, load.forces(load.gravity * vectors)])
    count = len(forces)
    rows = constant(held.row, count, 1)[:, 0]
    controls = constant(held.control, count, steps)
    rolled = roll(rig.model, rows, controls, np.repeat(forces[:, None], steps, axis=1))
    looks = np.linspace(0, steps - 1, _LOOKS + 1).astype(int)
    found = list[Drift]()
    duration = steps * rig.model.opt.timestep
    first = {load.idle: held.turn[:, 0]}
    for run, (name, way) in enumerate({**first, **ways}.items()):
        path = body_frames(rig.model, rolled.qpos[run, looks], rig.body, rig.base)
        gone = rolled.failed[run] or not np.isfinite(path).all()
        let = gone or not _is_touched(rig, rolled.rows[run])
        found.append(_drift(name, path, duration, way_left(rig, held, way), lost=let))
    return tuple(found)


def _is_touched(rig: Rig, row: Floats) -> bool:
    data = placed(rig.model, row)
    return any(contact.force > 0 for contact in contacts_of(rig.model, data, rig.body))


def _drift(name: str, path: Floats, duration: float, left: float, *, lost: bool) -> Drift:
    window = duration / _WINDOWS
    ends = path[:: _LOOKS // _WINDOWS]
    speeds = np.linalg.norm(np.diff(ends, axis=0), axis=1) / window
    told = _listed(speeds)
    gone: Floats = np.linalg.norm(path - path[0], axis=1)
    if lost or not np.isfinite(gone).all() or gone.max() > left:
        out = np.flatnonzero(~(gone <= left))
        when = duration * (out[0] / _LOOKS if out.size else 1.0)
        return Drift(name, told, "lost", math.inf, left, float(when), path)
    trend, ratio = trend_of(speeds)
    if trend == "uneven":
        speeds = np.append(speeds[:-1], speeds[1:].mean())
    fading = _to_come(speeds[-1], ratio, window, _HORIZON) / _HORIZON
    speed = float(speeds[-1]) if trend == "growing" else fading
    rest = left - float(gone[-1])
    never = _to_come(speeds[-1], ratio, window, _FOREVER) <= rest
    when = math.inf if never else duration + _when(speeds[-1], ratio, window, rest)
    return Drift(name, told, trend, speed, left, when, path)


def _listed(speeds: Floats) -> tuple[float, ...]:
    return tuple(float(speed) for speed in np.nan_to_num(speeds, nan=np.inf))


def trend_of(speeds: Floats) -> tuple[Trend, float]:
    """Return the trend of speeds of windows, and by how much each is that of the one before.

    The first window is left out: in it the contacts take the load up. A trend is one if all that
    follow agree; where they do not, speeds are uneven.
    """
    later = np.maximum(speeds[1:], _STILL)
    if speeds[-1] < _STILL:
        return "still", 0.0
    ratios = later[1:] / later[:-1]
    if ratios.max() < 1 - _ALIKE:
        return "fading", float(ratios.max())
    if ratios.min() > 1 / (1 - _ALIKE):
        return "growing", float(ratios[-1])
    if abs(math.log(later.max() / later.min())) < -2 * math.log(1 - _ALIKE):
        return "steady", 1.0
    return "uneven", 1.0


def _to_come(speed: float, ratio: float, window: float, seconds: float) -> float:
    """Return the way in seconds to come [m], speeds of windows being a geometric series."""
    if speed < _STILL:
        return 0.0
    count = seconds / window
    if ratio == 1:
        return speed * seconds
    if ratio > 1 and count * math.log(ratio) > 700:
        return math.inf
    return speed * window * ratio * (1 - ratio**count) / (1 - ratio)


def _when(speed: float, ratio: float, window: float, way: float) -> float:
    """Return after how many seconds a way has been gone [s]."""
    if ratio == 1:
        return way / speed
    share = 1 - way * (1 - ratio) / (speed * window * ratio)
    return window * math.log(share) / math.log(ratio)


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
