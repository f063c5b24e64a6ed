"""What a worker process does, from its start to its end."""

import contextlib
import fcntl
import multiprocessing
import os
import re
import select
import signal
import threading
from multiprocessing.connection import Connection
from pathlib import Path

from contactlab.errors import ContactlabError
from contactlab.run.tasks import Crashed, Job, Result, Task
from contactlab.run.worker import Worker

STOP_SIGNALS = frozenset({signal.SIGINT, signal.SIGTERM})
# As the engine, zstandard and the operating system put it.
_NO_MEMORY = re.compile("(allocate|not enough|out of) memory", re.IGNORECASE)


def serve_jobs(task: Task, pipe: Connection, marker: Path, environment: dict[str, str]) -> None:
    """Run jobs until the pipe closes or None arrives; a worker never outlives its parent.

    Args:
        task: what the jobs have in common.
        pipe: brings jobs and takes their results.
        marker: the file that gets a traceback when a run times out.
        environment: variables of the process that started this one; the fork server's are those
            of the time when it was started.
    """
    os.environ.update(environment)
    signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    _exit_with_parent()
    with contextlib.suppress(OSError):
        # Where memory runs out, Linux should kill a worker, not the command.
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="utf-8")
    poll = select.poll()
    poll.register(pipe, select.POLLIN)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        try:
            worker = Worker(task, marker, lambda: not poll.poll(0))
        except ContactlabError as error:
            pipe.recv()
            pipe.send(error)
            return
        while (job := pipe.recv()) is not None:
            pipe.send(run_job(worker, job))


def run_job(worker: Worker, job: Job) -> Result | Exception:
    """Return a job's results, or why there are none.

    Returns:
        Its results; or the job as crashed if memory did not suffice, which may not happen again in
        another process or with fewer runs at once; or the error, which should end the sweep.
    """
    try:
        return worker.run(job)
    except Exception as error:  # noqa: BLE001 - raised again in the process that sent the job
        if isinstance(error, MemoryError) or _NO_MEMORY.search(str(error)):
            return Crashed(job, f"out of memory: {_one_line(error)}", timed_out=False)
        return error


def _one_line(error: Exception) -> str:
    return " / ".join(str(error).split("\n")) or "the worker can have no more"


def _exit_with_parent() -> None:
    """Have this process end as soon as its parent (not the fork server) has ended.

    Even in the middle of a long call into C code, where the kernel can do it.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None
    _kill_on_close(parent.sentinel)
    threading.Thread(target=_wait_and_exit, daemon=True).start()


def _kill_on_close(pipe: int) -> None:
    """Have the kernel kill this process when the pipe's other end closes.

    Python itself gets no turn as long as C code holds its lock.
    """
    if hasattr(fcntl, "F_SETSIG"):
        fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)


def _wait_and_exit() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
