"""The lock of a store in object storage: an object that its holder keeps renewing.

The store stays correct without it, because rows have unique names and the manifest is created once.
The lock keeps a second sweep from doing the same work.
"""

import logging
import os
import socket
import threading
import time
import uuid
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict, ValidationError

from contactlab.errors import ContactlabError, OutputError
from contactlab.store.store_files import LOCK

if TYPE_CHECKING:
    from obstore import UpdateVersion

    from contactlab.store.objects.client import ObjectClient, StoredObject

LEASE = 30.0  # an unchanged lock of another machine is taken over after this time [s]
_RENEWALS = 6  # number of renewals of a lock in that time
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
_PID_NAMESPACE = Path("/proc/self/ns/pid")
_LOG = logging.getLogger(__name__)


class LockHolder(BaseModel):
    """The process that holds a store's lock, as written in the lock object."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str  # random; a new one each time the lock is taken
    host: str
    machine: str  # identifies machine, boot and process namespace
    pid: int
    # Start time of the process in ticks since boot; distinguishes later processes with the same id.
    started: int
    beat: int = 0  # grows with each renewal
    released: bool = False

    @classmethod
    def current_process(cls) -> "LockHolder":
        """Return this process."""
        pid, host = os.getpid(), socket.gethostname()
        started = _start_time(pid) or 0
        return cls(id=uuid.uuid4().hex, host=host, machine=_machine_id(), pid=pid, started=started)

    @classmethod
    def parse_holder(cls, data: bytes) -> "LockHolder | None":
        """Return the holder in a lock object; None if it cannot be read."""
        try:
            return cls.model_validate_json(data)
        except ValidationError:
            return None

    @property
    def is_here(self) -> bool:
        """Whether it is a process, running or ended, that is visible from here."""
        return self.machine == _machine_id()

    @property
    def is_gone(self) -> bool:
        """Whether it released the lock, or was a process here that has ended."""
        return self.released or (self.is_here and _start_time(self.pid) != self.started)

    def to_json_bytes(self) -> bytes:
        """Return the content of the lock object."""
        return self.model_dump_json().encode()


def _machine_id() -> str:
    try:
        return f"{_BOOT_ID.read_text(encoding='utf-8').strip()} {_PID_NAMESPACE.readlink()}"
    except OSError:
        return socket.gethostname()


def _start_time(pid: int) -> int | None:
    """Return the start time of a process; None if it does not exist."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    # The name of the process, in brackets, may contain any characters.
    fields = stat.rpartition(")")[2].split()
    return None if fields[0] == "Z" else int(fields[19])


class StoreLease:
    """A held lock, renewed by a thread. Raises an OutputError once it was taken over."""

    def __init__(
        self, client: "ObjectClient", holder: LockHolder, version: "UpdateVersion", seconds: float
    ) -> None:
        self._client = client
        self._holder = holder
        self._version = version
        self._seconds = seconds
        self._lost = False
        self._released = threading.Event()
        self._writing = threading.Lock()
        self._thread = threading.Thread(target=self._renew_until_released, daemon=True)
        self._thread.start()

    def check_held(self) -> None:
        """Check that no other process is known to have taken over the lock."""
        if self._lost:
            raise OutputError(
                f"another sweep has taken over {self._client.address}; wait for it, or use -o"
            )

    def renew_lock(self) -> None:
        """Renew the lock now."""
        self._write_lock(beat=self._holder.beat + 1)
        self.check_held()

    def release_lock(self) -> None:
        """Release the lock; if that fails, another process takes it over later."""
        self._released.set()
        # Longest time for releasing a lock [s].
        self._thread.join(5.0)

    def _write_lock(self, **changes: object) -> None:
        with self._writing:
            self.check_held()
            holder = self._holder.model_copy(update=changes)
            version = self._client.create_object(LOCK, holder.to_json_bytes(), self._version)
            if version is None:
                self._lost = True
            else:
                self._holder, self._version = holder, version

    def _renew_until_released(self) -> None:
        while not self._released.wait(self._seconds / _RENEWALS):
            # It is retried next time; if the server stays away, the sweep's own writes fail.
            with suppress(ContactlabError):
                self.renew_lock()
        with suppress(ContactlabError):
            self._write_lock(released=True)


@contextmanager
def hold_lease(client: "ObjectClient", seconds: float | None = None) -> Generator[StoreLease]:
    """Hold the lock of a store, after one of another machine was unchanged for some seconds."""
    seconds = LEASE if seconds is None else seconds
    holder = LockHolder.current_process()
    version = None
    while version is None:
        version = client.create_object(LOCK, holder.to_json_bytes())
        if version is None and (other := client.find_object(LOCK)) is not None:
            _wait_until_gone(client, other, seconds)
            version = client.create_object(LOCK, holder.to_json_bytes(), other.version)
    lease = StoreLease(client, holder, version, seconds)
    try:
        yield lease
    finally:
        lease.release_lock()


def _wait_until_gone(client: "ObjectClient", lock: "StoredObject", seconds: float) -> None:
    """Wait until a lock may be taken over.

    Only the time without a change counts, by this machine's clock, because other clocks may be
    wrong.
    """
    holder = LockHolder.parse_holder(lock.data)
    if holder is not None and holder.is_gone:
        return
    if holder is not None and holder.is_here:
        raise OutputError(f"{client.address} is in use by process {holder.pid}; wait or use -o")
    where = f"on {holder.host}" if holder else "of another version"
    message = "%s is locked by a sweep %s; waiting %.0f s for a renewal"
    _LOG.warning(message, client.address, where, seconds)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(min(1.0, seconds / _RENEWALS))
        now = client.find_object(LOCK)
        if now is None or now.version != lock.version:
            after = LockHolder.parse_holder(now.data) if now else None
            if now is None or (after is not None and after.is_gone):
                return
            raise OutputError(f"{client.address} is in use by a sweep {where}; wait or use -o")
