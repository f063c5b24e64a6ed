"""Compares the views of a model with its examination, and lists contradictions."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import contactlab
from contactlab.rendering.text import render_text
from contactlab.reporting.examination import first_fix
from contactlab.reporting.examination_document import describe_examination
from contactlab.schema.examination import Examination
from contactlab.schema.task import Task
from contactlab.tasks.task_verdict import run_labels


class Answer(NamedTuple):
    """Answer of a view about a model's task; None for what it does not have."""

    line: str
    labels: Mapping[str, Mapping[str, int]]  # runs by label, by phase
    errors: Mapping[str, float | None] | None = None  # numerical errors by phase
    numerics: str | None = None  # verdict on the numerics
    passed: bool | None = None


def of_report(report: Examination) -> Answer:
    """Return the answer of a section of an examination that judges a task."""
    assert report.task_verdict is not None
    phases = report.task_verdict.phases
    return Answer(
        report.task.line,
        {phase.name: phase.labels for phase in phases},
        {phase.name: phase.numerical_error for phase in phases},
        report.task_verdict.verdict,
        report.passed,
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
    for section in ("labels", "checks"):
        report = contactlab.examine(
            model, section=[section], output=folder / section, workers=0, duration=duration
        )
        yield section, of_report(report)
    yield "sweep", of_sweep(model, task, folder / "sweep")


def apart(whole: Answer, view: Answer) -> Iterator[str]:
    """Yield in which fields a view says something else than the whole examination."""
    for field, said, asked in zip(Answer._fields, view, whole, strict=True):
        if said is not None and said != asked:
            yield f"{field} {said}, not {asked}"


def contradictions(report: Examination) -> Iterator[str]:
    """Yield contradictions between parts of one examination."""
    yield from _of_numerics(report)
    yield from _of_labels(report)
    yield from _of_head(report)
    yield from _of_fixes(report)


def _of_numerics(report: Examination) -> Iterator[str]:
    verdict, budget = report.task_verdict, report.budget
    if verdict is None or budget is None:
        return
    own = {phase.name: phase.numerical_error.error for phase in budget.phases}
    errors = {phase.name: phase.numerical_error for phase in verdict.phases}
    if own != errors:
        yield f"the budget has numerical errors {own}, the verdict {errors}"
    if (verdict.verdict == "ok") != (budget.verdict in {"ok", "depends"}):
        yield f"the numerics are {verdict.verdict}, the budget {budget.verdict}"
    if report.passed and not (verdict.is_accurate and not verdict.labels):
        yield f"the checks pass, although {verdict.line}"


def _of_labels(report: Examination) -> Iterator[str]:
    """Yield labels that the verdict does not count, or the text does not have."""
    runs: dict[str, dict[str, int]] = {}
    text = " ".join(render_text(describe_examination(report)).split())
    for label in report.labels:
        runs.setdefault(label.phase, {})[label.label] = label.runs
        if label.label not in text:
            yield f"runs are labelled {label.label}, and the text does not say so"
    phases = report.task_verdict.phases if report.task_verdict else ()
    counted = {phase.name: phase.labels for phase in phases if phase.labels}
    if counted != runs:
        yield f"labels are {runs}, the verdict counts {counted}"


def _of_head(report: Examination) -> Iterator[str]:
    """Yield contradictions between the headline, the fix, and the verdict and fixes."""
    if not report.headline.startswith(report.verdict or ""):
        yield f"the verdict is {report.verdict}, and the headline says: {report.headline}"
    if (report.verdict in {"ok", "depends"}) != report.passed:
        yield f"the verdict is {report.verdict}, and the checks {'pass' * report.passed or 'fail'}"
    if report.fixes and not report.fix.startswith(first_fix(report.fixes).name):
        yield f"{first_fix(report.fixes).name} is the first fix, and the head names: {report.fix}"


def _of_fixes(report: Examination) -> Iterator[str]:
    """Yield fixes that differ from those of the budget."""
    tried = {fix.name: fix for fix in (report.budget.fixes if report.budget else ())}
    for fix in report.fixes:
        own = tried.get(fix.name)
        if fix.removes != "verdict":
            continue
        if own is None or not own.removes:
            yield f"{fix.name} is reported, and the budget does not say that it removes the cause"
        elif (own.time_ratio, own.error) != (fix.time_ratio, fix.error):
            yield f"{fix.name} has two time ratios or errors"
