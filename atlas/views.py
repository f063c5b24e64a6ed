"""Asks each view of a model for what its examination says, and tells where two contradict."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import contactlab
from contactlab.schema.examination import Examination
from contactlab.schema.task import Task
from contactlab.studies.task_verdict import run_labels


class Answer(NamedTuple):
    """What a view says of a model's task; None where it is not asked."""

    line: str
    labels: Mapping[str, Mapping[str, int]]  # runs by label, by phase
    shares: Mapping[str, float | None] | None = None  # phantom forces over real ones, by phase
    word: str | None = None  # of the numerics
    sound: bool | None = None


def of_report(report: Examination) -> Answer:
    """Return what a section of an examination says that judges a task."""
    assert report.verdict is not None
    phases = report.verdict.phases
    return Answer(
        report.task.line,
        {phase.name: phase.labels for phase in phases},
        {phase.name: phase.share for phase in phases},
        report.verdict.word,
        report.sound,
    )


def of_sweep(model: str, task: Task, folder: Path) -> Answer:
    """Return what a sweep of a model says: a run for each seed, labelled."""
    sweep = {"version": 1, "scene": model, "axes": {}, "seeds": list(task.seeds), "checks": "all"}
    timed = {"duration": task.duration, "trace": "none"}
    store = contactlab.sweep({**sweep, **timed}, output=folder, workers=0)
    labels: dict[str, dict[str, int]] = {phase.name: {} for phase in task.phases}
    for label in run_labels(task, store.records()):
        labels[label.phase][label.label] = label.runs
    return Answer(task.line, labels)


def of_views(
    model: str, task: Task, folder: Path, duration: str | None = None
) -> Iterator[tuple[str, Answer]]:
    """Yield each view that judges a task, by its command, and what it says of a model.

    The task is the model's own, of another `duration` if one is given.
    """
    stable = contactlab.stability(
        [model], output=folder / "stability", workers=0, duration=duration
    )
    assert isinstance(stable, Examination)
    yield "stability", of_report(stable)
    checked = contactlab.check(model, output=folder / "check", workers=0, duration=duration)
    yield "check", of_report(checked)
    yield "sweep", of_sweep(model, task, folder / "sweep")


def apart(whole: Answer, view: Answer) -> Iterator[str]:
    """Yield in which fields a view says something else than the whole examination."""
    for field, said, asked in zip(Answer._fields, view, whole, strict=True):
        if said is not None and said != asked:
            yield f"{field} {said}, not {asked}"


def contradictions(report: Examination) -> Iterator[str]:
    """Yield what parts of one examination say against each other."""
    yield from _of_numerics(report)
    yield from _of_labels(report)
    yield from _of_sentence(report)
    yield from _of_changes(report)


def _of_numerics(report: Examination) -> Iterator[str]:
    verdict, budget = report.verdict, report.budget
    if verdict is None or budget is None:
        return
    own = {phase.name: phase.run.share for phase in budget.phases}
    shares = {phase.name: phase.share for phase in verdict.phases}
    if own != shares:
        yield f"the budget has shares {own}, the verdict {shares}"
    if (verdict.word == "sound") != (budget.verdict in {"sound", "model"}):
        yield f"numerics are {verdict.word}, the budget {budget.verdict}"
    if report.sound and not (verdict.sound and not verdict.labels):
        yield f"checks call it sound, where {verdict.line}"


def _of_labels(report: Examination) -> Iterator[str]:
    """Yield labels that the verdict does not count, or the sentence does not have."""
    told: dict[str, dict[str, int]] = {}
    for label in report.labels:
        told.setdefault(label.phase, {})[label.label] = label.runs
        if label.label not in report.sentence:
            yield f"runs are labelled {label.label}, and the sentence does not say so"
    phases = report.verdict.phases if report.verdict else ()
    counted = {phase.name: phase.labels for phase in phases if phase.labels}
    if counted != told:
        yield f"labels are {told}, the verdict counts {counted}"


def _of_sentence(report: Examination) -> Iterator[str]:
    """Yield what the sentence says against the verdict and the changes that it sums up."""
    said, first = report.sentence, next(iter(report.changes), None)
    removing = first.name if first and first.removes == "verdict" else ""
    opens = not said.startswith(("unresolved", "not resolved", "not sound"))
    if opens != report.sound:
        yield f"it is {'' if report.sound else 'not '}sound, and the sentence says: {said}"
    if removing and f"removed by {removing}" not in said:
        yield f"{removing} is the first change, and the sentence names another"
    if not removing and "; removed by " in said:
        yield "the sentence names a change, and none is told"


def _of_changes(report: Examination) -> Iterator[str]:
    """Yield changes that are told otherwise than the budget has them."""
    remedies = report.budget.remedies if report.budget else ()
    tried = {remedy.name: remedy for remedy in remedies}
    for change in report.changes:
        remedy = tried.get(change.name)
        if change.removes != "verdict":
            continue
        if remedy is None or not remedy.removes:
            yield f"{change.name} is told, and the budget does not say that it removes it"
        elif (remedy.price, remedy.share) != (change.price, change.share):
            yield f"{change.name} has two prices or shares"
