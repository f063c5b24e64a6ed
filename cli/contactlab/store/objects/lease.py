"""The lock of a store in object storage: an object that whoever writes keeps renewing.

What is stored stays right without it: rows have names of their own, and the manifest is made
once. It keeps a second sweep from doing the same work.
"""

import logging
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress

from contactlab.errors import ContactlabError, OutputError
from contactlab.store.objects.client import Client, Found, Version
from contactlab.store.objects.holder import Holder

LOCK = ".lock"
LEASE = 30.0
"""How long a lock of another machine must stay as it is before it is taken over [s]."""
_RENEWALS = 6
"""How often a lock is renewed in that time."""
_PATIENCE = 5.0
"""How long giving a lock back may take, where the server is slow or away [s]."""
_LOG = logging.getLogger(__name__)


class Lease:
    """A lock that is held and renewed by a thread; made by `leased`."""

    def __init__(self, client: Client, holder: Holder, version: Version, seconds: float) -> None:
        self._client = client
        self._holder = holder
        self._version = version
        self._seconds = seconds
        self._lost = False
        self._ends = threading.Event()
        self._turn = threading.Lock()
        self._thread = threading.Thread(target=self._keep, daemon=True)
        self._thread.start()

    def check(self) -> None:
        """Check that nobody has taken the lock over, as far as is known.

        Raises:
            OutputError: somebody has.
        """
        if self._lost:
            raise OutputError(
                f"another sweep has taken {self._client.address} over; wait for it, or use -o"
            )

    def renew(self) -> None:
        """Renew the lock now.

        Raises:
            OutputError: somebody has taken it over, or the server cannot be reached.
        """
        with self._turn:
            self.check()
            self._write(self._holder.model_copy(update={"beat": self._holder.beat + 1}))
        self.check()

    def release(self) -> None:
        """Give the lock back; one that cannot be given back is taken over later."""
        self._ends.set()
        self._thread.join(_PATIENCE)

    def _write(self, holder: Holder) -> None:
        version = self._client.replace(LOCK, holder.encoded(), self._version)
        if version is None:
            self._lost = True
        else:
            self._holder, self._version = holder, version

    def _keep(self) -> None:
        while not self._ends.wait(self._seconds / _RENEWALS):
            # A server that is away for a moment is asked again; one that stays away is noticed
            # by whoever writes.
            with suppress(ContactlabError):
                self.renew()
        with suppress(ContactlabError), self._turn:
            self._write(self._holder.model_copy(update={"released": True}))


@contextmanager
def leased(client: Client, seconds: float | None = None) -> Generator[Lease]:
    """Hold the lock of a store.

    Args:
        client: where the store lies.
        seconds: how long a lock of another machine must stay as it is; LEASE if left out.

    Raises:
        OutputError: another sweep holds it, or the server cannot be reached.
    """
    seconds = LEASE if seconds is None else seconds
    holder = Holder.this()
    lease = Lease(client, holder, _taken(client, holder, seconds), seconds)
    try:
        yield lease
    finally:
        lease.release()


def _taken(client: Client, holder: Holder, seconds: float) -> Version:
    while True:
        version = client.create(LOCK, holder.encoded())
        if version is not None:
            return version
        there = client.find(LOCK)
        if there is None:
            continue
        _wait_for(client, there, seconds)
        version = client.replace(LOCK, holder.encoded(), there.version)
        if version is not None:
            return version


def _wait_for(client: Client, there: Found, seconds: float) -> None:
    """Wait until a lock may be taken over.

    Only how long it stays as it is counts, by this machine's clock: others' may be wrong.

    Raises:
        OutputError: its holder is alive.
    """
    other = Holder.read(there.data)
    if other is not None and other.is_gone:
        return
    if other is not None and other.is_here:
        raise OutputError(f"{client.address} is in use by process {other.pid}; wait or use -o")
    where = f"on {other.host}" if other else "of another version"
    _LOG.warning("%s was in use %s; waiting %.0f s for a sign", client.address, where, seconds)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(min(1.0, seconds / _RENEWALS))
        now = client.find(LOCK)
        if now is None or now.version != there.version:
            after = Holder.read(now.data) if now else None
            if now is None or (after is not None and after.is_gone):
                return
            raise OutputError(f"{client.address} is in use by a sweep {where}; wait or use -o")
