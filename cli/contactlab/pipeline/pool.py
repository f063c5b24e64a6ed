"""Worker processes, one job in flight each; a worker that dies loses that job and no other.

Each worker has a private pipe, whose end is the only sign of its death: a shared queue would
break, or hang, with the process that holds its lock.
"""

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass
from itertools import takewhile
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import TYPE_CHECKING

from contactlab.pipeline.job import Finished, Job, Lost, Result, Task
from contactlab.pipeline.stop import Stop

if TYPE_CHECKING:
    from contactlab.pipeline.worker import Worker

_PRELOAD = ["contactlab.pipeline.worker"]


@dataclass
class _Slot:
    """A worker and the job that it is on."""

    process: BaseProcess
    pipe: Connection
    marker: Path
    job: Job


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
            yield from _run_here(task, queue)
            return
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(_PRELOAD)
        slots: list[_Slot] = []
        with TemporaryDirectory(prefix="contactlab-") as folder:
            try:
                for number in range(self.workers):
                    if job := next(queue, None):
                        marker = Path(folder) / str(number)
                        slots.append(_start(context, task, marker, job))
                while slots:
                    yield from _next_results(context, task, slots, queue)
            finally:
                _stop(slots)


def _run_here(task: Task, jobs: Iterable[Job]) -> Iterator[Result]:
    from contactlab.pipeline.worker import Worker  # noqa: PLC0415 - it loads the engine

    worker = Worker(task, None)
    for job in jobs:
        yield worker.run(job)


def _next_results(
    context: ForkServerContext,
    task: Task,
    slots: list[_Slot],
    queue: Iterator[Job],
) -> Iterator[Result]:
    """Wait for workers; give each its next job, or let it go when there is none."""
    ready = set(wait([slot.pipe for slot in slots]))
    for slot in [slot for slot in slots if slot.pipe in ready]:
        result = _receive(slot)
        job = next(queue, None)
        if isinstance(result, Lost):
            slots.remove(slot)
            if job is not None:
                slots.append(_start(context, task, slot.marker, job))
        elif job is not None:
            slot.job = job
            _send(slot)
        else:
            slots.remove(slot)
            _stop([slot])
        yield result


def _receive(slot: _Slot) -> Result:
    try:
        received = slot.pipe.recv()
    except (EOFError, OSError):
        slot.process.join()
        slot.pipe.close()
        trace = slot.marker.read_text(encoding="utf-8") if slot.marker.is_file() else ""
        timed_out = trace.startswith("Timeout")
        return Lost(slot.job, _death(slot.process.exitcode, trace), timed_out)
    if isinstance(received, Exception):
        raise received
    return received


def _death(exitcode: int | None, trace: str) -> str:
    if trace:
        return " / ".join(line.strip() for line in trace.splitlines()[:6])
    if exitcode is not None and exitcode < 0:
        return f"the worker was ended by {signal.Signals(-exitcode).name}"
    return f"the worker exited with code {exitcode}"


def _start(context: ForkServerContext, task: Task, marker: Path, job: Job) -> _Slot:
    marker.unlink(missing_ok=True)
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(task, theirs, marker), daemon=True)
    with _uninterrupted(), _without_main():
        process.start()
    theirs.close()
    slot = _Slot(process, ours, marker, job)
    _send(slot)
    return slot


def _send(slot: _Slot) -> None:
    """Send a worker its job; one that just died is noticed when its result is read."""
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        slot.pipe.send(slot.job)


@contextlib.contextmanager
def _uninterrupted() -> Generator[None]:
    """Hold Ctrl-C back, and keep it from processes that start meanwhile, for as long as they live.

    They would else die of it, with a traceback each, before they can choose to ignore it.
    """
    # Its own start ends with Ctrl-C let through; nothing happens where it runs already.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _without_main() -> Generator[None]:
    """Hide the program that is running from processes that start meanwhile.

    They would else import it, and with it all that a command line needs; one without a guard
    would start its sweep once more in each worker.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _stop(slots: list[_Slot]) -> None:
    for slot in slots:
        slot.pipe.close()
        slot.process.terminate()
    for slot in slots:
        slot.process.join()


def _serve(task: Task, pipe: Connection, marker: Path) -> None:
    """Run jobs until the pipe closes; a worker never outlives its parent."""
    from contactlab.pipeline.worker import Worker  # noqa: PLC0415 - it loads the engine

    threading.Thread(target=_follow_parent, daemon=True).start()
    worker = Worker(task, marker)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            pipe.send(_attempt(worker, pipe.recv()))


def _attempt(worker: "Worker", job: Job) -> list[Finished] | Exception:
    """Return the results, or the failure, which ends the sweep in the parent."""
    try:
        return worker.run(job)
    except Exception as error:  # noqa: BLE001 - carried to the parent, which raises it
        return error


def _follow_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
