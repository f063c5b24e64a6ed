"""Known faults of the engine that an examined model meets, and the fixes that avoid them."""

from collections.abc import Iterator

import mujoco

from contactlab.advisories.met_advisories import (
    describe_met_advisory,
    find_met_advisories,
    list_model_elements,
)
from contactlab.mjcf import OPTIONS
from contactlab.modifications.catalogue import CATALOGUE
from contactlab.modifications.modification import ANY_LABEL, Candidate
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_edits import FLAG_NAMES, write_flags, write_option
from contactlab.scene.scene_source import SceneSource
from contactlab.schema.advisory import Advisory, Workaround
from contactlab.schema.examination import Fact
from contactlab.schema.verdict import VerdictWord


def list_advisory_facts(model: mujoco.MjModel, source: SceneSource) -> Iterator[Fact]:
    """Yield a fact for each advisory that a model meets under the installed engine."""
    for met in find_met_advisories(model, elements=list_model_elements(source)):
        sentence = describe_met_advisory(met)
        yield Fact(kind="advisory", place=met.id, value=1.0, unit="1", sentence=sentence)


def list_workaround_candidates(
    model: mujoco.MjModel, source: SceneSource, word: VerdictWord
) -> Iterator[Candidate]:
    """Yield the workarounds of met advisories that keep the model, as fixes of a verdict."""
    for met in find_met_advisories(model, elements=list_model_elements(source)):
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
