"""What a policy did in a run: enough to repeat the run without the policy."""

import hashlib
from dataclasses import dataclass

import numpy as np

from contactlab.contact.trace_arrays import Floats


@dataclass(frozen=True)
class RecordedControls:
    """The controls of one run, each held until the next.

    Attributes:
        times: (K,) when they took effect [s], increasing from 0; the last is the run's end.
        levels: (K, nu) the controls.
    """

    times: Floats
    levels: Floats

    @property
    def sha256(self) -> str:
        """Hash of times and levels as float64 bytes: equal controls have the same one."""
        digest = hashlib.sha256(f"{self.levels.shape}".encode())
        for part in (self.times, self.levels):
            digest.update(np.ascontiguousarray(part, np.float64).data)
        return digest.hexdigest()

    @property
    def knots(self) -> tuple[Floats, Floats]:
        """(2 K - 1,) times and (nu, 2 K - 1) levels that are linear in between, with jumps."""
        return np.repeat(self.times, 2)[1:], np.repeat(self.levels, 2, axis=0)[:-1].T
