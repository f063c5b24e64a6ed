"""What changed models cost: ratios of times, measured in turns from the same states."""

import copy
import math
import time
from collections.abc import Sequence
from statistics import median
from typing import Any, NamedTuple

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.prices import Price
from contactlab.budget.windows import start_rows
from contactlab.studies.search.yardstick import Yardsticks

_MOST_PLACES = 12  # states of each phase that stretches begin in
_STRETCH, _WHOLE = 0.2, 1.0  # s of simulated time: of the search, and of what is claimed
_TURN = 0.01  # s that the model as written is timed for in each turn, about
_WARM, _MOST = 1, 200
NARROW = 0.07
"""Half-width of intervals that are wanted, as a share."""
_OUTSIDE = 0.05


class _Stretch(NamedTuple):
    """Parts of a phase: motions from several states, and how many steps each has."""

    motion: Motion
    steps: int


class _Timed:
    """A model with a step, ready to be run through stretches again and again."""

    def __init__(self, model: mujoco.MjModel, step: float, stretches: Sequence[_Stretch]) -> None:
        own = copy.copy(model)
        own.opt.timestep = step
        self._stretches = stretches
        self._batches = [start_rows(own, stretch.motion.starts, 1) for stretch in stretches]
        self._simulated = sum(len(each.motion.starts) * each.steps * step for each in stretches)

    def seconds(self, repeats: int) -> float:
        """Return thread time over simulated time."""
        spent = 0.0
        for _ in range(repeats):
            for (motion, steps), batch in zip(self._stretches, self._batches, strict=True):
                batch.state[:] = motion.starts
                given: dict[str, Any] = {}
                if motion.inputs.shape[2]:
                    given = {"control": motion.inputs, "control_spec": motion.spec}
                begin = time.thread_time()
                batch.rollout(steps, record=[], **given)
                spent += time.thread_time() - begin
        return spent / (repeats * self._simulated)


class Clock:
    """Times models through parts of a task that are spread over its phases."""

    def __init__(self, yards: Yardsticks, base: mujoco.MjModel) -> None:
        """Take the model as written, as its files make it."""
        self._yards, self._written, self._places, self._repeats = yards, base, 1, 1
        first = self._timed(base, yards.finer)
        first.seconds(1)
        self.base_seconds = first.seconds(1)
        """Time of the model as written over simulated time."""
        wanted = _TURN / self.base_seconds / (len(yards.parts) * _STRETCH)
        self._places = max(1, min(_MOST_PLACES, math.ceil(wanted)))
        self._repeats = max(1, math.ceil(wanted / self._places))

    def prices(
        self, models: Sequence[tuple[mujoco.MjModel, int]], turns: int = 3, until: float = -math.inf
    ) -> list[Price]:
        """Return the time of models over that of the model as written, for the same motion.

        Each has a step of so many fine ones. There are so many turns; if `until` is given, on the
        clock of `time.monotonic`, stretches are longer, and turns go on until then while an
        interval is wider than wanted.
        """
        whole = until > -math.inf
        timed = [self._timed(model, multiple, whole=whole) for model, multiple in models]
        base = self._timed(self._written, self._yards.finer, whole=whole)
        ratios: list[list[float]] = [[] for _ in models]
        seconds = list[float]()
        most = _MOST if whole else turns
        for number in range(_WARM + most):
            before = base.seconds(self._repeats)
            for place, one in enumerate(timed):
                taken = one.seconds(self._repeats)
                after = base.seconds(self._repeats)
                if number >= _WARM:
                    ratios[place].append(2 * taken / (before + after))
                    seconds.append(before)
                before = after
            if number >= turns and (time.monotonic() > until or _all_narrow(ratios)):
                break
        if seconds:
            self.base_seconds = median(seconds)
        return [interval(found) for found in ratios]

    def _timed(self, model: mujoco.MjModel, multiple: int, *, whole: bool = False) -> _Timed:
        step = multiple * self._yards.step
        steps = max(2, round((_WHOLE if whole else _STRETCH) / step))
        stretches = list[_Stretch]()
        for yard in self._yards.parts:
            which = yard.starts
            places = np.linspace(0, len(which) - 1, min(self._places, len(which))).astype(int)
            stretches.append(_Stretch(yard.motion_of(model, multiple, which[places], steps), steps))
        return _Timed(model, step, stretches)


def interval(ratios: Sequence[float]) -> Price:
    """Return the median, and order statistics that have the median of all turns with 95 %."""
    ordered, count = sorted(ratios), len(ratios)
    if not count:
        return Price(math.nan, 0.0, math.inf)
    rank, outside = 0, 2.0**-count
    while 2 * (outside + _binomial(count, rank + 1)) <= _OUTSIDE and rank + 1 < count // 2:
        rank += 1
        outside += _binomial(count, rank)
    return Price(median(ordered), ordered[rank], ordered[count - 1 - rank])


def _binomial(count: int, successes: int) -> float:
    return math.comb(count, successes) * 2.0**-count


def half_width(price: Price) -> float:
    """Return half the interval of a price, as a share of it."""
    return (price.high - price.low) / (2 * price.ratio)


def _all_narrow(ratios: Sequence[Sequence[float]]) -> bool:
    return all(half_width(interval(found)) <= NARROW for found in ratios)
