"""Where the time of a model goes, and what it computes that changes no state.

Parts are left out one at a time, for a few steps from states along runs of the whole model, so that
what is left does the same work. All of them take turns in one process.
"""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import Segments
from contactlab.scene.compile_model import PREFIX
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_names import is_address
from contactlab.scene.unreachable import GeomPair, filtered_pairs, unreachable_pairs
from contactlab.schema.study_reports import Ratio

Clock = Callable[[Segments, int, int], tuple[float, int]]
_OFF = mujoco.mjtDisableBit
_STEPS, _ROUNDS = 16, 9

PARTS: Mapping[str, Mapping[str, int]] = {
    "sensors": {"disableflags": int(_OFF.mjDSBL_SENSOR)},
    "contacts": {"disableflags": int(_OFF.mjDSBL_CONTACT)},
    "constraints, contacts included": {"disableflags": int(_OFF.mjDSBL_CONSTRAINT)},
    "solver iterations after the first": {"iterations": 1, "noslip_iterations": 0},
    "the integrator, over Euler": {"integrator": int(mujoco.mjtIntegrator.mjINT_EULER)},
}
"""Parts that any compiled model can do without, by name: its options then, flags beside its own."""


def costs_without(
    runs: Sequence[Segments], clock: Clock, rounds: int = _ROUNDS
) -> dict[str, Ratio]:
    """Return the cost without each part, as a ratio to the whole: its share is one minus that.

    The runs are of the whole model, the clock as `TimesSteps.time_segments`. All take turns.
    """
    models = [_without(runs[0].model, options) for options in ({}, *PARTS.values())]
    every = [[replace(run, model=model) for run in runs] for model in models]
    for configuration in every:
        _seconds(configuration, clock)
    times = [[_seconds(configuration, clock) for configuration in every] for _ in range(rounds)]
    return {
        name: Ratio.of([taken[place] / taken[0] for taken in times])
        for place, name in enumerate(PARTS, 1)
    }


def _without(model: mujoco.MjModel, options: Mapping[str, int]) -> mujoco.MjModel:
    copied = copy.copy(model)
    for name, value in options.items():
        off = copied.opt.disableflags if name == "disableflags" else 0
        setattr(copied.opt, name, off | value)
    return copied


def _seconds(runs: Sequence[Segments], clock: Clock) -> float:
    return sum(clock(run, _STEPS, 1)[0] for run in runs)


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
