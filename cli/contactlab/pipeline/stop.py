"""A wish to stop soon, which whoever waits for workers can wait for as well."""

from multiprocessing import Pipe


class Stop:
    """Set once, from a signal handler or another thread; then runs in flight end and no more begin.

    It can be waited for beside pipes, since it has a `fileno`.
    """

    def __init__(self) -> None:
        self._reader, self._writer = Pipe(duplex=False)
        self._wished = False

    @property
    def is_set(self) -> bool:
        """Whether to stop."""
        return self._wished

    def set(self) -> None:
        """Wish to stop; safe in a signal handler."""
        if not self._wished:
            self._wished = True
            self._writer.send_bytes(b"stop")

    def fileno(self) -> int:
        """Return what becomes readable when it is set."""
        return self._reader.fileno()
