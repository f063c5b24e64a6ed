"""A model, a scene or a sweep under examination: its task in each scenario."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from contactlab.budget import Motion
from contactlab.plan.task_options import TaskOptions
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import WrittenModel
from contactlab.studies.effects.effects_request import (
    SWEEP_SUFFIXES,
    EffectsRequest,
    SweepSetup,
    read_setup,
)
from contactlab.tasks.checked_model import CheckedModel, open_changed_model, open_model
from contactlab.tasks.session import Session


@dataclass(frozen=True)
class Scenarios:
    """The model in each scenario; a model or a scene has one.

    Attributes:
        models: with the settings of each scenario.
        setup: of the sweep; None for a model or a scene.
    """

    models: Sequence[CheckedModel]
    session: Session
    options: TaskOptions
    setup: SweepSetup | None = None

    @cached_property
    def motions(self) -> list[Motion]:
        """The phases of the task in each scenario, of those with the same parts."""
        first = self.models[0].motions
        all_motions = list(first)
        for number, model in enumerate(self.models[1:], 2):
            own = model.motions
            if _sizes_of(own[0]) == _sizes_of(first[0]):
                all_motions += [
                    replace(each, name=f"{each.name}, scenario {number}") for each in own
                ]
        return all_motions

    def open_written(self, written_model: WrittenModel, edits: ModelEdits) -> CheckedModel:
        """Return a written model with the first scenario's settings, except those it has."""
        own = self.models[0]
        if self.setup is not None:
            setup = self.setup.for_written_model(written_model.reference, edits.settings)
            return check_scenario(setup, self.setup.scenarios[0], self.session)
        opened = open_changed_model(written_model.reference, self.session, self.options)
        values = {name: value for name, value in own.values.items() if name not in edits.settings}
        return replace(opened, values={**values, **opened.values}, duration=own.duration)


def _sizes_of(motion: Motion) -> tuple[int, ...]:
    model = motion.model
    return model.nq, model.nbody, model.ngeom, model.ntendon, model.nu, model.npair


def open_scenarios(request: EffectsRequest, session: Session) -> Scenarios:
    """Open a model, a scene, or the scenarios of a sweep file.

    Raises:
        SceneError: there is no such model, or it does not compile.
        SweepFileError: the sweep or a setting is wrong.
    """
    if Path(request.source).suffix not in SWEEP_SUFFIXES:
        model = open_model(request.source, session, request.task, request.assign)
        return Scenarios([model], session, request.task)
    setup = read_setup(request)
    most_scenarios = 4  # of a sweep, evenly spread: each takes as long as a task
    stride = max(1, -(-len(setup.scenarios) // most_scenarios))
    models = [check_scenario(setup, scenario, session) for scenario in setup.scenarios[::stride]]
    return Scenarios(models, session, request.task, setup)


def check_scenario(
    setup: SweepSetup, scenario: Mapping[str, object], session: Session
) -> CheckedModel:
    """Return the model of a sweep in one of its scenarios."""
    return CheckedModel(
        reference=setup.reference,
        scenes=setup.scenes,
        session=replace(session, workers=0),
        values={**setup.base, **scenario},
        duration=setup.duration,
        options=setup.options,
        thresholds=setup.thresholds,
        threads=max(1, session.workers),
    )
