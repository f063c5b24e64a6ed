"""The wall time that a study may take, and by how much other work stretches it."""

import time
from dataclasses import dataclass, field

_TOLD = 0.5  # s of CPU time, before which wall over CPU time tells little


@dataclass(frozen=True)
class AllowedTime:
    """Wall time that is allowed.

    Attributes:
        begin: on the clock of `time.monotonic`.
        seconds: how long it is.
    """

    begin: float
    seconds: float
    _since: float = field(default_factory=time.monotonic)
    _cpu: float = field(default_factory=time.process_time)

    @property
    def deadline(self) -> float:
        """When it ends, on the clock of `time.monotonic`."""
        return self.begin + self.seconds

    @property
    def left(self) -> float:
        """What is left of it [s]; negative once it is over."""
        return self.deadline - time.monotonic()

    @property
    def stretch(self) -> float:
        """Wall time over CPU time so far, at least 1: what waits for a core takes as much more."""
        spent = time.process_time() - self._cpu
        return max(1.0, (time.monotonic() - self._since) / spent) if spent > _TOLD else 1.0
