"""One worker process, seen from the one that started it."""

import contextlib
import os
import signal
from collections.abc import Iterable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext
from multiprocessing.process import BaseProcess
from pathlib import Path

from contactlab.run.forking import launch, undisturbed
from contactlab.run.job import Job, Lost, Result, Task
from contactlab.run.serving import serve

# Of a traceback.
_MOST_LINES = 6


@dataclass
class Slot:
    """A worker, the job that it is on, and whether it was told to end that soon."""

    process: BaseProcess
    pipe: Connection
    marker: Path
    job: Job
    told: bool = False


def start(
    slots: list[Slot], context: ForkServerContext, task: Task, marker: Path, job: Job
) -> None:
    """Start a worker on a job; no signal comes between its start and its place among the others."""
    marker.unlink(missing_ok=True)
    with undisturbed():
        ours, theirs = context.Pipe()
        arguments = (task, theirs, marker, dict(os.environ))
        process = context.Process(target=serve, args=arguments, daemon=True)
        launch(process)
        theirs.close()
        slots.append(Slot(process, ours, marker, job))
    send(slots[-1], job)


def send(slot: Slot, message: Job | None) -> None:
    """Send a worker a job, or that it should end soon; one that just died is noticed later."""
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        slot.pipe.send(message)


def tell_to_end(slots: Iterable[Slot]) -> None:
    """Have workers end their jobs after the run that each is on."""
    for slot in slots:
        if not slot.told:
            slot.told = True
            send(slot, None)


def receive(slot: Slot) -> Result:
    """Return what a worker sends, or that it died.

    Raises:
        Exception: what went wrong there, which should end the sweep.
    """
    try:
        received = slot.pipe.recv()
    except (EOFError, OSError):
        slot.process.join()
        slot.pipe.close()
        trace = slot.marker.read_text(encoding="utf-8") if slot.marker.is_file() else ""
        timed_out = bool(trace) or slot.process.exitcode == -signal.SIGALRM
        return Lost(slot.job, _death(slot.process.exitcode, trace), timed_out)
    if isinstance(received, Exception):
        raise received
    if isinstance(received, Lost):
        # It lives, but its memory is full of what it was on.
        end([slot])
    return received


def _death(exitcode: int | None, trace: str) -> str:
    if trace:
        return " / ".join(line.strip() for line in trace.splitlines()[:_MOST_LINES])
    if exitcode is not None and exitcode < 0:
        return f"the worker was ended by {signal.Signals(-exitcode).name}"
    return f"the worker exited with code {exitcode}"


def end(slots: list[Slot]) -> None:
    """End workers, whatever they are on."""
    with undisturbed():
        for slot in slots:
            slot.pipe.close()
            slot.process.kill()
        for slot in slots:
            slot.process.join()
