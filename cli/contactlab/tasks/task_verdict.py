"""Judges the runs of a task, by one function for every study.

Numerics are judged as `examine` judges them: window by window, for the observed bodies, in each
phase alone, under the task's tolerance. A label belongs to the phase in which it begins.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace

import mujoco
import numpy as np

from contactlab.budget import ErrorBudget, PhaseBudget, Settings, error_budget, judge
from contactlab.errors import SweepFileError
from contactlab.measure.assessment import blame_model
from contactlab.measure.backward_error import step_dependent
from contactlab.measure.entries import labels_with
from contactlab.mjcf import MODEL_ENGINE
from contactlab.plan.task_options import TaskOptions
from contactlab.rendering.amounts import LEAST_ERROR, format_error, format_percent
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.examination import RunLabel
from contactlab.schema.task import Task
from contactlab.schema.task_verdict import PhaseVerdict, TaskVerdict
from contactlab.store.finished_store import Store
from contactlab.tasks.session import Session, Values
from contactlab.tasks.task_motions import task_motions


def refuse_lengths(options: TaskOptions) -> None:
    """Refuse a tolerance of the task that is not a share."""
    if (options.tolerance or (0, "1"))[1] != "1":
        raise SweepFileError(
            "--tolerance is a share of the real forces here, such as 10%. Write the length of a "
            "metric as METRIC=VALUE, such as hold_slip=1mm"
        )


def records_of(store: Store, scene: Scene, values: Values, task: Task) -> list[EvidenceRecord]:
    """Return the records of a task's runs, one for each seed, as far as a store has them."""
    runs = scene.resolve_seeds(values, task.seeds, task.duration)
    ids = set(store.table["run_id"].to_pylist())
    return [store.record(run_id) for run in runs if (run_id := scene.run_id(run)) in ids]


def task_verdict(
    task: Task, scene: Scene, values: Values, records: Iterable[EvidenceRecord], session: Session
) -> TaskVerdict:
    """Judge the runs of a task: the motion of its seeds, and the labels of their records.

    Raises:
        EngineError: none of the observed bodies moves and has mass.
    """
    run = scene.resolve(values, task.seeds[0], task.duration)
    if not can_move(run, scene.base(run.structure).model):
        return verdict_of(task, None, records)
    whole = scene.with_effects("all")
    motions = task_motions(whole, values, task, allow_code=session.allow_code)
    settings, threads = Settings(places=False), max(1, session.workers)
    budget = error_budget(motions, rows=(), settings=settings, workers=threads)
    return verdict_of(task, budget, records)


def verdict_of(
    task: Task, budget: ErrorBudget | None, records: Iterable[EvidenceRecord]
) -> TaskVerdict:
    """Return the verdict of a task: its numerics, by a budget if there is one, and its labels.

    Modeling choices do not count: their rows are left out.
    """
    labelled = {phase.name: Counter[str]() for phase in task.phases}
    for label in run_labels(task, records, budget):
        labelled[label.phase][label.label] = label.runs
    phases = {phase.name: phase for phase in budget.phases} if budget else {}
    word = sentence = None
    if budget is not None:
        numerics = tuple(replace(phase, rows=()) for phase in budget.phases)
        verdict = judge(ErrorBudget(numerics), task.tolerance)
        word = verdict.word
        worst = max(budget.phases, key=lambda phase: phase.run.error)
        error = f"{format_error(worst.run.error)} in {worst.bodies[worst.run.body]}, {worst.name}"
        sentence = (
            f"{word} (numerical error {error}; tolerance {format_percent(verdict.tolerance)})"
        )
        if verdict.reasons:
            reason = verdict.reasons[0]
            where = f"{reason.sentence}, {reason.phase}"
            sentence = f"{word} ({where}; tolerance {format_percent(verdict.tolerance)})"
    return TaskVerdict.model_validate(
        {
            "verdict": word,
            "sentence": sentence or "not judged: nothing moves in MuJoCo",
            "phases": [
                _phase_verdict(phase.name, phases.get(phase.name), labelled[phase.name])
                for phase in task.phases
            ],
        }
    )


def can_move(run: RunSpec, model: mujoco.MjModel) -> bool:
    """Return whether MuJoCo simulates a run, and something in its model moves and has mass."""
    masses = model.body_mass[model.body_weldid > 0]
    return run.engine == MODEL_ENGINE and bool(model.nv) and bool(np.any(masses > 0))


def _phase_verdict(name: str, budget: PhaseBudget | None, labels: Counter[str]) -> PhaseVerdict:
    error = budget.run.error if budget else np.nan
    return PhaseVerdict(
        name=name,
        numerical_error=error,
        body=budget.bodies[budget.run.body] if budget else None,
        labels=dict(labels),
    )


def run_labels(
    task: Task, records: Iterable[EvidenceRecord], budget: ErrorBudget | None = None
) -> tuple[RunLabel, ...]:
    """Return the failure labels of runs, by label and the phase in which it begins.

    Labels of bodies that are not observed are left out. So are labels that only note something,
    such as a limit of the recorder; and a dependence of single runs on the step, if the error
    budget of all seeds is within the tolerance. Accurate numerics of a phase cause none of its
    labels, even if those of another phase of the same run are not accurate.
    """
    labels: dict[tuple[str, str], RunLabel] = {}
    ignored_labels = {"stable", *labels_with("note")}
    if budget is not None and all(phase.run.error <= task.tolerance for phase in budget.phases):
        ignored_labels.add(step_dependent.__name__)
    accurate = dict(_describe_accurate(budget, task.tolerance)) if budget else {}
    for record in records:
        step = record.duration / max(record.steps_asked, 1)
        for entry in record.labels:
            unobserved = task.observed and entry.bodies and not {*task.observed} & {*entry.bodies}
            if entry.label in ignored_labels or unobserved:
                continue
            time = None if entry.step is None else entry.step * step
            begun_phases = [each for each in task.phases if each.begin <= (time or 0.0)]
            phase = [task.phases[0], *begun_phases][-1].name
            first = RunLabel(
                label=entry.label,
                phase=phase,
                runs=0,
                reason=blame_model(entry.reason, accurate[phase])
                if phase in accurate
                else entry.reason,
                seed=record.seed,
                time=time,
                bodies=entry.bodies,
            )
            same_label = labels.get((entry.label, phase), first)
            labels[entry.label, phase] = same_label.model_copy(update={"runs": same_label.runs + 1})
    return tuple(labels.values())


def _describe_accurate(budget: ErrorBudget, tolerance: float) -> Iterator[tuple[str, str]]:
    # Yield the phases with accurate numerics, and their numerical errors in words.
    for phase in budget.phases:
        if judge(ErrorBudget((replace(phase, rows=()),)), tolerance).word == "ok":
            body = phase.bodies[phase.run.body]
            where = f" in {body}" if phase.run.error >= LEAST_ERROR else ""
            yield phase.name, f"numerical error {format_error(phase.run.error)}{where}"
