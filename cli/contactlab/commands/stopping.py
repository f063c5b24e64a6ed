"""Ctrl-C and SIGTERM: the first lets the current runs finish, the second stops at once."""

import os
import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from contactlab.commands.terminal import progress_display, say
from contactlab.errors import StoppedError

if TYPE_CHECKING:
    from contactlab.run.tasks import Stop
    from contactlab.studies.session import Session

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_STOPPING = b"finishing the current runs; interrupt again to stop at once\n"


@contextmanager
def resumable(then: str = "resume") -> Generator["Stop"]:
    """Yield what Ctrl-C and SIGTERM set; an early end says what the same command would do next."""
    from contactlab.run.tasks import Stop

    stop = Stop()
    try:
        with stop_on_signals(stop):
            yield stop
    except (KeyboardInterrupt, StoppedError) as error:
        say(f"interrupted; run the same command again to {then}")
        raise typer.Exit(StoppedError.exit_code) from error


@contextmanager
def study_session(
    folder: Path, workers: int | None, then: str = "resume", *, allow_code: bool = False
) -> Generator["Session"]:
    """Yield a session that shows its progress on stderr and stops on Ctrl-C and SIGTERM."""
    from contactlab.run.worker_pool import worker_count
    from contactlab.studies.session import Session

    count = worker_count(workers)
    with resumable(then) as stop, progress_display() as display:
        yield Session(folder, count, display.begin, display.advance, say, stop, allow_code)


@contextmanager
def stop_on_signals(stop: "Stop") -> Generator[None]:
    """Turn the first Ctrl-C or SIGTERM into a request to stop, while runs that heed it go on.

    At other times, and the second time, they raise KeyboardInterrupt. A signal that is ignored
    stays so: a shell ignores Ctrl-C for what it runs in the background. Only the main thread
    receives signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    handled = [number for number, handler in before.items() if handler is not signal.SIG_IGN]

    def handle(*_: object) -> None:
        again = stop.is_set or not stop.is_watched
        # An exception may get lost, as in a finalizer; the request stays.
        stop.set()
        if again:
            raise KeyboardInterrupt
        # Past all buffers: it may have come while one was written. On a terminal the cursor stands
        # behind the live display.
        with suppress(OSError):
            os.write(2, ("\n" if os.isatty(2) else "").encode() + _STOPPING)

    for number in handled:
        signal.signal(number, handle)
    try:
        yield
    finally:
        for number in handled:
            signal.signal(number, before[number])
