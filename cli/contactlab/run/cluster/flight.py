"""Jobs that are on a cluster: sent, called back, and sent again if their node was lost."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import ray
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
from contactlab.run.job import Job, Lost, Result
from contactlab.run.stop import Stop

# How often a job may lose its node before it is held to be the cause.
MOST_LOSSES = 3
_GONE = (NodeDiedError, ObjectLostError, RaySystemError, WorkerCrashedError)
# How long a wish to stop may go unnoticed, and how long processes may take to end [s].
_GLANCE, _END = 0.5, 10.0


class _Sent(NamedTuple):
    """A job, and how often its node was lost."""

    job: Job
    losses: int = 0


@dataclass
class Flight:
    """Keeps a cluster busy with jobs.

    Attributes:
        send: sends a job and returns a reference to its result.
        queue: jobs that are not sent yet; taken lazily.
        room: how many may be on the cluster at once.
        stop: once it is set, jobs that have not begun are called back, and the others may end
            with a part of their runs.
    """

    send: Callable[[Job], Any]
    queue: Iterator[Job]
    room: Callable[[], int]
    stop: Stop
    _again: deque[_Sent] = field(default_factory=deque[_Sent])
    _sent: dict[Any, _Sent] = field(default_factory=dict[Any, _Sent])

    def results(self) -> Iterator[Result]:
        """Yield what comes of every job, once; whoever leaves early ends those in flight.

        Raises:
            ClusterError: a node cannot run jobs.
        """
        try:
            while self._fill():
                landed, _ = ray.wait(list(self._sent), timeout=_GLANCE)
                for reference in landed:
                    result = self._result(reference)
                    if result is not None:
                        yield result
        finally:
            self._end()

    def _fill(self) -> bool:
        """Send what there is room for, or call all back; return whether any are in flight."""
        if self.stop.is_set:
            for reference in self._sent:
                ray.cancel(reference)
            return bool(self._sent)
        room = self.room()
        while len(self._sent) < room and (sent := self._next()):
            self._sent[self.send(sent.job)] = sent
        return bool(self._sent)

    def _next(self) -> _Sent | None:
        if self._again:
            return self._again.popleft()
        job = next(self.queue, None)
        return None if job is None else _Sent(job)

    def _result(self, reference: Any) -> Result | None:  # noqa: ANN401 - as Ray types it
        """Return what came of a job; None if that is still to come, or never will."""
        sent = self._sent.pop(reference)
        try:
            return _accepted(ray.get(reference))
        except TaskCancelledError:
            return None
        except OutOfMemoryError:
            return Lost(sent.job, "out of memory: the cluster ended the worker", timed_out=False)
        except _GONE as error:
            return self._send_again(sent, type(error).__name__)
        except RayTaskError as error:
            last = str(error).strip().splitlines()[-1]
            raise ClusterError(f"a node of the cluster cannot run jobs: {last}") from error

    def _send_again(self, sent: _Sent, reason: str) -> Lost | None:
        losses = sent.losses + 1
        if losses < MOST_LOSSES:
            self._again.append(_Sent(sent.job, losses))
            return None
        return Lost(sent.job, f"its node was lost {losses} times: {reason}", timed_out=False)

    def _end(self) -> None:
        for reference in self._sent:
            ray.cancel(reference, force=True)
        if self._sent:
            ray.wait(list(self._sent), num_returns=len(self._sent), timeout=_END)


def _accepted(reply: Result | Exception | str) -> Result:
    if isinstance(reply, str):
        raise ClusterError(reply)
    if isinstance(reply, Exception):
        raise reply
    return reply
