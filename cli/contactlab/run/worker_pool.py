"""Runs jobs on worker processes, one job each; a worker that dies loses that job and no other.

Each worker has a private pipe, whose end is the only sign of its death: a shared queue would
break, or hang, with the process that holds its lock.
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import count, islice, takewhile
from multiprocessing.connection import wait
from pathlib import Path
from tempfile import TemporaryDirectory

from contactlab.run.tasks import Crashed, Job, Result, Stop, Task
from contactlab.run.worker import Worker
from contactlab.run.worker_process import (
    WorkerHandle,
    end_halted,
    kill_workers,
    receive_result,
    request_stop,
    send_job,
    start_worker,
)

# How long a request to stop may go unnoticed [s]: on a cluster it comes without a signal.
_STOP_INTERVAL = 0.1
# How often in a row workers may be silent for that long before they are looked at.
_LOOKS = 20


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
        if self.workers == 0:
            worker = Worker(task, None, lambda: not stop.is_set)
            yield from map(worker.run, takewhile(lambda _: not stop.is_set, jobs))
            return
        with (
            TemporaryDirectory(prefix="contactlab-") as folder,
            closing(WorkerPool(task, Path(folder), self.workers)) as pool,
        ):
            yield from pool.run(jobs, stop)


class WorkerPool:
    """Worker processes of a task, which are started as they are needed and kept between jobs."""

    def __init__(self, task: Task, folder: Path, most: int) -> None:
        self._task = task
        self._markers = [folder / str(number) for number in range(most)]
        self._workers: dict[Path, WorkerHandle] = {}

    def run(self, jobs: Iterable[Job], stop: Stop) -> Iterator[Result]:
        """Yield the results of jobs as they come; see `Executor`."""
        queue, silent = takewhile(lambda _: not stop.is_set, jobs), count(1)
        for marker, job in zip(self._markers, islice(queue, len(self._markers)), strict=False):
            self._send(marker, job)
        while busy := [each for each in self._workers.values() if each.job is not None]:
            if stop.is_set:
                request_stop(busy)
            ready = wait([each.pipe for each in busy], _STOP_INTERVAL)
            if not ready and next(silent) % _LOOKS == 0:
                end_halted(busy)
            for worker in [each for each in busy if each.pipe in ready]:
                result = receive_result(worker)
                if worker.stop_requested or isinstance(result, Crashed):
                    kill_workers([worker])
                    del self._workers[worker.marker]
                if (job := next(queue, None)) is not None:
                    self._send(worker.marker, job)
                yield result

    def _send(self, marker: Path, job: Job) -> None:
        if worker := self._workers.get(marker):
            send_job(worker, job)
        else:
            start_worker(self._workers, self._task, marker, job)

    def close(self) -> None:
        """Kill the workers, whatever they are doing."""
        kill_workers(self._workers.values())
        self._workers.clear()
