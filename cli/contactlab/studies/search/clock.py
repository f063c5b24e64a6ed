"""What changed models cost: ratios of times, measured in turns from the same states.

The search is steered by short stretches. What is claimed is measured on whole runs of the task, of
the seeds that were searched and of fresh ones: iterations hang on the motion, so that seeds differ
by more than turns do.
"""

import copy
import math
import time
from collections.abc import Sequence
from contextlib import suppress
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.prices import Price
from contactlab.budget.windows import start_rows
from contactlab.contact.trace_arrays import Floats
from contactlab.engines.mujoco_batch import PERSISTENT
from contactlab.engines.older_mujoco import SimulationError
from contactlab.scene.mujoco_versions import has_batch
from contactlab.studies.search.yardstick import Yardsticks, at_steps

if TYPE_CHECKING or has_batch():
    from mujoco.batch import Batch
else:
    from contactlab.engines.older_mujoco import StepLoop as Batch

_FEWEST_PLACES, _MOST_PLACES = 4, 12  # states of each phase that stretches begin in
_STRETCH, _SHORTEST = 0.2, 0.04  # s of simulated time
_TURN = 0.01  # s that the model as written is timed for in each turn, about
_LEAST, _MOST_REPEATS = 5e-3, 200  # s that a model is timed for in a turn, and how often it is run
_MOST_COMPARED, _COMPARING = 25, 0.2  # turns, and s, of two models that are compared
_INSTANT = 1e-7  # s that nothing is timed to take less than
_WARM = 1
_WHOLE_TURNS = 3  # of two models that are compared by whole runs
_FEWEST, _MOST = 2, 60
"""Turns of each seed."""
NARROW = 0.07
"""Half-width of intervals that are wanted, as a share."""
_OUTSIDE = 0.05
_RESAMPLED = 400


class _Stretch(NamedTuple):
    """Parts of a phase: (M, nstate) states that they begin in, and (M, steps, width) inputs."""

    starts: Floats
    inputs: Floats
    spec: int
    steps: int


class _Batches:
    """Batches that models of one layout take turns in: one MjData serves all that are timed."""

    def __init__(self) -> None:
        self._known: dict[tuple[bool, int], list[Batch]] = {}

    def of(self, model: mujoco.MjModel, starts: Floats) -> Batch:
        """Return a batch of as many simulations as there are states, all of which run a model."""
        known = self._known.setdefault((bool(model.opt.enableflags & PERSISTENT), len(starts)), [])
        for batch in known:
            with suppress(mujoco.FatalError):  # of another layout
                batch.set_models([model] * len(starts))
                return batch
        known.append(start_rows(model, starts, 1))
        return known[-1]


class _Timed:
    """A model that is ready to be run through stretches again and again."""

    def __init__(
        self, model: mujoco.MjModel, stretches: Sequence[_Stretch], batches: _Batches
    ) -> None:
        self._model, self._stretches, self._batches = model, stretches, batches
        steps = sum(len(each.starts) * (each.steps - 1) for each in stretches)
        self.simulated = steps * float(model.opt.timestep)

    def seconds(self, repeats: int) -> float:
        """Return thread time over simulated time, the least of each stretch.

        Infinite if MuJoCo refuses the model, as it does tendon equalities of bodies that sleep.
        """
        try:
            spent = sum(self._spent(stretch, repeats) for stretch in self._stretches)
        except SimulationError:
            return math.inf
        return max(spent, _INSTANT) / self.simulated

    def _spent(self, stretch: _Stretch, repeats: int) -> float:
        """Return the thread time of all steps of a stretch but the first [s].

        A call takes time beside its steps, as much with one of them: few long ones are over as
        soon. Of both the least counts, of as many calls.
        """
        batch = self._batches.of(self._model, stretch.starts)
        least = {stretch.steps: math.inf, 1: math.inf}
        for _ in range(repeats):
            for steps, known in least.items():
                given: dict[str, Any] = {}
                if stretch.inputs.shape[2]:
                    given = {"control": stretch.inputs[:, :steps], "control_spec": stretch.spec}
                batch.state[:] = stretch.starts
                begin = time.thread_time()
                batch.rollout(steps, record=[], **given)
                least[steps] = min(known, time.thread_time() - begin)
        return least[stretch.steps] - least[1]


Stepped = tuple[mujoco.MjModel, int]
"""A model, and its step in fine ones."""


class Clock:
    """Times models through parts of a task that are spread over its phases."""

    def __init__(self, yards: Yardsticks, base: mujoco.MjModel) -> None:
        """Take the model as written, as its files make it."""
        self._yards, self._written, self._batches = yards, base, _Batches()
        # Stretches that begin at rest or in flight would tell nothing of contacts.
        self._places, self._stretch = _MOST_PLACES // 2, _SHORTEST
        first = self._timed(base, yards.finer)
        first.seconds(1)
        self.base_seconds = first.seconds(1)
        """Time of the model as written over simulated time."""
        wanted = _TURN / self.base_seconds / len(yards.parts)
        self._places = max(_FEWEST_PLACES, min(_MOST_PLACES, math.ceil(wanted / _STRETCH)))
        self._stretch = min(_STRETCH, max(_SHORTEST, wanted / self._places))

    def prices(self, models: Sequence[Stepped], turns: int = 3) -> list[Price]:
        """Return the time of models over that of the model as written, for the same motion."""
        timed = [self._timed(*each) for each in models]
        base = self._timed(self._written, self._yards.finer)
        turn = _Turn(base, timed)
        found = [turn.taken() for _ in range(_WARM + turns)][_WARM:]
        self.base_seconds = median(seconds for seconds, _ in found)
        return [interval(ratios) for ratios in zip(*(each for _, each in found), strict=True)]

    def compared(self, one: Stepped, other: Stepped, turns: int) -> Price:
        """Return the time of one model over that of another, for the same motion.

        From so many turns, or more where they cost little: one that was disturbed decides nothing
        then.
        """
        begin, found = time.thread_time(), list[float]()
        turn = _Turn(self._timed(*other), [self._timed(*one)])
        while len(found) < _WARM + turns or (
            len(found) < _WARM + _MOST_COMPARED and time.thread_time() < begin + _COMPARING
        ):
            found += turn.taken()[1]
        return interval(found[_WARM:])

    def compared_whole(self, one: Stepped, other: Stepped) -> Price:
        """Return the time of one model over that of another, for whole runs of one seed."""
        motions = [part.motion for part in self._yards.parts]
        turn = self._turn(self._all_stepped([other, one]), motions, 0)
        return interval([turn.taken()[1][0] for _ in range(_WARM + _WHOLE_TURNS)][_WARM:])

    def whole(
        self, models: Sequence[Stepped], motions: Sequence[Motion], until: float
    ) -> list[Price]:
        """Return the time of models over that of the model as written, for whole runs of phases.

        Turns go on while they leave an interval wider than wanted, until then on the clock of
        `time.monotonic`, which seeds that were not begun by then are left out for. By how much
        seeds differ, no turn makes narrower.
        """
        made = self._all_stepped([(self._written, self._yards.finer), *models])
        turns = [self._turn(made, motions, 0)]
        rounds = [[turns[0].taken()]]
        for seed in range(1, motions[0].seeds):
            if time.monotonic() > until:
                break
            turns.append(self._turn(made, motions, seed))
            rounds[0].append(turns[-1].taken())
        while len(rounds) < _MOST and time.monotonic() < until:
            if len(rounds) >= _FEWEST and _all_narrow(_told(rounds, seeds=False)):
                break
            rounds.append([turn.taken() for turn in turns])
        bases = np.array([[base for base, _ in each] for each in rounds])
        self.base_seconds = float(np.median(bases, axis=0).mean())
        return _told(rounds)

    def _turn(self, made: Sequence[Stepped], motions: Sequence[Motion], seed: int) -> "_Turn":
        """Return whole runs of a seed of motions by a model, and by others beside it."""
        finer = self._yards.finer
        first, *timed = (
            _Timed(
                model, [whole_run(each, finer, seed, multiple) for each in motions], self._batches
            )
            for model, multiple in made
        )
        return _Turn(first, timed)

    def _all_stepped(self, models: Sequence[Stepped]) -> list[Stepped]:
        return [(self._stepped(*each), each[1]) for each in models]

    def _stepped(self, model: mujoco.MjModel, multiple: int) -> mujoco.MjModel:
        own = copy.copy(model)
        own.opt.timestep = multiple * self._yards.step
        return own

    def _timed(self, model: mujoco.MjModel, multiple: int) -> _Timed:
        steps = max(2, round(self._stretch / (multiple * self._yards.step)))
        stretches = list[_Stretch]()
        for yard in self._yards.parts:
            which = yard.starts
            places = np.linspace(0, len(which) - 1, min(self._places, len(which))).astype(int)
            begun = yard.begun(multiple, which[places], steps)
            stretches.append(_Stretch(*begun, yard.motion.spec, steps))
        return _Timed(self._stepped(model, multiple), stretches, self._batches)


class _Turn:
    """A model, and others that take turns with it, each for long enough to be timed."""

    def __init__(self, base: _Timed, timed: Sequence[_Timed]) -> None:
        self._base, self._timed = base, timed
        self._repeats = {one: self._enough(one) for one in (base, *timed)}
        self._first = 0

    @staticmethod
    def _enough(one: _Timed) -> int:
        """Return how often a model is run, so that it finds its caches most of the time."""
        once = one.seconds(1) * one.simulated
        return max(1, min(_MOST_REPEATS, math.ceil(_LEAST / max(once, 1e-9))))

    def _seconds(self, one: _Timed) -> float:
        return one.seconds(self._repeats[one])

    def taken(self) -> tuple[float, list[float]]:
        """Return the time of the model as written, before and after others, and theirs over it."""
        before, taken = self._seconds(self._base), [0.0] * len(self._timed)
        # The one that comes after the model as written finds cold caches: each of them, in turn.
        for number in range(len(taken)):
            place = (self._first + number) % len(taken)
            taken[place] = self._seconds(self._timed[place])
        self._first += 1
        base = (before + self._seconds(self._base)) / 2
        return base, [seconds / base for seconds in taken]


def whole_run(motion: Motion, finer: int, seed: int, multiple: int) -> _Stretch:
    """Return a seed of a motion from its start to its end, by steps of so many fine ones."""
    run = at_steps(motion, finer, np.array([seed]), multiple)
    return _Stretch(run.starts, run.inputs, run.spec, run.steps)


def over_seeds(bases: Sequence[float], ratios: np.ndarray, *, seeds: bool = True) -> Price:
    """Return the ratio of times that all seeds take, and an interval by resampling.

    Args:
        bases: (S,) time that each seed takes as written.
        ratios: (S, T) of turns, which are drawn with replacement within each seed.
        seeds: whether seeds are drawn, too; else the interval is of these seeds.
    """
    generator, (count, turns) = np.random.default_rng(0), ratios.shape
    weights = np.asarray(bases)
    which = np.tile(np.arange(count), (_RESAMPLED, 1))
    if seeds:
        which = generator.integers(count, size=which.shape)
    drawn = generator.integers(turns, size=(_RESAMPLED, count, turns))
    medians = np.median(ratios[which[..., None], drawn], axis=2)
    found = (medians * weights[which]).sum(axis=1) / weights[which].sum(axis=1)
    low, high = np.quantile(found, [_OUTSIDE / 2, 1 - _OUTSIDE / 2])
    ratio = float(np.median(ratios, axis=1) @ weights / weights.sum())
    return Price(ratio, float(min(low, ratio)), float(max(high, ratio)))


def _told(
    rounds: Sequence[Sequence[tuple[float, list[float]]]], *, seeds: bool = True
) -> list[Price]:
    """Return the price of each model, of rounds in which each seed took its turn."""
    weights = [median(base for base, _ in seed) for seed in zip(*rounds, strict=True)]
    found = np.array([[ratios for _, ratios in each] for each in rounds])
    return [
        over_seeds(weights, found[..., model].T, seeds=seeds) for model in range(found.shape[2])
    ]


def _all_narrow(prices: Sequence[Price]) -> bool:
    return all(half_width(price) <= NARROW for price in prices)


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
