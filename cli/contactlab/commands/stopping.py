"""Signals that end a sweep: the first lets the runs in flight end, the second does not wait."""

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from contactlab.run import Stop

_WISHES = (signal.SIGINT, signal.SIGTERM)
_SAID = "finishing the runs in flight; again to stop at once\n"

Handler = Callable[[int, FrameType | None], None]


@contextmanager
def obeying(stop: "Stop") -> Generator[None]:
    """Turn Ctrl-C and SIGTERM into a wish to stop, where runs are under way that heed it.

    Elsewhere, and the second time, they raise KeyboardInterrupt. A signal that is ignored, as
    Ctrl-C is by what a shell runs in the background, stays so; only a main thread hears any.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _WISHES}
    heard = [number for number, handler in before.items() if handler is not signal.SIG_IGN]
    for number in heard:
        signal.signal(number, _handler(stop))
    try:
        yield
    finally:
        for number in heard:
            signal.signal(number, before[number])


def _handler(stop: "Stop") -> Handler:
    def handle(number: int, frame: FrameType | None) -> None:
        del number, frame
        again = stop.is_set or not stop.is_heeded
        # Where an exception gets lost, as in a finalizer, the wish stays.
        stop.set()
        if again:
            raise KeyboardInterrupt
        _say()

    return handle


def _say() -> None:
    """Say that the first signal was heard, past all buffers, in which it may have come."""
    # On a terminal the cursor stands behind the live display.
    begin = "\n" if os.isatty(2) else ""
    with contextlib.suppress(OSError):
        os.write(2, (begin + _SAID).encode())
