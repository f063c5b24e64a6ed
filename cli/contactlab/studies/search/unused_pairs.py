"""What a model computes that changes no state: collisions that cannot be, sensors, flags.

And collisions of geoms that stayed apart in all that was run, which may go where the user says so.
"""

import copy
from collections.abc import Collection, Sequence
from itertools import chain
from pathlib import Path

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.compile_model import PREFIX
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_names import is_address
from contactlab.scene.unreachable import GeomPair, filtered_pairs, unreachable_pairs

_FULL = (mujoco.mjtWarning.mjWARN_CONTACTFULL, mujoco.mjtWarning.mjWARN_CNSTRFULL)
_SDF = int(mujoco.mjtGeom.mjGEOM_SDF)


def untouched_geoms(model: mujoco.MjModel, runs: Sequence[Floats]) -> ModelEdits:
    """Return what leaves out collisions of geoms that cannot touch, by proof from joint ranges.

    Runs are configurations (T, nq), which show what joints their limits do not hold.
    """
    pairs = filtered_pairs(model)
    return left_out(model, pairs, unreachable_pairs(model, pairs, runs))


def left_out(
    model: mujoco.MjModel, pairs: Sequence[GeomPair], apart: Collection[GeomPair]
) -> ModelEdits:
    """Return what leaves out collisions of pairs that are apart, of all that may touch.

    What touches nothing is masked, and touches nothing that is added to the model later either;
    else bodies are excluded of which no geoms can touch. Geoms that a flex may touch stay, and so
    do bodies without names.
    """
    touching = [pair for pair in pairs if pair not in apart]
    flexes = np.bitwise_or.reduce([*model.flex_contype, *model.flex_conaffinity, 0])
    kinds = np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)
    masked = {
        geom for geom in set(chain(*pairs)) - set(chain(*touching)) if not kinds[geom] & flexes
    }
    left = _bodies(model, [pair for pair in pairs if masked.isdisjoint(pair)])
    excluded = [map(model.body, bodies) for bodies in sorted(left - _bodies(model, touching))]
    names = [(first.name, second.name) for first, second in excluded]
    return ModelEdits(
        masked=tuple(model.geom(geom).name for geom in sorted(masked)),
        excluded=tuple(name for name in names if not any(map(is_address, name))),
    )


def pairs_within(
    model: mujoco.MjModel, runs: Sequence[Floats], distance: float
) -> set[GeomPair] | None:
    """Return the pairs of geoms that come within a distance [m] in any configuration (T, nq).

    None if MuJoCo has no room for so many contacts: then nothing is known of others.
    """
    wide = copy.copy(model)
    wide.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    wide.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
    wide.geom_margin[:] += distance
    data, found = mujoco.MjData(wide), set[GeomPair]()
    for qpos in chain(*runs):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(wide, data)
        mujoco.mj_comPos(wide, data)
        mujoco.mj_collision(wide, data)
        found.update(map(tuple, np.sort(data.contact.geom, axis=1).tolist()))
    if any(data.warning[kind].number for kind in _FULL):
        return None
    unmeasured = np.flatnonzero(model.geom_type == _SDF).tolist()
    return found | {pair for pair in filtered_pairs(model) if not {*pair}.isdisjoint(unmeasured)}


def _bodies(model: mujoco.MjModel, pairs: Sequence[GeomPair]) -> set[tuple[int, int]]:
    places = np.sort(model.geom_bodyid[np.array(pairs, np.intp).reshape(-1, 2)], axis=1)
    return {(first, second) for first, second in places.tolist()}


def sensors_of(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the model's own sensors, by name or address."""
    names = (model.sensor(sensor).name or f"sensor[{sensor}]" for sensor in range(model.nsensor))
    return tuple(name for name in names if not name.startswith(PREFIX))


def unread_flags(file: Path) -> tuple[str, ...]:
    """Return the flags of a model's file that compute what no state depends on."""
    try:
        bits = int(mujoco.MjSpec.from_file(str(file)).option.enableflags)
    except ValueError:
        return ()
    unread = {
        "energy": mujoco.mjtEnableBit.mjENBL_ENERGY,
        "fwdinv": mujoco.mjtEnableBit.mjENBL_FWDINV,
    }
    return tuple(name for name, bit in unread.items() if bits & int(bit))


def with_flags(model: mujoco.MjModel, names: Sequence[str]) -> mujoco.MjModel:
    """Return a model with flags that recording switches off, as its file has them."""
    for name in names:
        model.opt.enableflags |= int(getattr(mujoco.mjtEnableBit, f"mjENBL_{name.upper()}"))
    return model
