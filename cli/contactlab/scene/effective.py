"""The contact parameters that a pair really has, after MuJoCo mixes those of its geoms.

Rules from MuJoCo's documentation, Modeling > Contact parameters: an explicit <pair> decides; else
the geom of higher priority; else friction and condim by maximum, solref and solimp by weights
(element-wise minimum where a solref is in direct form), margin and gap always by sum. No friction
is below the engine's least, and the override switch replaces what its option has.
"""

import mujoco
import numpy as np

from contactlab.scene.pairs import Pair
from contactlab.schema import PairRecord

_MIN_WEIGHT = 1e-15


def effective(model: mujoco.MjModel, pair: Pair) -> PairRecord:
    """Return the effective contact parameters of a pair's first two geoms.

    For a pair of bodies these stand for all of their geoms; friction is the largest among them,
    so that it bounds the cone of each contact.
    """
    first, second = pair.geoms[0][0], pair.geoms[1][0]
    explicit = explicit_pair(model, first, second)
    record = _explicit(model, explicit) if explicit is not None else _mixed(model, first, second)
    frictions = [record.friction]
    if pair.bodies:
        frictions += [_friction(model, a, b) for a in pair.geoms[0] for b in pair.geoms[1]]
    changes: dict[str, object] = {"friction": _bounded(np.max(frictions, axis=0))}
    if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE:
        changes = {
            "friction": _bounded(model.opt.o_friction),
            "solref": _floats(model.opt.o_solref),
            "solimp": _floats(model.opt.o_solimp),
            "margin": float(model.opt.o_margin),
        }
    return record.model_copy(update=changes)


def explicit_pair(model: mujoco.MjModel, first: int, second: int) -> int | None:
    """Return the index of the <pair> element that names both geoms, or None."""
    for index in range(model.npair):
        if {int(model.pair_geom1[index]), int(model.pair_geom2[index])} == {first, second}:
            return index
    return None


def _explicit(model: mujoco.MjModel, index: int) -> PairRecord:
    return PairRecord(
        condim=int(model.pair_dim[index]),
        friction=_floats(model.pair_friction[index]),
        solref=_floats(model.pair_solref[index]),
        solimp=_floats(model.pair_solimp[index]),
        margin=float(model.pair_margin[index]),
        gap=float(model.pair_gap[index]),
    )


def _mixed(model: mujoco.MjModel, first: int, second: int) -> PairRecord:
    weight = _weight(model, first, second)
    solref = _solref(model, first, second, weight)
    solimp = weight * model.geom_solimp[first] + (1 - weight) * model.geom_solimp[second]
    return PairRecord(
        condim=_condim(model, first, second),
        friction=_friction(model, first, second),
        solref=_floats(solref),
        solimp=_floats(solimp),
        margin=float(model.geom_margin[first] + model.geom_margin[second]),
        gap=float(model.geom_gap[first] + model.geom_gap[second]),
    )


def _ruler(model: mujoco.MjModel, first: int, second: int) -> int | None:
    """Return the geom of higher priority, or None for a tie."""
    priority1, priority2 = int(model.geom_priority[first]), int(model.geom_priority[second])
    if priority1 == priority2:
        return None
    return first if priority1 > priority2 else second


def _condim(model: mujoco.MjModel, first: int, second: int) -> int:
    ruler = _ruler(model, first, second)
    if ruler is not None:
        return int(model.geom_condim[ruler])
    return int(max(model.geom_condim[first], model.geom_condim[second]))


def _friction(model: mujoco.MjModel, first: int, second: int) -> tuple[float, ...]:
    ruler = _ruler(model, first, second)
    if ruler is not None:
        three = model.geom_friction[ruler]
    else:
        three = np.maximum(model.geom_friction[first], model.geom_friction[second])
    slide, torsion, roll = (float(value) for value in three)
    return slide, slide, torsion, roll, roll


def _weight(model: mujoco.MjModel, first: int, second: int) -> float:
    """Return the first geom's weight in the mean."""
    ruler = _ruler(model, first, second)
    if ruler is not None:
        return 1.0 if ruler == first else 0.0
    mix1, mix2 = float(model.geom_solmix[first]), float(model.geom_solmix[second])
    if mix1 >= _MIN_WEIGHT and mix2 >= _MIN_WEIGHT:
        return mix1 / (mix1 + mix2)
    if mix1 < _MIN_WEIGHT and mix2 < _MIN_WEIGHT:
        return 0.5
    return 0.0 if mix1 < _MIN_WEIGHT else 1.0


def _solref(model: mujoco.MjModel, first: int, second: int, weight: float) -> np.ndarray:
    one, two = model.geom_solref[first], model.geom_solref[second]
    standard = one[0] > 0 and two[0] > 0
    if standard or _ruler(model, first, second) is not None:
        return weight * one + (1 - weight) * two
    return np.minimum(one, two)


def _bounded(friction: np.ndarray) -> tuple[float, ...]:
    return _floats(np.maximum(friction, mujoco.mjMINMU))


def _floats(values: np.ndarray | tuple[float, ...]) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
