"""Runs jobs as tasks of a Ray cluster; each counts once, even if nodes fail."""

import pickle
import secrets
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import islice, takewhile
from pathlib import Path
from typing import Any

import ray
from ray import cloudpickle
from ray.exceptions import (
    NodeDiedError,
    ObjectLostError,
    OutOfMemoryError,
    RaySystemError,
    RayTaskError,
    TaskCancelledError,
    WorkerCrashedError,
)

from contactlab.errors import ClusterError
from contactlab.run.ray import node as ray_node
from contactlab.run.ray.node import NodeRequirements
from contactlab.run.task_bundle import pack_bundle
from contactlab.run.tasks import MAX_LOSSES, CrashedJob, Job, Result, Stop, Task
from contactlab.store.atomic_files import TEMPORARY_SUFFIX
from contactlab.store.store_files import TRACES

_LOSS_ERRORS = (NodeDiedError, ObjectLostError, RaySystemError, WorkerCrashedError)
# Longest delay until a request to stop is noticed, and time limit for processes to end [s].
_STOP_INTERVAL, _END_TIMEOUT = 0.5, 10.0


@dataclass(frozen=True)
class RayExecutor:
    """The cluster that this process is connected to.

    At most `max_jobs` jobs are on it at a time; None for two per CPU, so that no CPU is idle.
    """

    max_jobs: int | None = None

    @property
    def workers(self) -> int:
        """Number of jobs that run at a time; CPUs may come and go."""
        cpus = max(1, int(ray.cluster_resources().get("CPU", 0)))
        return min(cpus, self.max_jobs or cpus)

    def run(self, task: Task, jobs: Iterable[Job], stop: Stop) -> Iterator[Result]:
        """Yield the results of jobs when they are ready; see `Executor`."""
        if not ray.cluster_resources().get("CPU"):
            raise ClusterError(
                "no node of the cluster has CPUs; start one: ray start --address=..."
            )
        cloudpickle.register_pickle_by_value(ray_node)
        with published_requirements(task) as requirements:
            # References in a list are fetched only by processes that do not have them yet.
            shared = [ray.put(requirements), ray.put(pack_bundle(task))]
            remote: Any = ray.remote(num_cpus=1, max_retries=0)(ray_node.run_job)

            def send(job: Job) -> Any:  # noqa: ANN401 - a reference, which Ray types so
                return remote.remote(requirements.token, shared, pickle.dumps(job))

            queue = takewhile(lambda _: not stop.is_set, jobs)
            yield from InFlight(send, queue, self._job_capacity, stop).iterate_results()

    def _job_capacity(self) -> int:
        return self.max_jobs or 2 * self.workers


@dataclass
class InFlight:
    """The jobs on a cluster: sent, cancelled, and sent again if their node was lost.

    `send` returns a reference to a job's result. Once `stop` is set, waiting jobs are cancelled,
    and the others may end with a part of their runs.
    """

    send: Callable[[Job], Any]
    queue: Iterator[Job]
    capacity: Callable[[], int]
    stop: Stop
    # Each job by its reference, and the number of its lost nodes.
    _sent: dict[Any, tuple[Job, int]] = field(default_factory=dict[Any, tuple[Job, int]])

    def iterate_results(self) -> Iterator[Result]:
        """Yield the result of every job, once; an early exit cancels those in flight."""
        try:
            while self._send_jobs():
                ready, _ = ray.wait(list(self._sent), timeout=_STOP_INTERVAL)
                for reference in ready:
                    if (result := self._read_result(reference)) is not None:
                        yield result
        finally:
            for reference in self._sent:
                ray.cancel(reference, force=True)
            if self._sent:
                ray.wait(list(self._sent), num_returns=len(self._sent), timeout=_END_TIMEOUT)

    def _send_jobs(self) -> bool:
        """Send as many jobs as fit, or cancel all; return whether any are in flight."""
        if self.stop.is_set:
            for reference in self._sent:
                ray.cancel(reference)
        else:
            for job in islice(self.queue, max(0, self.capacity() - len(self._sent))):
                self._sent[self.send(job)] = job, 0
        return bool(self._sent)

    def _read_result(self, reference: Any) -> Result | None:  # noqa: ANN401 - as Ray types it
        """Return the result of a job; None if it is sent again or was cancelled."""
        job, losses = self._sent.pop(reference)
        try:
            reply: Result | Exception | str = ray.get(reference)
        except TaskCancelledError:
            return None
        except OutOfMemoryError:
            return CrashedJob(job, "out of memory: the cluster ended the worker", timed_out=False)
        except _LOSS_ERRORS as error:
            losses += 1
            if losses == MAX_LOSSES:
                return CrashedJob(
                    job,
                    f"its node was lost {losses} times: {type(error).__name__}",
                    timed_out=False,
                )
            if not self.stop.is_set:
                self._sent[self.send(job)] = job, losses
            return None
        except RayTaskError as error:
            last = str(error).strip().splitlines()[-1]
            raise ClusterError(f"a node of the cluster cannot run jobs: {last}") from error
        if isinstance(reply, str):
            raise ClusterError(reply)
        if isinstance(reply, Exception):
            raise reply
        return reply


@contextmanager
def published_requirements(task: Task) -> Generator[NodeRequirements]:
    """Yield requirements on nodes; meanwhile the store has a sentinel file that they must see."""
    token = secrets.token_hex(8)
    engine = task.identity.engine
    versions = {"contactlab": version("contactlab"), engine.name: engine.version}
    if not isinstance(task.store, Path):
        yield NodeRequirements(token, versions)
        return
    sentinel = task.store / TRACES / (token + TEMPORARY_SUFFIX)
    sentinel.touch()
    try:
        yield NodeRequirements(token, versions, sentinel)
    finally:
        sentinel.unlink(missing_ok=True)
