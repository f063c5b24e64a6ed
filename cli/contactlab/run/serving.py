"""What a worker process does, from its start to its end."""

import contextlib
import os
import select
import signal
from multiprocessing.connection import Connection
from pathlib import Path

from contactlab.run.following import follow_parent
from contactlab.run.forking import WISHES
from contactlab.run.job import Task


def serve(task: Task, pipe: Connection, marker: Path, environment: dict[str, str]) -> None:
    """Run jobs until the pipe closes; a worker never outlives its parent."""
    # The fork server has that of the time when it was started.
    os.environ.update(environment)
    from contactlab.run.attempt import attempt  # noqa: PLC0415 - it loads the engine
    from contactlab.run.worker import Worker  # noqa: PLC0415 - as does this

    signal.pthread_sigmask(signal.SIG_BLOCK, WISHES)
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
