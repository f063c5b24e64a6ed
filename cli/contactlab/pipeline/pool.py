"""Worker processes, one job in flight each; a worker that dies loses that job and no other.

Each worker has a private pipe, whose end is the only sign of its death: a shared queue would
break, or hang, with the process that holds its lock.
"""

import contextlib
import multiprocessing
import os
import select
import signal
import sys
import tempfile
import time
from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass
from itertools import takewhile
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerContext
from multiprocessing.process import BaseProcess
from multiprocessing.util import get_temp_dir
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from types import ModuleType

from contactlab.pipeline.following import follow_parent
from contactlab.pipeline.job import Job, Lost, Result, Task
from contactlab.pipeline.stop import Stop

_PRELOAD = ["contactlab.pipeline.attempt"]
_WISHES = {signal.SIGINT, signal.SIGTERM}
# Of a folder's path, where 32 characters more and an end must fit into the 108 of an address.
_LONGEST = 75
# Of a traceback.
_MOST_LINES = 6
# How long a wish to stop that comes without a signal may go unnoticed [s].
_GLANCE = 0.1
# How often a process is started where the fork server is ending.
_TRIES = 20


@dataclass
class _Slot:
    """A worker, the job that it is on, and whether it was told to end that soon."""

    process: BaseProcess
    pipe: Connection
    marker: Path
    job: Job
    told: bool = False


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
        context = _context()
        slots: list[_Slot] = []
        with TemporaryDirectory(prefix="contactlab-") as folder:
            try:
                for number in range(self.workers):
                    if job := next(queue, None):
                        marker = Path(folder) / str(number)
                        _start(slots, context, task, marker, job)
                while slots:
                    yield from _next_results(context, task, slots, queue, stop)
            finally:
                _stop(slots)


class KeptWorker:
    """One worker, kept between jobs, for who is given them one at a time."""

    def __init__(self, task: Task, marker: Path) -> None:
        self._task = task
        self._marker = marker
        self._slots: list[_Slot] = []

    def run(self, job: Job, stop: Stop) -> Result:
        """Return what comes of a job; once `stop` is set, perhaps of a part of its runs."""
        if self._slots:
            self._slots[0].job = job
            _send(self._slots[0], job)
        else:
            _start(self._slots, _context(), self._task, self._marker, job)
        (slot,) = self._slots
        while not wait([slot.pipe], _GLANCE):
            if stop.is_set:
                _tell_to_end(self._slots)
        try:
            result = _receive(slot)
        finally:
            self._marker.unlink(missing_ok=True)
        if slot.told or isinstance(result, Lost):
            self.end()
        return result

    def end(self) -> None:
        """End the worker, whatever it is on."""
        _stop(self._slots)
        self._slots.clear()


def _context() -> ForkServerContext:
    _place_sockets()
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_PRELOAD)
    return context


def _place_sockets() -> None:
    """Choose where the fork server's socket lies; the system takes short paths only.

    It would lie in the temporary folder, whose name a batch system may make long.
    """
    chosen = gettempdir()
    if len(chosen) > _LONGEST:
        tempfile.tempdir = "/tmp"  # noqa: S108 - a private folder is made in it
        try:
            get_temp_dir()
        finally:
            tempfile.tempdir = chosen


def _run_here(task: Task, jobs: Iterable[Job], stop: Stop) -> Iterator[Result]:
    from contactlab.pipeline.worker import Worker  # noqa: PLC0415 - it loads the engine

    worker = Worker(task, None, lambda: not stop.is_set)
    for job in jobs:
        yield worker.run(job)


def _next_results(
    context: ForkServerContext,
    task: Task,
    slots: list[_Slot],
    queue: Iterator[Job],
    stop: Stop,
) -> Iterator[Result]:
    """Wait for workers; give each its next job, or let it go when there is none."""
    stopping = stop.is_set
    if stopping:
        _tell_to_end(slots)
    ready = set(wait([*(slot.pipe for slot in slots), *([] if stopping else [stop.fileno()])]))
    for slot in [slot for slot in slots if slot.pipe in ready]:
        result = _receive(slot)
        job = next(queue, None)
        if isinstance(result, Lost):
            slots.remove(slot)
            if job is not None:
                _start(slots, context, task, slot.marker, job)
        elif job is not None:
            slot.job = job
            _send(slot, job)
        else:
            _stop([slot])
            slots.remove(slot)
        yield result


def _tell_to_end(slots: Iterable[_Slot]) -> None:
    """Have workers end their jobs after the run that each is on."""
    for slot in slots:
        if not slot.told:
            slot.told = True
            _send(slot, None)


def _receive(slot: _Slot) -> Result:
    try:
        received = slot.pipe.recv()
    except (EOFError, OSError):
        slot.process.join()
        slot.pipe.close()
        trace = slot.marker.read_text(encoding="utf-8") if slot.marker.is_file() else ""
        return Lost(slot.job, _death(slot.process.exitcode, trace), timed_out=bool(trace))
    if isinstance(received, Exception):
        raise received
    if isinstance(received, Lost):
        # It lives, but its memory is full of what it was on.
        _stop([slot])
    return received


def _death(exitcode: int | None, trace: str) -> str:
    if trace:
        return " / ".join(line.strip() for line in trace.splitlines()[:_MOST_LINES])
    if exitcode is not None and exitcode < 0:
        return f"the worker was ended by {signal.Signals(-exitcode).name}"
    return f"the worker exited with code {exitcode}"


def _start(
    slots: list[_Slot], context: ForkServerContext, task: Task, marker: Path, job: Job
) -> None:
    """Start a worker on a job; no signal comes between its start and its place among the others."""
    marker.unlink(missing_ok=True)
    with _undisturbed(), _without_main():
        ours, theirs = context.Pipe()
        arguments = (task, theirs, marker, dict(os.environ))
        process = context.Process(target=_serve, args=arguments, daemon=True)
        _launch(process)
        theirs.close()
        slots.append(_Slot(process, ours, marker, job))
    _send(slots[-1], job)


def _launch(process: BaseProcess) -> None:
    """Start a process; if the fork server was just killed, by the one that takes its place."""
    for _ in range(_TRIES):
        with contextlib.suppress(ConnectionRefusedError):
            process.start()
            return
        time.sleep(_GLANCE)
    process.start()


def _send(slot: _Slot, message: Job | None) -> None:
    """Send a worker a job, or that it should end soon; one that just died is noticed later."""
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        slot.pipe.send(message)


@contextlib.contextmanager
def _undisturbed() -> Generator[None]:
    """Hold back wishes to stop, also from processes that start meanwhile, for all of their lives.

    A terminal's Ctrl-C and a batch system's SIGTERM reach every process; workers are stopped by
    the one that started them.
    """
    # Its own start ends with signals let through; nothing happens where it runs already.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _WISHES)
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
    """End workers, whatever they are on."""
    with _undisturbed():
        for slot in slots:
            slot.pipe.close()
            slot.process.kill()
        for slot in slots:
            slot.process.join()


def _serve(task: Task, pipe: Connection, marker: Path, environment: dict[str, str]) -> None:
    """Run jobs until the pipe closes; a worker never outlives its parent."""
    # The fork server has that of the time when it was started.
    os.environ.update(environment)
    from contactlab.pipeline.attempt import attempt  # noqa: PLC0415 - it loads the engine
    from contactlab.pipeline.worker import Worker  # noqa: PLC0415 - as does this

    signal.pthread_sigmask(signal.SIG_BLOCK, _WISHES)
    follow_parent()
    with contextlib.suppress(OSError):
        # Where memory runs out, Linux should end a worker, not the command.
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="utf-8")
    waiting = select.poll()
    waiting.register(pipe, select.POLLIN)
    worker = Worker(task, marker, lambda: not waiting.poll(0))
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while (job := pipe.recv()) is not None:
            pipe.send(attempt(worker, job))
