"""What a model computes that changes no state: collisions that cannot be, sensors, flags."""

from collections.abc import Sequence
from itertools import chain

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.compile_model import PREFIX
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_names import is_address
from contactlab.scene.unreachable import GeomPair, filtered_pairs, unreachable_pairs


def untouched_geoms(model: mujoco.MjModel, runs: Sequence[Floats]) -> ModelEdits:
    """Return what leaves out collisions of geoms that cannot touch, by proof from joint ranges.

    Runs are configurations (T, nq), which show what joints their limits do not hold. What cannot
    touch anything is masked, and touches nothing that is added to the model later either; else
    bodies are excluded of which no geoms can touch. Geoms that a flex may touch stay, and so do
    bodies without names.
    """
    pairs = filtered_pairs(model)
    proven = unreachable_pairs(model, pairs, runs)
    touching = [pair for pair in pairs if pair not in proven]
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


def _bodies(model: mujoco.MjModel, pairs: Sequence[GeomPair]) -> set[tuple[int, int]]:
    places = np.sort(model.geom_bodyid[np.array(pairs, np.intp).reshape(-1, 2)], axis=1)
    return {(first, second) for first, second in places.tolist()}


def sensors_of(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the model's own sensors, by name or address."""
    names = (model.sensor(sensor).name or f"sensor[{sensor}]" for sensor in range(model.nsensor))
    return tuple(name for name in names if not name.startswith(PREFIX))
