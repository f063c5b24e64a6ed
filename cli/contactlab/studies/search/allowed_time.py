"""The wall time that a study may take, and how long work takes beside all else that runs."""

import time
from collections import deque
from dataclasses import dataclass, field

_LATELY = 2.0  # s of CPU time, of which the last tell how long such work takes now
_TOLD = 0.2  # s of CPU time that tell something


@dataclass(frozen=True)
class AllowedTime:
    """Wall time that is allowed.

    Attributes:
        begin: on the clock of `time.monotonic`.
        seconds: how long it is.
    """

    begin: float
    seconds: float
    _marks: deque[tuple[float, float]] = field(default_factory=lambda: deque([_now()]))

    @property
    def deadline(self) -> float:
        """When it ends, on the clock of `time.monotonic`."""
        return self.begin + self.seconds

    @property
    def left(self) -> float:
        """What is left of it [s]; negative once it is over."""
        return self.deadline - time.monotonic()

    def takes(self, spent: float) -> float:
        """Return how long work of so much CPU time takes [s], as the work before it did lately."""
        marks, (wall, cpu) = self._marks, _now()
        while len(marks) > 1 and cpu - marks[1][1] > _LATELY:
            marks.popleft()
        since, before = marks[0]
        if cpu - before < _TOLD:
            return spent
        marks.append((wall, cpu))
        return spent * (wall - since) / (cpu - before)


def _now() -> tuple[float, float]:
    """Return wall time and CPU time of the process, of all its threads [s]."""
    return time.monotonic(), time.process_time()
