"""Memory of a command and of the processes that it starts, sampled while it runs; Linux only."""

import os
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

_EVERY = 0.1
_KIB = 1024
# Samples that make a line.
_FEWEST = 5


@dataclass
class Memory:
    """What one process held to itself.

    Attributes:
        role: command, fork server, worker or other.
        samples: (units done, private bytes) as time went on.
    """

    role: str
    samples: list[tuple[int, int]] = field(default_factory=list[tuple[int, int]])

    @property
    def largest(self) -> int:
        """The most that it held [bytes]."""
        return max((held for _, held in self.samples), default=0)

    def slope(self, units: int) -> float:
        """Return the growth over the second half of all units; NaN where that was too short.

        Args:
            units: how many there are in all; what comes after the last one does not count.
        """
        half = [each for each in self.samples if units / 2 <= each[0] < units]
        times, held = np.array(half, dtype=float).reshape(-1, 2).T
        if len(half) < _FEWEST or np.ptp(times) == 0:
            return float("nan")
        return float(np.polyfit(times, held, 1)[0])


class TreeMemory:
    """Samples all descendants of this process for as long as it is entered.

    Attributes:
        found: what was seen, by process.
    """

    def __init__(self, done: Callable[[], int]) -> None:
        self.found: dict[int, Memory] = {}
        self._done = done
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch)

    def __enter__(self) -> Self:
        """Begin to sample."""
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop sampling."""
        self._ended.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._ended.wait(_EVERY):
            done = self._done()
            for process, role in _descendants().items():
                with suppress(OSError):
                    self._note(process, role, done, _private(process))

    def _note(self, process: int, role: str, done: int, held: int) -> None:
        memory = self.found.setdefault(process, Memory(role))
        if memory.role == "other":
            memory.role = role
        # What the command leaves behind has what it shared to itself in the end, and says little.
        if held and memory.role == role:
            memory.samples.append((done, held))


def _descendants() -> dict[int, str]:
    """Return what each descendant of this process is."""
    parents = dict(_parents())
    found: dict[int, str] = {}
    for command in [each for each, parent in parents.items() if parent == os.getpid()]:
        found[command] = "command"
        for child in [each for each, parent in parents.items() if parent == command]:
            workers = [each for each, parent in parents.items() if parent == child]
            found[child] = "fork server" if workers else "other"
            found |= dict.fromkeys(workers, "worker")
    return found


def _parents() -> list[tuple[int, int]]:
    found: list[tuple[int, int]] = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = stat.read_text(encoding="utf-8").rpartition(")")[2].split()
            found.append((int(stat.parent.name), int(fields[1])))
    return found


def _private(process: int) -> int:
    lines = Path(f"/proc/{process}/smaps_rollup").read_text(encoding="utf-8").splitlines()
    return _KIB * sum(int(line.split()[1]) for line in lines if line.startswith("Private"))
