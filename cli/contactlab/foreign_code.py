"""Code of a user: limited in time, and its output shown as text.

A run has its own `timeout`; the limit here holds before runs, as a plug-in loads.
"""

import io
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Generator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, BinaryIO, NoReturn, TextIO

from contactlab.printable import printable

SECONDS = 120.0
"""Time for a factory, a policy's file or a plug-in to load, and for making a policy [s]."""
_PRINTED_BYTES = 1 << 16
"""Bytes of printed text that are shown at a time: a page of a log, not a full disk."""


class _TooLongError(BaseException):
    """Passes the `except Exception` of the code that takes too long."""


def ends_command(error: BaseException) -> bool:
    """Return whether an exception is not the code's: Ctrl-C, or too little memory.

    Where Ctrl-C is blocked, as in workers, only code raises KeyboardInterrupt.
    """
    if isinstance(error, KeyboardInterrupt):
        return signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    return isinstance(error, MemoryError)


@contextmanager
def code_limit() -> Generator[None]:
    """End code of a user that takes too long by a TimeoutError, where Python gets a turn.

    Code that catches everything ends the process, after five attempts. There is no limit in
    threads, which get no signals, nor where another limit holds already.
    """
    is_limited = signal.getitimer(signal.ITIMER_REAL)[0] > 0
    if is_limited or threading.current_thread() is not threading.main_thread():
        yield
        return
    attempts = iter(range(5))

    def raise_timeout(_number: int, _frame: FrameType | None) -> NoReturn:
        if next(attempts, None) is None:
            os.write(2, b"error: code of a plug-in, policy or environment does not end\n")
            os._exit(2)
        raise _TooLongError

    before = signal.signal(signal.SIGALRM, raise_timeout)
    signal.setitimer(signal.ITIMER_REAL, SECONDS, min(SECONDS, 1.0))
    try:
        yield
    except _TooLongError as error:
        timeout_error = TimeoutError(f"it did not return within {SECONDS:g} s")
        # It was there.
        raise timeout_error.with_traceback(error.__traceback__) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


class PrintedFile:
    """A file that stands for stdout and stderr while code runs, until it is shown as text."""

    def __init__(self) -> None:
        self.file: BinaryIO = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 - kept

    def take_text(self) -> str:
        """Return its content as text that nothing obeys, of limited size; and empty it."""
        size = self.file.seek(0, io.SEEK_END)
        if not size:
            return ""
        text = os.pread(self.file.fileno(), _PRINTED_BYTES, 0).decode(errors="replace")
        text = printable(text.replace("\r\n", "\n")).removesuffix("\n") + "\n"
        if size > _PRINTED_BYTES:
            text += f"({size - _PRINTED_BYTES:,} more bytes of printed text are left out)\n"
        self.file.truncate(0)
        self.file.seek(0)
        return text

    def receive_output(self) -> None:
        """Let all that this process prints, also in C, end in this file."""
        for number in (1, 2):
            os.dup2(self.file.fileno(), number)


class _StreamByThread:
    """The stream of one thread, and another one for the others, such as a progress display.

    Loggers that code makes keep it: after its end it is the stderr of then.
    """

    def __init__(self, own: TextIO, others: TextIO) -> None:
        self._own, self._others, self._thread = own, others, threading.get_ident()
        self.has_ended = False

    def __getattr__(self, name: str) -> object:
        if self.has_ended:
            return getattr(sys.stderr, name)
        stream = self._own if threading.get_ident() == self._thread else self._others
        return getattr(stream, name)


_shown = threading.Lock()


@contextmanager
def printed_as_text() -> Generator[None]:
    """Show printed output on stderr at the end, as text that nothing obeys and of limited size.

    Output of programs that code starts, and of libraries in C, is included. Within another such
    context, without both streams, and in threads, nothing changes.
    """
    before = list[int]()
    with suppress(OSError):
        before += [os.dup(number) for number in (1, 2)]
    main = threading.current_thread() is threading.main_thread()
    if not before or not main or not _shown.acquire(blocking=False):
        for number in before:
            os.close(number)
        yield
        return
    streams = sys.stdout, sys.stderr
    output_file = PrintedFile()
    with suppress(OSError, ValueError):
        for stream in streams:
            stream.flush()
    own = open(os.dup(output_file.file.fileno()), "w", errors="replace", buffering=1)  # noqa: PTH123, SIM115 - a descriptor
    others = streams[1]
    with suppress(OSError, ValueError):
        if others.fileno() == 2:
            others = open(os.dup(2), "w", errors="replace", buffering=1)  # noqa: PTH123, SIM115 - as above
    streams_by_thread: Any = _StreamByThread(own, others)
    sys.stdout = sys.stderr = streams_by_thread
    output_file.receive_output()
    try:
        yield
    finally:
        with suppress(OSError, ValueError):
            own.close()
        for number, saved_file in enumerate(before, 1):
            os.dup2(saved_file, number)
        sys.stdout, sys.stderr = streams
        streams_by_thread.has_ended = True
        with suppress(OSError, ValueError):
            streams[1].write(output_file.take_text())
        if others is not streams[1]:
            others.close()
        for saved_file in before:
            os.close(saved_file)
        output_file.file.close()
        _shown.release()


@contextmanager
def kept_folder() -> Generator[None]:
    """Return to the current folder, which code may leave: relative paths of a store start there."""
    try:
        folder = os.open(".", os.O_RDONLY | os.O_CLOEXEC)
    except OSError:  # it is removed, or unreadable
        yield
        return
    try:
        yield
    finally:
        with suppress(OSError):
            os.fchdir(folder)
        os.close(folder)


@contextmanager
def limited_code() -> Generator[None]:
    """Limit code in time, show its output as text, and return to the current folder.

    See `code_limit`, `printed_as_text` and `kept_folder`.
    """
    with kept_folder(), printed_as_text(), code_limit():
        yield
