"""Clocks whose rates change at random, as on a slow and noisy machine."""

import time
from collections.abc import Callable

import numpy as np
import pytest


class NoisyClock:
    """A clock that runs between `least` and `most` times as fast as the one that it reads."""

    def __init__(
        self, read: Callable[[], float], rates: np.random.Generator, least: float, most: float
    ) -> None:
        self._read, self._rates, self._range = read, rates, (least, most)
        self._last, self._now = read(), 0.0

    def read(self) -> float:
        """Return the time since it was made [s], which never falls."""
        now = self._read()
        self._now += (now - self._last) * self._rates.uniform(*self._range)
        self._last = now
        return self._now


def disturb_clock(
    patch: pytest.MonkeyPatch, name: str, seed: int, least: float, most: float
) -> None:
    """Have a clock of module `time` run between these times as fast from now on."""
    clock = NoisyClock(getattr(time, name), np.random.default_rng(seed), least, most)
    patch.setattr(time, name, clock.read)
