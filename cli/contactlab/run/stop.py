"""A wish to stop soon, which whoever waits for workers can wait for as well."""

from collections.abc import Generator
from contextlib import contextmanager
from multiprocessing import Pipe


class Stop:
    """Set once, from a signal handler or another thread; then runs in flight end and no more begin.

    It can be waited for beside pipes, since it has a `fileno`.
    """

    def __init__(self) -> None:
        self._reader, self._writer = Pipe(duplex=False)
        self._wished = self._heeded = False

    @property
    def is_set(self) -> bool:
        """Whether to stop."""
        return self._wished

    @property
    def is_heeded(self) -> bool:
        """Whether runs are under way that end by themselves once it is set."""
        return self._heeded

    def set(self) -> None:
        """Wish to stop; safe in a signal handler."""
        if not self._wished:
            self._wished = True
            self._writer.send_bytes(b"stop")

    @contextmanager
    def heeded(self) -> Generator[None]:
        """Say that it is looked at for as long as this lasts."""
        self._heeded = True
        try:
            yield
        finally:
            self._heeded = False

    def fileno(self) -> int:
        """Return what becomes readable when it is set."""
        return self._reader.fileno()
