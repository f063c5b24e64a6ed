"""Known faults of the engine that an examined model meets, and the fixes that avoid them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.advisories.field_expressions import ModelFacts
from contactlab.advisories.met_advisories import (
    can_act,
    describe_met_advisory,
    find_met_advisories,
)
from contactlab.budget.motion import INTEGRATION, Motion
from contactlab.budget.windows import replay
from contactlab.mjcf import OPTIONS
from contactlab.modifications.catalogue import CATALOGUE
from contactlab.scene.model_edits import FLAG_NAMES
from contactlab.scene.scene_source import SceneSource
from contactlab.schema.advisory import Advisory
from contactlab.schema.examination import Fact


class EngineWorkaround(NamedTuple):
    """Settings that avoid a fault of the engine.

    Attributes:
        name: as in "fix: jacobian=dense against CL-2026-0001".
        settings: options and flags.
        sentence: the fault that the model meets.
    """

    name: str
    settings: Mapping[str, object]
    sentence: str


def list_advisory_facts(
    motions: Sequence[Motion], begins: Sequence[float], source: SceneSource
) -> Iterator[Fact]:
    """Yield a fact for each advisory that a model meets under the installed engine.

    Its value is 1 if the fault can act in the motions, whose phases begin at these times [s] of the
    run, and 0 if it can act in none of their states that are looked at.
    """
    model = motions[0].model
    met = find_met_advisories(model, elements=lambda: source.elements)
    times = _find_first_times([each for each in met if each.occurs], motions, begins)
    for advisory in met:
        time = times.get(advisory.id)
        acts = time is None or math.isfinite(time)
        verb, where = ("meets", "") if acts else ("may meet", ", but not in this run")
        if acts and time is not None:
            where = f" in this run, from {time:.2f} s"
        sentence = describe_met_advisory(advisory, verb=verb, where=where)
        yield Fact(
            kind="advisory", place=advisory.id, value=float(acts), unit="1", sentence=sentence
        )


def _find_first_times(
    advisories: Sequence[Advisory], motions: Sequence[Motion], begins: Sequence[float]
) -> dict[str, float]:
    times = {advisory.id: math.inf for advisory in advisories}
    if not advisories:
        return times
    model, data = motions[0].model, mujoco.MjData(motions[0].model)
    window = 0.02  # time between the states that are looked at [s]
    for motion, begin in zip(motions, begins, strict=True):
        run = replay(motion, window, 1)
        for seed, place in np.argwhere(run.valid):
            time = float(begin + run.begins[place] * model.opt.timestep)
            mujoco.mj_setState(model, data, run.starts[seed, place], INTEGRATION)
            mujoco.mj_forward(model, data)
            for advisory in advisories:
                if time < times[advisory.id] and can_act(advisory, ModelFacts(model, data)):
                    times[advisory.id] = time
    return times


def list_workarounds(model: mujoco.MjModel, source: SceneSource) -> Iterator[EngineWorkaround]:
    """Yield the workarounds of met advisories that keep the model."""
    for met in find_met_advisories(model, elements=lambda: source.elements):
        for workaround in met.workarounds:
            keeps = CATALOGUE[workaround.modification].kind == "computation"
            if keeps and workaround.settings.keys() <= {*OPTIONS, *FLAG_NAMES}:
                said = " ".join(f"{name}={value}" for name, value in workaround.settings.items())
                yield EngineWorkaround(
                    f"{said} against {met.id}",
                    dict(workaround.settings),
                    describe_met_advisory(met),
                )
