"""The time limit of a study, in CPU time: a busy machine ends a study later, not elsewhere."""

import time
from dataclasses import dataclass, field


@dataclass(frozen=True)
class TimeLimit:
    """A limit on the CPU time of this process, over all of its threads.

    Attributes:
        seconds: length [s].
        spent: CPU time before the study, which counts [s].
    """

    seconds: float
    spent: float = 0.0
    _begin: float = field(default_factory=time.process_time)

    @property
    def elapsed(self) -> float:
        """CPU time of the study until now [s]."""
        return self.spent + time.process_time() - self._begin

    @property
    def remaining(self) -> float:
        """Remaining time [s]; negative after the end."""
        return self.seconds - self.elapsed
