"""What a worker does in the passes after the runs, and the notes that it hands over."""

import json
from collections.abc import Iterable, Mapping

from contactlab.accuracy import Note, count_works, discretization_errors
from contactlab.run.run_preparation import Preparer
from contactlab.run.tasks import Finished, Job, Purpose

_LABELS: Mapping[Purpose, str] = {
    "record": "recorded",
    "errors": "held against references",
    "work": "counted",
    "times": "timed",
}


def note(purpose: Purpose, run_id: str, found: Note) -> Finished:
    """Return what a pass found of a run, as a worker hands it over."""
    row = json.dumps({"pass": purpose, "run_id": run_id, "found": found}).encode()
    return Finished(row=row, label=_LABELS[purpose], status="ok", expectation_met=None)


def noted(notes: Iterable[Note], purpose: Purpose) -> dict[str, Note]:
    """Return what a pass found, by run id."""
    return {each["run_id"]: each["found"] for each in notes if each["pass"] == purpose}


def errors_of(preparer: Preparer, job: Job) -> list[Finished]:
    """Return a note of the discretisation errors of each run of a family."""
    request = preparer.task.sweep.accuracy
    assert request is not None
    plans = preparer.plans(job)
    with preparer.watchdog_or_give_up() as watch:
        errors = discretization_errors(preparer.scene, plans, request, watch)
    return [note("errors", run.run_id, each) for run, each in zip(job, errors, strict=True)]


def work_of(preparer: Preparer, job: Job) -> list[Finished]:
    """Return a note of the work of each run of a job."""
    plans = preparer.plans(job)
    with preparer.watchdog_or_give_up() as watch:
        works = list(count_works(preparer.scene, plans, watch))
    return [note("work", run.run_id, each) for run, each in zip(job, works, strict=True)]
