"""A worker's memory does not grow with the runs that it has done."""

import ctypes
import gc
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import count, islice
from typing import Any

import pytest

from contactlab.run import planned_runs
from contactlab.run.tasks import Job
from contactlab.run.worker import Worker

SWEEP = """
version: 1
scene: ball_drop
duration: 0.01
seeds: 128
checks: none
axes:
  timestep: [1.0e-3]
  friction.slide: [0.5]
"""
ONE_JOB = 32
# The first ones fill what is kept between jobs: values of a setting, 512, and models, 64.
WARM, MEASURED = 20, 20


class Allocated(ctypes.Structure):
    """The C library's count of what it gave out, `struct mallinfo2`."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            *("arena", "ordblks", "smblks", "hblks", "hblkhd"),
            *("usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"),
        )
    ]


def allocated() -> tuple[int, int]:
    """Return how many objects Python has, and how many bytes the C library gave out."""
    gc.collect()
    library = ctypes.CDLL(None)
    if not hasattr(library, "mallinfo2"):
        pytest.skip("this C library does not count what it gives out")
    library.mallinfo2.restype = Allocated
    counts = library.mallinfo2()
    return sys.getallocatedblocks(), counts.uordblks + counts.hblkhd


def fresh(jobs: list[Job], models: str) -> Iterator[Job]:
    """Yield jobs of runs that there were not yet: other seeds, and other models if asked for."""
    job = max(jobs, key=len)
    for first in count(1000, len(job)):
        yield tuple(
            replace(
                run,
                run_id=f"{number:016x}",
                seed=number,
                settings=run.settings
                if models == "same"
                else run.settings | {"friction": (0.3 + 1e-6 * number,) * 2 + (0.005, 1e-4, 1e-4)},
            )
            for number, run in enumerate(job, start=first)
        )


@pytest.mark.night
@pytest.mark.parametrize(
    ("trace", "models"),
    [
        ("none", "same"),
        pytest.param("none", "new", marks=pytest.mark.night),
        pytest.param("all", "new", marks=pytest.mark.night),
    ],
)
def test_a_worker_does_not_grow(
    trace: str, models: str, sweeper: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    workers: list[Worker] = []
    jobs: list[Job] = []
    run_job = Worker.run

    def watched(self: Worker, job: Job) -> Any:
        workers.append(self)
        jobs.append(job)
        return run_job(self, job)

    with monkeypatch.context() as patch:
        patch.setattr(Worker, "run", watched)
        for work in ("LEAST_WORK", "SMALL_WORK"):
            patch.setattr(planned_runs, work, 0)
        sweeper.run(f"{SWEEP}trace: {trace}\n")
    todo = fresh(jobs, models)
    for job in islice(todo, WARM):
        workers[0].run(job)
    objects, given = allocated()
    for job in islice(todo, MEASURED):
        assert len(workers[0].run(job)) == ONE_JOB
    more_objects, more_given = allocated()
    runs = MEASURED * ONE_JOB
    # Whatever is kept of each run is an object a run or more; an array of it is 100 bytes or more.
    assert more_objects - objects < runs / 2
    assert more_given - given < 100 * runs
