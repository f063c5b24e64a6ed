"""Worker processes, one job in flight each; a worker that dies loses that job and no other.

Each worker has a private pipe, whose end is the only sign of its death: a shared queue would
break, or hang, with the process that holds its lock.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import takewhile
from multiprocessing.connection import wait
from multiprocessing.context import ForkServerContext
from pathlib import Path
from tempfile import TemporaryDirectory

from contactlab.run.forking import fork_context
from contactlab.run.job import Job, Lost, Result, Task
from contactlab.run.slot import Slot, end, receive, send, start, tell_to_end
from contactlab.run.stop import Stop

# How long a wish to stop that comes without a signal may go unnoticed [s].
_GLANCE = 0.1


@dataclass(frozen=True)
class LocalPool:
    """Worker processes of this machine.

    Attributes:
        workers: processes; 0 runs everything in this one, without protection from crashes.
    """

    workers: int

    def run(self, task: Task, jobs: Iterable[Job], stop: Stop) -> Iterator[Result]:
        """Yield the results of jobs as they come; see `Executor`."""
        queue = takewhile(lambda _: not stop.is_set, jobs)
        if self.workers == 0:
            yield from _run_here(task, queue, stop)
            return
        context = fork_context()
        slots: list[Slot] = []
        with TemporaryDirectory(prefix="contactlab-") as folder:
            try:
                for number in range(self.workers):
                    if job := next(queue, None):
                        marker = Path(folder) / str(number)
                        start(slots, context, task, marker, job)
                while slots:
                    yield from _next_results(context, task, slots, queue, stop)
            finally:
                end(slots)


class KeptWorker:
    """One worker, kept between jobs, for who is given them one at a time."""

    def __init__(self, task: Task, marker: Path) -> None:
        self._task = task
        self._marker = marker
        self._slots: list[Slot] = []

    def run(self, job: Job, stop: Stop) -> Result:
        """Return what comes of a job; once `stop` is set, perhaps of a part of its runs."""
        if self._slots:
            self._slots[0].job = job
            send(self._slots[0], job)
        else:
            start(self._slots, fork_context(), self._task, self._marker, job)
        (slot,) = self._slots
        while not wait([slot.pipe], _GLANCE):
            if stop.is_set:
                tell_to_end(self._slots)
        try:
            result = receive(slot)
        finally:
            self._marker.unlink(missing_ok=True)
        if slot.told or isinstance(result, Lost):
            self.end()
        return result

    def end(self) -> None:
        """End the worker, whatever it is on."""
        end(self._slots)
        self._slots.clear()


def _run_here(task: Task, jobs: Iterable[Job], stop: Stop) -> Iterator[Result]:
    from contactlab.run.worker import Worker  # noqa: PLC0415 - it loads the engine

    worker = Worker(task, None, lambda: not stop.is_set)
    for job in jobs:
        yield worker.run(job)


def _next_results(
    context: ForkServerContext,
    task: Task,
    slots: list[Slot],
    queue: Iterator[Job],
    stop: Stop,
) -> Iterator[Result]:
    """Wait for workers; give each its next job, or let it go when there is none."""
    stopping = stop.is_set
    if stopping:
        tell_to_end(slots)
    ready = set(wait([*(slot.pipe for slot in slots), *([] if stopping else [stop.fileno()])]))
    for slot in [slot for slot in slots if slot.pipe in ready]:
        result = receive(slot)
        job = next(queue, None)
        if isinstance(result, Lost):
            slots.remove(slot)
            if job is not None:
                start(slots, context, task, slot.marker, job)
        elif job is not None:
            slot.job = job
            send(slot, job)
        else:
            end([slot])
            slots.remove(slot)
        yield result
