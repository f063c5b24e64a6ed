"""Known faults of the engine that an examined model meets, and the fixes that avoid them."""

import math
from collections.abc import Iterator, Sequence

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
from contactlab.modifications.modification import ANY_LABEL, Candidate
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_edits import FLAG_NAMES, write_flags, write_option
from contactlab.scene.scene_source import SceneSource
from contactlab.schema.advisory import Advisory, Workaround
from contactlab.schema.examination import Fact
from contactlab.schema.verdict import VerdictWord


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
        sentence, time = describe_met_advisory(advisory), times.get(advisory.id)
        acts = time is None or math.isfinite(time)
        if time is not None:
            where = f" in this run, from {time:.2f} s" if acts else ", but not in this run"
            sentence = sentence.replace(advisory.id, advisory.id + where, 1)
        if not acts:
            sentence = sentence.replace("meets", "may meet", 1)
        yield Fact(
            kind="advisory", place=advisory.id, value=float(acts), unit="1", sentence=sentence
        )


def _find_first_times(
    advisories: Sequence[Advisory], motions: Sequence[Motion], begins: Sequence[float]
) -> dict[str, float]:
    """Return the time of the first state in which each fault can act [s], infinite without one."""
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


def list_workaround_candidates(
    model: mujoco.MjModel, source: SceneSource, word: VerdictWord
) -> Iterator[Candidate]:
    """Yield the workarounds of met advisories that keep the model, as fixes of a verdict."""
    for met in find_met_advisories(model, elements=lambda: source.elements):
        for workaround in met.workarounds:
            keeps = CATALOGUE[workaround.modification].kind == "computation"
            if keeps and workaround.settings.keys() <= {*OPTIONS, *FLAG_NAMES}:
                yield _make_candidate(met, workaround, word)


def _make_candidate(met: Advisory, workaround: Workaround, word: VerdictWord) -> Candidate:
    settings = workaround.settings

    def change_model(model: mujoco.MjModel) -> None:
        for name in settings.keys() & {*OPTIONS}:
            write_option(model, name, settings[name])
        if flags := {name: bool(settings[name]) for name in settings.keys() & {*FLAG_NAMES}}:
            write_flags(model, flags)

    said = " ".join(f"{name}={value}" for name, value in settings.items())
    return Candidate(
        f"{said} against {met.id}",
        word,
        change_model,
        labels=(ANY_LABEL,),
        edits=ModelEdits(dict(settings)),
    )
