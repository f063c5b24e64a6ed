"""Parts of a model that change no state: impossible collisions, sensors and flags.

And collisions of far pairs, which are removed only on request.
"""

import copy
from collections.abc import Collection, Sequence
from itertools import chain
from pathlib import Path

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.compile_model import SENSOR_PREFIX
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_names import is_address
from contactlab.scene.unreachable import GeomPair, filtered_pairs, unreachable_pairs

_FULL = (mujoco.mjtWarning.mjWARN_CONTACTFULL, mujoco.mjtWarning.mjWARN_CNSTRFULL)
_SDF = int(mujoco.mjtGeom.mjGEOM_SDF)


def unreachable_edits(
    model: mujoco.MjModel, runs: Sequence[Floats], *, with_masks: bool = True
) -> ModelEdits:
    """Return edits that remove collisions of geoms that provably cannot touch.

    The proof uses joint ranges; for other joints, the visited configurations `runs` (T, nq).
    """
    pairs = filtered_pairs(model)
    apart = unreachable_pairs(model, pairs, runs)
    return exclusion_edits(model, pairs, apart, with_masks=with_masks)


def exclusion_edits(
    model: mujoco.MjModel,
    pairs: Sequence[GeomPair],
    apart: Collection[GeomPair],
    *,
    with_masks: bool = True,
) -> ModelEdits:
    """Return edits that remove collisions of pairs that stay apart.

    Geoms that touch nothing are masked, so later additions to the model do not touch them either.
    Otherwise pairs of bodies without touching geoms are excluded. Geoms that a flex may touch stay,
    and so do unnamed bodies. Without masks pairs of bodies alone are excluded: a gripper touches
    objects that are not in its file.
    """
    touching = [pair for pair in pairs if pair not in apart]
    flexes = np.bitwise_or.reduce([*model.flex_contype, *model.flex_conaffinity, 0])
    kinds = np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)
    masked = {
        geom
        for geom in set(chain(*pairs)) - set(chain(*touching))
        if with_masks and not kinds[geom] & flexes
    }
    remaining_pairs = _body_pairs(model, [pair for pair in pairs if masked.isdisjoint(pair)])
    excluded = [
        map(model.body, bodies) for bodies in sorted(remaining_pairs - _body_pairs(model, touching))
    ]
    names = [(first.name, second.name) for first, second in excluded]
    return ModelEdits(
        masked=tuple(model.geom(geom).name for geom in sorted(masked)),
        excluded=tuple(name for name in names if not any(map(is_address, name))),
    )


def pairs_within(
    model: mujoco.MjModel, runs: Sequence[Floats], distance: float
) -> set[GeomPair] | None:
    """Return the pairs of geoms that come within a distance [m] in any configuration (T, nq).

    None if MuJoCo has no room for all contacts, so that nothing is known of the others.
    """
    wide = copy.copy(model)
    wide.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    wide.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
    wide.geom_margin[:] += distance
    data, near_pairs = mujoco.MjData(wide), set[GeomPair]()
    for qpos in chain(*runs):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(wide, data)
        mujoco.mj_comPos(wide, data)
        mujoco.mj_collision(wide, data)
        near_pairs.update(map(tuple, np.sort(data.contact.geom, axis=1).tolist()))
    if any(data.warning[kind].number for kind in _FULL):
        return None
    unmeasured = np.flatnonzero(model.geom_type == _SDF).tolist()
    return near_pairs | {
        pair for pair in filtered_pairs(model) if not {*pair}.isdisjoint(unmeasured)
    }


def _body_pairs(model: mujoco.MjModel, pairs: Sequence[GeomPair]) -> set[tuple[int, int]]:
    places = np.sort(model.geom_bodyid[np.array(pairs, np.intp).reshape(-1, 2)], axis=1)
    return {(first, second) for first, second in places.tolist()}


def own_sensors(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the model's own sensors, by name or address."""
    names = (model.sensor(sensor).name or f"sensor[{sensor}]" for sensor in range(model.nsensor))
    return tuple(name for name in names if not name.startswith(SENSOR_PREFIX))


def unused_flags(file: Path) -> tuple[str, ...]:
    """Return the flags of a model file that no state depends on."""
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
    """Return a model with flags that recording turns off, as in its file."""
    for name in names:
        model.opt.enableflags |= int(getattr(mujoco.mjtEnableBit, f"mjENBL_{name.upper()}"))
    return model
