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
from contactlab.budget.windows import KEPT, replay_motion
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


class MetFaults(NamedTuple):
    """The advisories that a model meets under the installed engine.

    Attributes:
        facts: a fact for each; its value is 1 if the fault can act in the motions, and 0 if it can
            act in none of their states that are looked at.
        acts: whether a fault was seen to act in a state, and a change of settings avoids it.
    """

    facts: tuple[Fact, ...] = ()
    acts: bool = False


def find_met_faults(
    motions: Sequence[Motion], begins: Sequence[float], source: SceneSource
) -> MetFaults:
    """Return the known faults that act in motions, whose phases begin at these times [s]."""
    model = motions[0].model
    met_advisories = find_met_advisories(model, elements=lambda: source.elements)
    times = _find_first_times([each for each in met_advisories if each.occurs], motions, begins)
    facts = list[Fact]()
    for advisory in met_advisories:
        time = times.get(advisory.id)
        acts = time is None or math.isfinite(time)
        verb, where = ("meets", "") if acts else ("may meet", ", but not in this run")
        if acts and time is not None:
            where = f" in this run, from {time:.2f} s"
        sentence = describe_met_advisory(advisory, verb=verb, where=where)
        facts.append(
            Fact(kind="advisory", place=advisory.id, value=float(acts), unit="1", sentence=sentence)
        )
    occurring = [each for each in met_advisories if math.isfinite(times.get(each.id, math.inf))]
    return MetFaults(tuple(facts), any(each.workarounds for each in occurring))


def _find_first_times(
    advisories: Sequence[Advisory], motions: Sequence[Motion], begins: Sequence[float]
) -> dict[str, float]:
    times = {advisory.id: math.inf for advisory in advisories}
    if not advisories:
        return times
    model, data = motions[0].model, mujoco.MjData(motions[0].model)
    window = 0.02  # time between the states that are looked at [s]
    for motion, begin in zip(motions, begins, strict=True):
        run = replay_motion(motion, window, 1)
        states = [
            (int(run.begins[place]), run.starts[seed, place], INTEGRATION)
            for seed, place in np.argwhere(run.valid)
        ]
        # A fault that ends a run may act in few of its steps.
        for warning in run.warnings:
            first = int(run.begins[max(0, warning.window - 1)])
            last = int(run.begins[warning.window]) + run.steps
            states_before = run.velocity_states[warning.seed, first:last]
            states += [(first + step, row, KEPT) for step, row in enumerate(states_before)]
        for step, state, spec in states:
            if not np.isfinite(state).all():
                continue
            time = float(begin + step * model.opt.timestep)
            mujoco.mj_setState(model, data, state, spec)
            mujoco.mj_forward(model, data)
            for advisory in advisories:
                if time < times[advisory.id] and can_act(advisory, ModelFacts(model, data)):
                    times[advisory.id] = time
    return times


def list_workarounds(model: mujoco.MjModel, source: SceneSource) -> Iterator[EngineWorkaround]:
    """Yield the workarounds of met advisories that keep the model."""
    for advisory in find_met_advisories(model, elements=lambda: source.elements):
        for workaround in advisory.workarounds:
            keeps = CATALOGUE[workaround.modification].kind == "computation"
            if keeps and workaround.settings.keys() <= {*OPTIONS, *FLAG_NAMES}:
                settings_text = " ".join(
                    f"{name}={value}" for name, value in workaround.settings.items()
                )
                yield EngineWorkaround(
                    f"{settings_text} against {advisory.id}",
                    dict(workaround.settings),
                    describe_met_advisory(advisory),
                )
