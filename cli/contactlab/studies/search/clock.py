"""What changed models cost: ratios of times, measured in turns from the same states.

Times are those of a plain loop of `mj_step`, as whoever uses a model has it: with its sensors, and
what Python adds to a step; where MuJoCo gives up, it resets the model and goes on. The search is
steered by short stretches. What is claimed is measured on whole runs of the task, of the seeds that
were searched and of fresh ones: iterations hang on the motion, so that seeds differ by more than
turns do.
"""

import copy
import itertools
import math
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.special import stdtrit

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.prices import Price
from contactlab.contact.trace_arrays import Floats
from contactlab.studies.search.yardstick import Yardsticks, at_steps

_FEWEST_PLACES, _MOST_PLACES = 4, 12  # states of each phase that stretches begin in
_STRETCH, _SHORTEST = 0.2, 0.04  # s of simulated time
_TURN = 0.01  # s that the model as written is timed for in each turn, about
_LEAST = 5e-3  # s that the slowest model of a turn is timed for in it
_PIECE, _MOST_PIECES = 5e-4, 200  # s that a piece takes: others seldom share so few
_MOST_RUNS = 100  # that make a piece, of a model that is over sooner
_MOST_COMPARED, _COMPARING = 25, 0.2  # turns of two models; s of turns, where they are short
_INSTANT = 1e-7  # s that nothing is timed to take less than
_WHOLE_TURNS = 4  # of two models that are compared by whole runs
_SEED_TURNS = 3  # of a seed; one, where time is short
_FEWEST, _ENOUGH = 2, 6  # seeds that tell how they differ; so many that it is well known
_RESETS = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
NARROW = 0.05
"""Half-width of intervals that are wanted, as a share."""
_OUTSIDE = 0.05
_RESAMPLED = 200


class Stretch(NamedTuple):
    """Parts of a phase: (M, nstate) states that they begin in, and (M, steps, width) inputs."""

    starts: Floats
    inputs: Floats
    spec: int
    steps: int


class Timed:
    """A model that is ready to be run through stretches again and again.

    Attributes:
        simulated: how long all of them are [s].
        whole: thread time of all pieces, about [s]; infinite if MuJoCo refuses the model.
        repeats: how often each piece is timed in a turn.
        copies: how often there is each piece.
    """

    def __init__(self, model: mujoco.MjModel, stretches: Sequence[Stretch]) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self._runs = [(each, row) for each in stretches for row in range(len(each.starts))]
        steps = sum(len(each.starts) * (each.steps - 1) for each in stretches)
        self.simulated = steps * float(model.opt.timestep)
        self.repeats = self.copies = 1
        self._ends, self._often = list[list[int]](), list[int]()
        self.whole = math.inf
        with suppress(mujoco.FatalError):
            once = [self._once(*run) for run in self._runs]
            for (stretch, _), spent in zip(self._runs, once, strict=True):
                pieces = max(1, min(_MOST_PIECES, stretch.steps - 1, round(spent / _PIECE)))
                self._ends.append(np.linspace(1, stretch.steps, pieces + 1).astype(int).tolist())
                self._often.append(max(1, min(_MOST_RUNS, round(_PIECE / spent))))
            self.whole = float(np.dot(once, self._often))

    def taken(self) -> Floats:
        """Return (P,) thread time of the pieces of all stretches, over their simulated time.

        Of each piece the least of its repeats: what disturbs one only adds, and a piece is short
        enough to be left alone now and then. Infinite if MuJoCo refuses the model, as it does
        tendon equalities of bodies that sleep.
        """
        if math.isinf(self.whole):
            return np.full(1, np.inf)
        spent = np.concatenate([self._spent(place) for place in range(len(self._runs))])
        return np.maximum(spent, _INSTANT) / self.simulated

    def _once(self, stretch: Stretch, row: int) -> float:
        """Return the thread time of all steps of a run but the first, about [s]."""
        return max(self._stepped(stretch, row, [1, stretch.steps])[0], _INSTANT)

    def _spent(self, place: int) -> Floats:
        """Return (copies * pieces,) thread time of all steps of a run but the first [s].

        A run begins with the caches of the end of another: the first piece is made once before.
        Where a piece is several runs, it is their mean.
        """
        stretch, row = self._runs[place]
        ends, often = self._ends[place], self._often[place]
        least = np.full((self.copies, len(ends) - 1), np.inf)
        self._stepped(stretch, row, ends[:2])
        for _ in range(self.repeats):
            for own in least:
                runs = [self._stepped(stretch, row, ends) for _ in range(often)]
                np.minimum(own, np.mean(runs, axis=0), out=own)
        return least.ravel() / self.copies

    def _stepped(self, stretch: Stretch, row: int, ends: Sequence[int]) -> list[float]:
        """Return the thread time of steps between some, the first of which is not timed [s]."""
        model, data, spec = self._model, self._data, stretch.spec
        inputs, taken = stretch.inputs[row], list[float]()
        mujoco.mj_resetData(model, data)  # what slept wakes
        mujoco.mj_setState(model, data, stretch.starts[row], INTEGRATION)
        for first, last in itertools.pairwise([0, *ends]):
            begin = time.thread_time()
            for step in range(first, last):
                if inputs.shape[1]:
                    mujoco.mj_setState(model, data, inputs[step], spec)
                mujoco.mj_step(model, data)
            taken.append(time.thread_time() - begin)
        return taken[1:]


Stepped = tuple[mujoco.MjModel, int]
"""A model, and its step in fine ones."""


class Clock:
    """Times models through parts of a task that are spread over its phases.

    Models that it is given are its own from then on: it sets their steps, since meshes make copies
    large.
    """

    def __init__(self, yards: Yardsticks, base: mujoco.MjModel) -> None:
        """Take the model as written, as its files make it."""
        self._yards, self._written = yards, copy.copy(base)
        # Stretches that begin at rest or in flight would tell nothing of contacts.
        self._places, self._stretch = _MOST_PLACES // 2, _SHORTEST
        self.base_seconds = float(self._timed(self._written, yards.finer).taken().sum())
        """Time of the model as written over simulated time."""
        wanted = _TURN / self.base_seconds / len(yards.parts)
        self._places = max(_FEWEST_PLACES, min(_MOST_PLACES, math.ceil(wanted / _STRETCH)))
        self._stretch = min(_STRETCH, max(_SHORTEST, wanted / self._places))

    def prices(self, models: Sequence[Stepped], turns: int = 4) -> list[Price]:
        """Return the time of models over that of the model as written, for the same motion."""
        turn = Turn([self._timed(*each) for each in [(self._written, self._yards.finer), *models]])
        taken = [turn.taken() for _ in range(turns)]
        self.base_seconds = float(np.min([each[0] for each in taken], axis=0).sum())
        return _told(taken)

    def compared(self, one: Stepped, other: Stepped, turns: int) -> Price:
        """Return the time of one model over that of another, for the same motion.

        From so many turns, or more where they cost little.
        """
        begin, taken = time.thread_time(), list[list[Floats]]()
        turn = Turn([self._timed(*other), self._timed(*one)])
        while len(taken) < turns or (
            len(taken) < _MOST_COMPARED and time.thread_time() < begin + _COMPARING
        ):
            taken.append(turn.taken())
        return _told(taken)[0]

    def compared_whole(self, one: Stepped, other: Stepped) -> Price:
        """Return the time of one model over that of another, for whole runs of one seed."""
        motions = [part.motion for part in self._yards.parts]
        turn = self._turn(self._all_stepped([other, one]), motions, 0)
        return _told([turn.taken() for _ in range(_WHOLE_TURNS)])[0]

    def whole(
        self, models: Sequence[Stepped], tasks: Iterable[Sequence[Motion]], until: float
    ) -> list[Price]:
        """Return the time of models over that of the model as written, for whole runs of phases.

        Seeds of task after task are run while they leave an interval wider than wanted, until then
        on the clock of `time.monotonic`; some are in any case, since one does not tell how they
        differ.
        """
        made, taken = (
            self._all_stepped([(self._written, self._yards.finer), *models]),
            list[Floats](),
        )
        for motions in tasks:
            for seed in range(motions[0].seeds):
                if len(taken) < _FEWEST or time.monotonic() < until:
                    taken.append(_seconds(self._turn(made, motions, seed), until))
            late = len(taken) >= _FEWEST and time.monotonic() > until
            if late or (len(taken) >= _ENOUGH and _all_narrow(_over_all(taken))):
                break
        self.base_seconds = float(np.mean(taken, axis=0)[0])
        return _over_all(taken)

    def _turn(self, made: Sequence[Stepped], motions: Sequence[Motion], seed: int) -> "Turn":
        """Return whole runs of a seed of motions by a model, and by others beside it."""
        finer = self._yards.finer
        return Turn(
            [
                Timed(model, [whole_run(each, finer, seed, multiple) for each in motions])
                for model, multiple in made
            ]
        )

    def _all_stepped(self, models: Sequence[Stepped]) -> list[Stepped]:
        return [(self._stepped(*each), each[1]) for each in models]

    def _stepped(self, model: mujoco.MjModel, multiple: int) -> mujoco.MjModel:
        model.opt.timestep = multiple * self._yards.step
        model.opt.disableflags &= ~_RESETS  # as files have it: what records runs never resets
        return model

    def _timed(self, model: mujoco.MjModel, multiple: int) -> Timed:
        steps = max(2, round(self._stretch / (multiple * self._yards.step)))
        stretches = list[Stretch]()
        for yard in self._yards.parts:
            which = yard.starts
            places = np.linspace(0, len(which) - 1, min(self._places, len(which))).astype(int)
            begun = yard.begun(multiple, which[places], steps)
            stretches.append(Stretch(*begun, yard.motion.spec, steps))
        return Timed(self._stepped(model, multiple), stretches)


class Turn:
    """Models that take turns, from the first to the last and back again.

    A piece of a fast one takes as long as one of a slow one and is timed as often, and few pieces
    have copies: of more, the least would be less disturbed, and the sum of fewer is chance.
    """

    def __init__(self, timed: Sequence[Timed]) -> None:
        self._timed, self._backwards = timed, False
        slowest = max((one.whole for one in timed if math.isfinite(one.whole)), default=_LEAST)
        for one in timed:
            one.repeats = max(1, math.ceil(_LEAST / slowest))
            if math.isfinite(one.whole):
                one.copies = max(1, round(min(slowest, _LEAST) / one.whole))

    def taken(self) -> list[Floats]:
        """Return the times of each model's pieces, as `Timed` has them."""
        found = [np.empty(0)] * len(self._timed)
        places = range(len(found))
        for place in reversed(places) if self._backwards else places:
            found[place] = self._timed[place].taken()
        self._backwards = not self._backwards
        return found


def _seconds(turn: Turn, until: float) -> Floats:
    """Return the time of each model of a seed, from one turn where more would leave no others."""
    begin, least = time.monotonic(), turn.taken()
    lasts = time.monotonic() - begin
    often = _SEED_TURNS if begin + _ENOUGH * _SEED_TURNS * lasts < until else 1
    for _ in range(often - 1):
        least = [np.minimum(*each) for each in zip(least, turn.taken(), strict=True)]
    return np.array([pieces.sum() for pieces in least])


def whole_run(motion: Motion, finer: int, seed: int, multiple: int) -> Stretch:
    """Return a seed of a motion from its start to its end, by steps of so many fine ones."""
    run = at_steps(motion, finer, np.array([seed]), multiple)
    return Stretch(run.starts, run.inputs, run.spec, run.steps)


def over_turns(base: Floats, model: Floats) -> Price:
    """Return the ratio of the least times of pieces, and an interval by drawing turns again.

    Args:
        base: (T, P) times of pieces in turns, of the model as written.
        model: (T, Q) of another model, in the same turns.
    """
    turns = len(base)
    drawn = np.random.default_rng(0).integers(turns, size=(_RESAMPLED, turns))
    below, above = (each[drawn].min(axis=1).sum(axis=1) for each in (base, model))
    ratio = float(model.min(axis=0).sum() / base.min(axis=0).sum())
    low, high = np.quantile(above / below, [_OUTSIDE / 2, 1 - _OUTSIDE / 2])
    return Price(ratio, float(min(low, ratio)), float(max(high, ratio)))


def over_seeds(base: Floats, model: Floats) -> Price:
    """Return the ratio of the times that all seeds take, and the interval that seeds leave.

    Each seed is timed by itself, so that what it differs by has the noise of its times, too. Of a
    ratio of sums, what seeds are off by is the residual from it, in first order (W. G. Cochran,
    Sampling Techniques, 1977, 6.4), and n of them have n - 1 degrees of freedom.

    Args:
        base: (n,) times of seeds, of the model as written.
        model: (n,) of another model.
    """
    count, ratio = len(base), float(model.sum() / base.sum())
    off = model / ratio - base
    share = math.sqrt(count / (count - 1) * float(off @ off)) / float(base.sum())
    half = float(stdtrit(count - 1, 1 - _OUTSIDE / 2)) * share
    return Price(ratio, ratio * math.exp(-half), ratio * math.exp(half))


_REFUSED = Price(math.inf, math.inf, math.inf)


def _over_all(taken: Sequence[Floats]) -> list[Price]:
    """Return the price of each model but the first, of the times of all models by seed."""
    base, *models = np.array(taken).T
    return [over_seeds(base, one) if np.isfinite(one).all() else _REFUSED for one in models]


def _told(taken: Sequence[Sequence[Floats]]) -> list[Price]:
    """Return the price of each model but the first, of its times by turn."""
    base, *models = (np.array(turns) for turns in zip(*taken, strict=True))
    return [over_turns(base, one) if np.isfinite(one).all() else _REFUSED for one in models]


def _all_narrow(prices: Sequence[Price]) -> bool:
    return all(half_width(price) <= NARROW for price in prices)


def half_width(price: Price) -> float:
    """Return half the interval of a price, as a share of it."""
    return (price.high - price.low) / (2 * price.ratio)
