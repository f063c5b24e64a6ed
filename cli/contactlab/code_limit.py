"""The time that code of a user may take before its runs; each run has its own `timeout`."""

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

SECONDS = 120.0
"""Time for a factory, a policy's file or a plug-in to load, and for making a policy [s]."""


class _TooLongError(BaseException):
    """Passes the `except Exception` of the code that takes too long."""


@contextmanager
def code_limit() -> Generator[None]:
    """End code of a user that takes too long by a TimeoutError, where Python gets a turn.

    There is no limit in threads, which get no signals, nor where another limit holds already.
    """
    is_limited = signal.getitimer(signal.ITIMER_REAL)[0] > 0
    if is_limited or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGALRM, _raise_timeout)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        yield
    except _TooLongError as error:
        said = TimeoutError(f"it did not return within {SECONDS:g} s")
        # It was there.
        raise said.with_traceback(error.__traceback__) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _raise_timeout(_number: int, _frame: FrameType | None) -> NoReturn:
    raise _TooLongError
