"""Runs jobs on worker processes, one job each; a worker that dies loses that job and no other.

Each worker has a private pipe, whose end is the only sign of its death: a shared queue would
break, or hang, with the process that holds its lock.
"""

import itertools
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import takewhile
from multiprocessing.connection import wait
from multiprocessing.context import ForkServerContext
from pathlib import Path
from tempfile import TemporaryDirectory

from contactlab.run.tasks import Crashed, Job, Result, Stop, Task
from contactlab.run.worker import Worker
from contactlab.run.worker_process import (
    WorkerHandle,
    end_halted,
    fork_context,
    kill_workers,
    receive_result,
    request_stop,
    send_job,
    start_worker,
)

# How long a request to stop that comes without a signal may go unnoticed [s].
_STOP_INTERVAL = 0.1
# How long workers may be silent before they are looked at [s].
_LOOK_INTERVAL = 2.0
_LOOKS = round(_LOOK_INTERVAL / _STOP_INTERVAL)


def worker_count(requested: int | None) -> int:
    """Return the number of worker processes: as requested, or one per core that may be used."""
    if requested is not None:
        return requested
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


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
            worker = Worker(task, None, lambda: not stop.is_set)
            yield from map(worker.run, queue)
            return
        context = fork_context()
        workers: list[WorkerHandle] = []
        with TemporaryDirectory(prefix="contactlab-") as folder:
            try:
                for number in range(self.workers):
                    if job := next(queue, None):
                        start_worker(workers, context, task, Path(folder) / str(number), job)
                while workers:
                    yield from _next_results(context, task, workers, queue, stop)
            finally:
                kill_workers(workers)


class PersistentWorker:
    """One worker process that is kept between jobs, which come one at a time."""

    def __init__(self, task: Task, marker: Path) -> None:
        self._task = task
        self._marker = marker
        self._workers: list[WorkerHandle] = []

    def run(self, job: Job, stop: Stop) -> Result:
        """Return the results of a job; of some of its runs only if `stop` is set meanwhile."""
        if self._workers:
            self._workers[0].job = job
            send_job(self._workers[0], job)
        else:
            start_worker(self._workers, fork_context(), self._task, self._marker, job)
        (worker,) = self._workers
        silent = itertools.count(1)
        while not wait([worker.pipe], _STOP_INTERVAL):
            if stop.is_set:
                request_stop(self._workers)
            if next(silent) % _LOOKS == 0:
                end_halted(self._workers)
        try:
            result = receive_result(worker)
        finally:
            self._marker.unlink(missing_ok=True)
        if worker.stop_requested or isinstance(result, Crashed):
            self.kill()
        return result

    def kill(self) -> None:
        """Kill the worker, whatever it is doing."""
        kill_workers(self._workers)
        self._workers.clear()


def _next_results(
    context: ForkServerContext,
    task: Task,
    workers: list[WorkerHandle],
    queue: Iterator[Job],
    stop: Stop,
) -> Iterator[Result]:
    """Wait for workers; give each its next job, or let it go when there is none."""
    stopping = stop.is_set
    if stopping:
        request_stop(workers)
    pipes = [worker.pipe for worker in workers]
    ready = set(wait([*pipes, *([] if stopping else [stop.fileno()])], _LOOK_INTERVAL))
    if not ready:
        end_halted(workers)
    for worker in [worker for worker in workers if worker.pipe in ready]:
        result = receive_result(worker)
        job = next(queue, None)
        if isinstance(result, Crashed):
            workers.remove(worker)
            if job is not None:
                start_worker(workers, context, task, worker.marker, job)
        elif job is not None:
            worker.job = job
            send_job(worker, job)
        else:
            kill_workers([worker])
            workers.remove(worker)
        yield result
