"""Count the work of runs, and keep states along them for the timing pass."""

import base64
from typing import Any

import numpy as np

from contactlab.engines import Work, count_work
from contactlab.run.job import Finished, Job
from contactlab.run.notes import Note, note
from contactlab.run.preparing import Preparer
from contactlab.scene import compile_without_sensors, prepare_without_sensors


def work_of(preparer: Preparer, job: Job) -> list[Finished]:
    """Return a note of the work of each run of a job, and of states along it.

    The models are those that are timed, so that the states fit them.
    """
    plans = preparer.plans(job)
    compiled = compile_without_sensors(preparer.scene, plans[0].resolved)
    found: list[Finished] = []
    with preparer.watchdog_or_give_up() as watch:
        for plan in plans:
            model = prepare_without_sensors(preparer.scene, plan.resolved, plan.start, compiled)
            work = count_work(model, plan.start, plan.resolved.steps, watch)
            found.append(note("work", plan.run.run_id, _told(work) if work else {}))
    return found


def work_in(found: Note) -> Work:
    """Return the work that a note tells."""
    raw = np.frombuffer(base64.b64decode(found["states"]), dtype="<f8")
    states = raw.reshape(len(found["places"]), -1).astype(np.float64)
    counts = (found[name] for name in ("steps", "iterations", "contacts", "rows"))
    return Work(*counts, places=tuple(found["places"]), states=states)


def _told(work: Work) -> dict[str, Any]:
    states = base64.b64encode(work.states.astype("<f8").tobytes()).decode()
    return {**work._asdict(), "states": states}
