"""Runs jobs on worker processes, one job each; a worker that dies loses only its job.

Each worker has a private pipe, and its end is the only sign of the worker's death: a shared queue
would break, or hang, with the process that holds its lock. Workers are forked from a server that
has loaded their modules, and signals to the command do not reach them.
"""

import contextlib
import fcntl
import multiprocessing
import os
import re
import select
import signal
import sys
import threading
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from itertools import count, islice, takewhile
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerContext, SpawnContext
from multiprocessing.process import BaseProcess
from pathlib import Path

from contactlab.engines.engine import no_limit
from contactlab.errors import (
    CommandLineError,
    ContactlabError,
    OutputError,
    error_text,
    in_one_line,
)
from contactlab.foreign_code import PrintedFile, ends_command, printed_as_text
from contactlab.printable import shorten_warnings
from contactlab.run.fork_server import CONTEXT, STOP_SIGNALS, signals_blocked, start_process
from contactlab.run.tasks import CrashedJob, Job, Result, Stop, Task
from contactlab.run.worker import Worker
from contactlab.temporary_folders import names_temporary_file, temporary_folder

Context = ForkServerContext | SpawnContext
# Messages of the engine, zstandard and the operating system.
_NO_MEMORY = re.compile("(allocate|not enough|out of) memory", re.IGNORECASE)
_MAX_HALTED_CHECKS = 3
_HALTED_REASON = "the worker was halted, as by SIGSTOP, and did not go on"
# Largest delay until a stop request is noticed [s]: on a cluster it comes without a signal.
_STOP_INTERVAL = 0.1


def worker_count(requested: int | None) -> int:
    """Return the number of worker processes: as requested, or one per available core."""
    most = 4096  # processes, more than any machine has cores
    if requested is not None and requested > most:
        raise CommandLineError(f"--workers {requested}: write at most {most:,}")
    if requested is not None:
        return requested
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(frozen=True)
class LocalPool:
    """Worker processes of this machine."""

    workers: int  # processes; 0 runs everything in this one, without protection from crashes
    context: Context | None = None  # starts them; by default the fork server

    def run(self, task: Task, jobs: Iterable[Job], stop: Stop) -> Iterator[Result]:
        """Yield the results of jobs as they finish; see `Executor`."""
        if self.workers == 0:
            worker = Worker(task, None, lambda: not stop.is_set)
            for job in takewhile(lambda _: not stop.is_set, jobs):
                with printed_as_text() if _runs_code(task) else contextlib.nullcontext():
                    result = _run_job(worker, job)
                if isinstance(result, Exception):
                    raise result
                yield result
            return
        with (
            temporary_folder() as folder,
            contextlib.closing(WorkerPool(task, Path(folder), self.workers, self.context)) as pool,
        ):
            yield from pool.run_jobs(jobs, stop)


class WorkerPool:
    """Worker processes of a task, which are started on demand and kept between jobs."""

    def __init__(self, task: Task, folder: Path, most: int, context: Context | None = None) -> None:
        self._task, self._context = task, context or CONTEXT
        self._markers = [folder / str(number) for number in range(most)]
        self._workers: dict[Path, WorkerHandle] = {}

    def run_jobs(self, jobs: Iterable[Job], stop: Stop) -> Iterator[Result]:
        """Yield the results of jobs as they finish; see `Executor`."""
        queue, silent = takewhile(lambda _: not stop.is_set, jobs), count(1)
        for marker, job in zip(self._markers, islice(queue, len(self._markers)), strict=False):
            self._send_job(marker, job)
        silent_intervals = 20  # two seconds: a check reads a file of each worker
        while busy := [worker for worker in self._workers.values() if worker.job is not None]:
            if stop.is_set:
                request_stop(busy)
            ready = wait([worker.pipe for worker in busy], _STOP_INTERVAL)
            if not ready and next(silent) % silent_intervals == 0:
                end_halted(busy)
            for worker in [candidate for candidate in busy if candidate.pipe in ready]:
                result = receive_result(worker)
                if worker.stop_requested or isinstance(result, CrashedJob):
                    close([worker])
                    del self._workers[worker.marker]
                if (job := next(queue, None)) is not None:
                    self._send_job(worker.marker, job)
                yield result

    def _send_job(self, marker: Path, job: Job) -> None:
        if worker := self._workers.get(marker):
            send_job(worker, job)
        else:
            start_worker(self._workers, self._task, marker, job, self._context)

    def close(self) -> None:
        """Kill the workers, whatever they are doing."""
        close(self._workers.values())
        self._workers.clear()


@dataclass
class WorkerHandle:
    """A worker process with a pipe that takes jobs and returns results."""

    process: BaseProcess
    pipe: Connection
    marker: Path  # the file where the worker writes a traceback when a run times out
    job: Job | None = None  # its current job; None while it waits for one
    stop_requested: bool = False
    halted: int = 0  # number of checks in a row that found it halted, as by SIGSTOP


def start_worker(
    workers: dict[Path, WorkerHandle], task: Task, marker: Path, job: Job, context: Context
) -> None:
    """Start a worker on a job, and add it to the others before a signal can intervene."""
    marker.unlink(missing_ok=True)
    environment = dict(os.environ)
    with signals_blocked():
        ours, theirs = context.Pipe()
        arguments = (task, theirs, marker, environment)
        process = context.Process(target=_serve_jobs, args=arguments, daemon=True)
        start_process(process)
        theirs.close()
        workers[marker] = WorkerHandle(process, ours, marker)
    send_job(workers[marker], job)


def send_job(worker: WorkerHandle, job: Job | None) -> None:
    """Send a job to a worker, or None to stop it; a worker that has just died is noticed later."""
    worker.job = job or worker.job
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        worker.pipe.send(job)


def request_stop(workers: Iterable[WorkerHandle]) -> None:
    """Ask workers to stop, each after its current run."""
    for worker in workers:
        if not worker.stop_requested:
            worker.stop_requested = True
            send_job(worker, None)


def end_halted(workers: Iterable[WorkerHandle]) -> None:
    """Kill workers that were halted at the third check in a row: they may never answer.

    Suspending the whole command, as by Ctrl-Z, also suspends the process that checks.
    """
    for worker in [candidate for candidate in workers if candidate.halted < _MAX_HALTED_CHECKS]:
        status = ""
        with contextlib.suppress(OSError):
            place = Path(f"/proc/{worker.process.pid}/stat")
            status = place.read_text(encoding="utf-8", errors="replace")
        # The name of the process, in brackets, may contain any characters; T is a halted one.
        is_halted = status.rpartition(")")[2].split()[:1] == ["T"]
        worker.halted = worker.halted + 1 if is_halted else 0
        if worker.halted == _MAX_HALTED_CHECKS:
            worker.process.kill()


def receive_result(worker: WorkerHandle) -> Result:
    """Return a worker's result, or its job as crashed if it died. Raises the error of the job."""
    job, worker.job = worker.job, None
    assert job is not None
    try:
        result = worker.pipe.recv()
    except (EOFError, OSError):
        worker.process.join()
        worker.pipe.close()
        marker = worker.marker
        traceback = marker.read_text(encoding="utf-8") if marker.is_file() else ""
        code = worker.process.exitcode
        if worker.halted >= _MAX_HALTED_CHECKS:
            reason = _HALTED_REASON
        elif traceback:
            most_lines = 6  # the innermost calls; a log has all
            reason = " / ".join(line.strip() for line in traceback.splitlines()[:most_lines])
        elif code is not None and code < 0:
            reason = f"the worker was ended by {signal.Signals(-code).name}"
        else:
            reason = f"the worker exited with code {code}"
        return CrashedJob(job, reason, bool(traceback) or code == -signal.SIGALRM)
    if isinstance(result, Exception):
        raise result
    return result


def close(workers: Collection[WorkerHandle]) -> None:
    """Kill workers, whatever they are doing, and wait for them."""
    with signals_blocked():
        for worker in workers:
            worker.pipe.close()
            worker.process.kill()
        for worker in workers:
            worker.process.join()


def _serve_jobs(task: Task, pipe: Connection, marker: Path, environment: dict[str, str]) -> None:
    """Run jobs until the pipe closes or None arrives; a worker never outlives its parent.

    The environment is that of the process that started this one, because the fork server's is from
    its own start. The marker gets a traceback when a run times out.
    """
    os.environ.update(environment)
    shorten_warnings(names_temporary_file)
    signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    # This process ends as soon as its parent (not the fork server) has ended.
    parent = multiprocessing.parent_process()
    assert parent is not None
    sentinel = parent.sentinel
    if hasattr(fcntl, "F_SETSIG"):
        # The kernel ends it, because Python code cannot run while C code holds its lock.
        fcntl.fcntl(sentinel, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(sentinel, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(sentinel, fcntl.F_SETFL, fcntl.fcntl(sentinel, fcntl.F_GETFL) | os.O_ASYNC)
    threading.Thread(target=_wait_and_exit, args=(parent,), daemon=True).start()
    with contextlib.suppress(OSError):
        # If memory runs out, Linux should kill a worker, not the command.
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="utf-8")
    poll = select.poll()
    poll.register(pipe, select.POLLIN)
    show = _printed_output() if _runs_code(task) else no_limit
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        try:
            worker = Worker(task, marker, lambda: not poll.poll(0))
        except ContactlabError as error:
            show()
            pipe.recv()
            pipe.send(error)
            return
        while (job := pipe.recv()) is not None:
            result = _run_job(worker, job)
            show()
            pipe.send(result)


def _runs_code(task: Task) -> bool:
    return bool(task.plugins or task.policy or task.environment)


def _printed_output() -> Callable[[], None]:
    # Output of code in this process reaches stderr as text, after each job.
    stderr, output_file = os.dup(2), PrintedFile()
    output_file.receive_output()

    def show_text() -> None:
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
            os.write(stderr, output_file.take_text().encode(errors="replace"))

    return show_text


def _run_job(worker: Worker, job: Job) -> Result | Exception:
    """Return a job's results, or the error that should end the sweep.

    Other errors are those of a run, or of a plug-in's engine: its job counts as crashed. It may
    succeed in another process or with fewer runs at once, as after a lack of memory.
    """
    try:
        return worker.run(job)
    except ContactlabError as error:
        return error
    except BaseException as error:
        message = error_text(error)
        if isinstance(error, MemoryError) or _NO_MEMORY.search(message):
            text = message.partition(": ")[2] or "the worker cannot get more"
            return CrashedJob(job, f"out of memory: {text}", timed_out=False)
        if ends_command(error):
            raise
        if isinstance(error, OSError):
            return OutputError(f"a worker cannot go on: {message}")
        return CrashedJob(job, in_one_line(error, __file__), timed_out=False)


def _wait_and_exit(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)
