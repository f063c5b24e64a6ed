"""What the runs of a task come to, by one function for every study.

Numerics are judged as `examine` judges them: window by window, of the watched bodies, in each phase
by itself, within the task's share. A label belongs to the phase in which it is first met.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from contactlab.budget import Motion, PhaseBudget, Settings, error_budget, judge
from contactlab.budget.verdict import percent
from contactlab.errors import SweepFileError
from contactlab.mjcf import MODEL_ENGINE
from contactlab.plan.task_options import TaskOptions
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.task import Phase, Task
from contactlab.schema.task_verdict import PhaseVerdict, TaskVerdict
from contactlab.store.finished_store import Store
from contactlab.studies.examine.task_motions import task_motions
from contactlab.studies.examine.watched import of_watched
from contactlab.studies.session import Session, Values

_STABLE = "stable"


class _Numerics(NamedTuple):
    budgets: dict[str, PhaseBudget]  # by phase
    word: str
    sentence: str


def refuse_lengths(options: TaskOptions) -> None:
    """Refuse a tolerance of the task that is no share, which is what decides."""
    if (options.within or (0, "1"))[1] != "1":
        raise SweepFileError(
            "'--within' is a share of the real forces here, such as 10%; a length is of a "
            "metric: write METRIC=VALUE, such as slip=1mm"
        )


def records_of(store: Store, scene: Scene, values: Values, task: Task) -> list[EvidenceRecord]:
    """Return the records of a task's runs, one for each seed, as far as a store has them."""
    runs = (scene.resolve(values, seed, task.duration) for seed in task.seeds)
    ids = set(store.table["run_id"].to_pylist())
    return [store.record(run_id) for run in runs if (run_id := scene.run_id(run)) in ids]


def task_verdict(
    task: Task, scene: Scene, values: Values, records: Iterable[EvidenceRecord], session: Session
) -> TaskVerdict:
    """Judge the runs of a task: the motion of its seeds, and what their records are labelled with.

    Raises:
        EngineError: none of the bodies that are watched moves and has mass.
    """
    found = _numerics(task, scene, values, session)
    labelled = _labels(task.phases, records)
    return TaskVerdict.model_validate(
        {
            "word": found.word if found else None,
            "sentence": found.sentence if found else "not judged: nothing moves in MuJoCo",
            "phases": [
                _phase(phase.name, found and found.budgets.get(phase.name), labelled[phase.name])
                for phase in task.phases
            ],
        }
    )


def _numerics(task: Task, scene: Scene, values: Values, session: Session) -> _Numerics | None:
    motions = _motions(task, scene, values, session)
    if not motions:
        return None
    settings = Settings(places=False)
    measured = error_budget(motions, rows=(), settings=settings, workers=session.workers or 1)
    budget = of_watched(measured, task.watched)
    verdict = judge(budget, task.within)
    worst = max(budget.phases, key=lambda phase: phase.run.share)
    share = f"{percent(worst.run.share)} in {worst.bodies[worst.run.body]}, {worst.name}"
    sentence = f"{verdict.word} within {percent(verdict.within)}: {share}"
    if verdict.reasons:
        sentence = f"{verdict.word}: {verdict.reasons[0].sentence}, {verdict.reasons[0].phase}"
    return _Numerics({phase.name: phase for phase in budget.phases}, verdict.word, sentence)


def _motions(task: Task, scene: Scene, values: Values, session: Session) -> list[Motion]:
    """Return the motions of a task's phases; none where MuJoCo has nothing that moves."""
    run = scene.resolve(values, task.seeds[0], task.duration)
    model = scene.base(run.structure).model
    if (
        run.engine != MODEL_ENGINE
        or not model.nv
        or not np.any(model.body_mass[model.body_weldid > 0] > 0)
    ):
        return []
    return task_motions(scene, values, task, allow_code=session.allow_code)


def _phase(name: str, budget: PhaseBudget | None, labels: Counter[str]) -> PhaseVerdict:
    share = budget.run.share if budget else np.nan
    return PhaseVerdict(
        name=name,
        share=share if np.isfinite(share) else None,
        body=budget.bodies[budget.run.body] if budget else None,
        labels=dict(labels),
    )


def _labels(phases: Sequence[Phase], records: Iterable[EvidenceRecord]) -> dict[str, Counter[str]]:
    """Return how many runs have each label, by the phase in which it is first met."""
    found = {phase.name: Counter[str]() for phase in phases}
    for record in records:
        step = record.duration / max(record.steps_asked, 1)
        for entry in record.labels:
            if entry.label != _STABLE:
                found[_phase_at(phases, (entry.step or 0) * step)][entry.label] += 1
    return found


def _phase_at(phases: Sequence[Phase], time: float) -> str:
    return [phase.name for phase in phases if phase.begin <= time or phase is phases[0]][-1]
