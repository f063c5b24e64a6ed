"""The wall time limit of a study, and estimates of wall time under the current load."""

import time
from collections import deque
from dataclasses import dataclass, field

THROUGHPUT_WINDOW = 2.0  # s of recent CPU time over which the throughput is measured
MIN_OBSERVED_CPU = 0.2  # s of CPU time from which the throughput is known


@dataclass(frozen=True)
class TimeLimit:
    """A wall time limit.

    Attributes:
        begin: start, on the clock of `time.monotonic`.
        seconds: length.
    """

    begin: float
    seconds: float
    _marks: deque[tuple[float, float]] = field(default_factory=lambda: deque([_now()]))

    @property
    def deadline(self) -> float:
        """The end, on the clock of `time.monotonic`."""
        return self.begin + self.seconds

    @property
    def remaining(self) -> float:
        """Remaining time [s]; negative after the end."""
        return self.deadline - time.monotonic()

    def wall_time_of(self, spent: float) -> float:
        """Estimate the wall time of work with a CPU time [s], from the recent throughput."""
        marks, (wall, cpu) = self._marks, _now()
        while len(marks) > 1 and cpu - marks[1][1] > THROUGHPUT_WINDOW:
            marks.popleft()
        since, before = marks[0]
        if cpu - before < MIN_OBSERVED_CPU:
            return spent
        marks.append((wall, cpu))
        return spent * (wall - since) / (cpu - before)


def _now() -> tuple[float, float]:
    """Return wall time and CPU time of the process, over all threads [s]."""
    return time.monotonic(), time.process_time()
