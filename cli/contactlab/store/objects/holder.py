"""Who holds the lock of a store, and whether it is known to be gone."""

import os
import socket
import uuid
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

_BOOT = Path("/proc/sys/kernel/random/boot_id")
_PIDS = Path("/proc/self/ns/pid")


class Holder(BaseModel):
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
    def this(cls) -> "Holder":
        """Return this process."""
        return cls(
            id=uuid.uuid4().hex,
            host=socket.gethostname(),
            machine=_machine(),
            pid=os.getpid(),
            started=_started(os.getpid()) or 0,
        )

    @classmethod
    def read(cls, data: bytes) -> "Holder | None":
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
