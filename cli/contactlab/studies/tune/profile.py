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
_OFF, _INTEGRATOR = mujoco.mjtDisableBit, mujoco.mjtIntegrator
_STEPS, _ROUNDS = 16, 9


def _flag(off: mujoco.mjtDisableBit) -> Callable[[mujoco.MjModel], None]:
    def leave_out(model: mujoco.MjModel) -> None:
        model.opt.disableflags |= int(off)

    return leave_out


def _stop_solving(model: mujoco.MjModel) -> None:
    model.opt.iterations = 1
    model.opt.noslip_iterations = 0


def _integrate_plainly(model: mujoco.MjModel) -> None:
    model.opt.integrator = int(_INTEGRATOR.mjINT_EULER)


PARTS: Mapping[str, Callable[[mujoco.MjModel], None]] = {
    "sensors": _flag(_OFF.mjDSBL_SENSOR),
    "contacts": _flag(_OFF.mjDSBL_CONTACT),
    "constraints, contacts included": _flag(_OFF.mjDSBL_CONSTRAINT),
    "solver iterations after the first": _stop_solving,
    "the integrator, over Euler": _integrate_plainly,
}
"""What any compiled model can be without, by name."""


def costs_without(
    runs: Sequence[Segments],
    clock: Clock,
    others: Mapping[str, mujoco.MjModel],
    rounds: int = _ROUNDS,
) -> dict[str, Ratio]:
    """Return the cost without each part, as a ratio to the whole: its share is one minus that.

    The runs are of the whole model, the clock as `TimesSteps.time_segments`; others are models
    without parts that only compiling leaves out, by the part's name. All take turns, in rounds.
    """
    whole = runs[0].model
    models = {name: _without(whole, leave_out) for name, leave_out in PARTS.items()} | {**others}
    every = [[replace(run, model=model) for run in runs] for model in (whole, *models.values())]
    for each in every:
        _seconds(each, clock)
    times = [[_seconds(each, clock) for each in every] for _ in range(rounds)]
    return {
        name: Ratio.of([taken[place] / taken[0] for taken in times])
        for place, name in enumerate(models, 1)
    }


def _without(model: mujoco.MjModel, leave_out: Callable[[mujoco.MjModel], None]) -> mujoco.MjModel:
    copied = copy.copy(model)
    leave_out(copied)
    return copied


def _seconds(runs: Sequence[Segments], clock: Clock) -> float:
    return sum(clock(run, _STEPS, 1)[0] for run in runs)
