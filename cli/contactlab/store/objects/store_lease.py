"""Who holds the lock of a store, and whether it is known to be gone."""

import logging
import os
import socket
import threading
import time
import uuid
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from contactlab.errors import ContactlabError, OutputError
from contactlab.store.objects.object_client import ObjectClient, ObjectVersion, StoredObject

_BOOT = Path("/proc/sys/kernel/random/boot_id")
_PIDS = Path("/proc/self/ns/pid")


class LockHolder(BaseModel):
    """A process that writes a store, as the lock names it.

    Attributes:
        id: random; another for each time that the lock is taken.
        host: the machine's name, for people.
        machine: tells machines, their boots and their process spaces apart.
        pid: the process.
        started: when it was started, in ticks since the machine's boot; tells it from a later
            process with the same number.
        beat: grows each time that the lock is renewed.
        released: whether the lock was given back.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str
    host: str
    machine: str
    pid: int
    started: int
    beat: int = 0
    released: bool = False

    @classmethod
    def this(cls) -> "LockHolder":
        """Return this process."""
        return cls(
            id=uuid.uuid4().hex,
            host=socket.gethostname(),
            machine=_machine(),
            pid=os.getpid(),
            started=_started(os.getpid()) or 0,
        )

    @classmethod
    def read(cls, data: bytes) -> "LockHolder | None":
        """Return whom a lock names; None if it cannot be read."""
        try:
            return cls.model_validate_json(data)
        except ValidationError:
            return None

    @property
    def is_here(self) -> bool:
        """Whether it is, or was, a process of this machine that could be seen from here."""
        return self.machine == _machine()

    @property
    def is_gone(self) -> bool:
        """Whether it gave the lock back, or was a process here that has ended."""
        return self.released or (self.is_here and _started(self.pid) != self.started)

    def encoded(self) -> bytes:
        """Return it as an object holds it."""
        return self.model_dump_json().encode()


def _machine() -> str:
    try:
        return f"{_BOOT.read_text(encoding='utf-8').strip()} {_PIDS.readlink()}"
    except OSError:
        return socket.gethostname()


def _started(pid: int) -> int | None:
    """Return when a process was started; None if there is none."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    # The name of the process, in brackets, may hold anything.
    fields = stat.rpartition(")")[2].split()
    return None if fields[0] == "Z" else int(fields[19])


LOCK = ".lock"
LEASE = 30.0
"""How long a lock of another machine must stay as it is before it is taken over [s]."""
_RENEWALS = 6
"""How often a lock is renewed in that time."""
_PATIENCE = 5.0
"""How long giving a lock back may take, where the server is slow or away [s]."""
_LOG = logging.getLogger(__name__)


class StoreLease:
    """A lock that is held and renewed by a thread; made by `leased`."""

    def __init__(
        self, client: ObjectClient, holder: LockHolder, version: ObjectVersion, seconds: float
    ) -> None:
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

    def _write(self, holder: LockHolder) -> None:
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
def hold_lease(client: ObjectClient, seconds: float | None = None) -> Generator[StoreLease]:
    """Hold the lock of a store.

    Args:
        client: where the store lies.
        seconds: how long a lock of another machine must stay as it is; LEASE if left out.

    Raises:
        OutputError: another sweep holds it, or the server cannot be reached.
    """
    seconds = LEASE if seconds is None else seconds
    holder = LockHolder.this()
    lease = StoreLease(client, holder, _taken(client, holder, seconds), seconds)
    try:
        yield lease
    finally:
        lease.release()


def _taken(client: ObjectClient, holder: LockHolder, seconds: float) -> ObjectVersion:
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


def _wait_for(client: ObjectClient, there: StoredObject, seconds: float) -> None:
    """Wait until a lock may be taken over.

    Only how long it stays as it is counts, by this machine's clock: others' may be wrong.

    Raises:
        OutputError: its holder is alive.
    """
    other = LockHolder.read(there.data)
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
            after = LockHolder.read(now.data) if now else None
            if now is None or (after is not None and after.is_gone):
                return
            raise OutputError(f"{client.address} is in use by a sweep {where}; wait or use -o")
