"""Where the time of a model goes: what steps take without one part, over what they take with it.

Parts are left out one at a time, for a few steps from states along runs of the whole model, so that
what is left does the same work. All of them take turns in one process.
"""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import mujoco

from contactlab.engines.engine import Segments
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
"""What any compiled model can be without, by name: its options then, flags beside its own."""


def costs_without(
    runs: Sequence[Segments], clock: Clock, rounds: int = _ROUNDS
) -> dict[str, Ratio]:
    """Return the cost without each part, as a ratio to the whole: its share is one minus that.

    The runs are of the whole model, the clock as `TimesSteps.time_segments`. All take turns.
    """
    models = [_without(runs[0].model, options) for options in ({}, *PARTS.values())]
    every = [[replace(run, model=model) for run in runs] for model in models]
    for each in every:
        _seconds(each, clock)
    times = [[_seconds(each, clock) for each in every] for _ in range(rounds)]
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
