"""What changed models cost: ratios of times, measured in turns from the same states.

The search is steered by short stretches. What is claimed is measured on whole runs of the task, of
the seeds that were searched and of fresh ones: iterations hang on the motion, so that seeds differ
by more than turns do. Steps are timed without Python, and have what a loop in Python adds to each:
of those that take two microseconds it is a part that is felt.
"""

import copy
import math
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import cache
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
_LEAST = 5e-3  # s that the slowest model of a turn is timed for in it
_PIECE, _MOST_PIECES = 5e-4, 200  # s that a piece takes: others seldom share so few
_MOST_RUNS = 100  # that make a piece, of a model that is over sooner
_MOST_COMPARED, _COMPARING = 25, 0.2  # turns of two models; s of turns, where they are short
_INSTANT = 1e-7  # s that nothing is timed to take less than
_WHOLE_TURNS = 4  # of two models that are compared by whole runs
_LOOPS, _LOOP = 50, 200  # of steps, of which the least counts; steps of each
_SWING = """<mujoco><worldbody><body><joint name="swing" axis="0 1 0"/>
<geom size=".02" pos="0 0 1"/></body></worldbody>
<actuator><motor joint="swing"/></actuator></mujoco>"""
_FEWEST, _MOST = 3, 60
"""Turns of each seed."""
NARROW = 0.07
"""Half-width of intervals that are wanted, as a share."""
_OUTSIDE = 0.05
_RESAMPLED = 200


@cache
def looped() -> float:
    """Return what it adds to a step to have its controls set and be called in Python [s]."""
    model = mujoco.MjModel.from_xml_string(_SWING)
    data, controls = mujoco.MjData(model), np.zeros((_LOOP, 1))
    inside, outside = list[float](), list[float]()
    for _ in range(_LOOPS):
        begin = time.thread_time()
        mujoco.mj_step(model, data, _LOOP)
        between = time.thread_time()
        for control in controls:
            data.ctrl[:] = control
            mujoco.mj_step(model, data)
        outside.append(time.thread_time() - between)
        inside.append(between - begin)
    return max(0.0, min(outside) - min(inside)) / _LOOP


class Stretch(NamedTuple):
    """Parts of a phase: (M, nstate) states that they begin in, and (M, steps, width) inputs."""

    starts: Floats
    inputs: Floats
    spec: int
    steps: int


class Batches:
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


class Timed:
    """A model that is ready to be run through stretches again and again.

    Attributes:
        simulated: how long all of them are [s].
        whole: thread time of all pieces, about [s]; infinite if MuJoCo refuses the model.
        repeats: how often each piece is timed in a turn.
        copies: how often there is each piece.
    """

    def __init__(
        self, model: mujoco.MjModel, stretches: Sequence[Stretch], batches: Batches
    ) -> None:
        self._model, self._stretches, self._batches = model, stretches, batches
        steps = sum(len(each.starts) * (each.steps - 1) for each in stretches)
        self.simulated = steps * float(model.opt.timestep)
        self.repeats = self.copies = 1
        self._pieces, self._runs = [1] * len(stretches), [1] * len(stretches)
        self.whole = math.inf
        with suppress(SimulationError):
            once = [self._once(stretch) for stretch in stretches]
            self._pieces = [
                max(1, min(_MOST_PIECES, stretch.steps, round(spent / _PIECE)))
                for stretch, spent in zip(stretches, once, strict=True)
            ]
            self._runs = [max(1, min(_MOST_RUNS, round(_PIECE / spent))) for spent in once]
            self.whole = float(np.dot(once, self._runs))

    def taken(self) -> Floats:
        """Return (P,) thread time of the pieces of all stretches, over their simulated time.

        Of each piece the least of its repeats: what disturbs one only adds, and a piece is short
        enough to be left alone now and then. Infinite if MuJoCo refuses the model, as it does
        tendon equalities of bodies that sleep.
        """
        each = zip(self._stretches, self._pieces, self._runs, strict=True)
        try:
            spent = np.concatenate([self._spent(*one) for one in each])
        except SimulationError:
            return np.full(self.copies * sum(self._pieces), np.inf)
        return np.maximum(spent, _INSTANT) / self.simulated

    def _once(self, stretch: Stretch) -> float:
        """Return the thread time of all steps of a stretch, about [s]."""
        batch = self._batches.of(self._model, stretch.starts)
        (spent,) = _run(batch, stretch, [slice(0, stretch.steps)])
        return max(spent, _INSTANT)

    def _spent(self, stretch: Stretch, pieces: int, runs: int) -> Floats:
        """Return (copies * pieces,) thread time of all steps of a stretch but the first [s].

        A call takes time beside its steps, as much with one of them: few long ones are over as
        soon. That one is made twice, since a run begins with the caches of the end of another.
        Where a piece is several runs, it is their mean, and one before them warms caches. A loop
        in Python adds to each step.
        """
        batch = self._batches.of(self._model, stretch.starts)
        ends = np.linspace(0, stretch.steps, pieces + 1).astype(int)
        spans = [*2 * [slice(0, 1)], *(slice(*ends[place : place + 2]) for place in range(pieces))]
        least = np.full((self.copies, len(spans)), np.inf)
        if runs > 1:
            _run(batch, stretch, spans)
        for _ in range(self.repeats):
            for own in least:
                mean = np.mean([_run(batch, stretch, spans) for _ in range(runs)], axis=0)
                np.minimum(own, mean, out=own)
        least[:, 2] -= least[:, 1]
        steps = np.diff(ends)
        steps[0] -= 1
        return (least[:, 2:] + steps * len(stretch.starts) * looped()).ravel() / self.copies


def _run(batch: Batch, stretch: Stretch, spans: Sequence[slice]) -> list[float]:
    """Return the thread time of spans of steps; those that begin at 0 begin a run anew [s]."""
    taken = list[float]()
    for span in spans:
        given: dict[str, Any] = {}
        if stretch.inputs.shape[2]:
            given = {"control": stretch.inputs[:, span], "control_spec": stretch.spec}
        if not span.start:
            batch.state[:] = stretch.starts
        begin = time.thread_time()
        batch.rollout(span.stop - span.start, record=[], **given)
        taken.append(time.thread_time() - begin)
    return taken


Stepped = tuple[mujoco.MjModel, int]
"""A model, and its step in fine ones."""


class Clock:
    """Times models through parts of a task that are spread over its phases.

    Models that it is given are its own from then on: it sets their steps, since meshes make copies
    large.
    """

    def __init__(self, yards: Yardsticks, base: mujoco.MjModel) -> None:
        """Take the model as written, as its files make it."""
        self._yards, self._written, self._batches = yards, copy.copy(base), Batches()
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
        return _told([taken], seeds=False)

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
        return _told([taken], seeds=False)[0]

    def compared_whole(self, one: Stepped, other: Stepped) -> Price:
        """Return the time of one model over that of another, for whole runs of one seed."""
        motions = [part.motion for part in self._yards.parts]
        turn = self._turn(self._all_stepped([other, one]), motions, 0)
        return _told([[turn.taken() for _ in range(_WHOLE_TURNS)]], seeds=False)[0]

    def whole(
        self, models: Sequence[Stepped], tasks: Iterable[Sequence[Motion]], until: float
    ) -> list[Price]:
        """Return the time of models over that of the model as written, for whole runs of phases.

        Turns go on while they leave an interval wider than wanted, and seeds of the next task are
        run while seeds do, until then on the clock of `time.monotonic`; seeds that were not timed
        by then are left out, and so is all if turns are too few.
        """
        made = self._all_stepped([(self._written, self._yards.finer), *models])
        turns, taken = list[Turn](), list[list[list[Floats]]]()
        for motions in tasks:
            self._begin_seeds(made, motions, turns, taken, until)
            if not taken or not _in_turns(turns, taken, until) or _all_narrow(_told(taken)):
                break
        if not taken or len(taken[0]) < _FEWEST:
            return []
        bases = [np.min([turn[0] for turn in each], axis=0).sum() for each in taken]
        self.base_seconds = float(np.mean(bases))
        return _told(taken)

    def _begin_seeds(
        self,
        made: Sequence[Stepped],
        motions: Sequence[Motion],
        turns: list["Turn"],
        taken: list[list[list[Floats]]],
        until: float,
    ) -> None:
        """Time each seed of motions as often as those before, while there is time."""
        often = len(taken[0]) if taken else 1
        for seed in range(motions[0].seeds):
            turn, own = self._turn(made, motions, seed), list[list[Floats]]()
            while len(own) < often:
                if time.monotonic() > until:
                    return
                own.append(turn.taken())
            turns.append(turn)
            taken.append(own)

    def _turn(self, made: Sequence[Stepped], motions: Sequence[Motion], seed: int) -> "Turn":
        """Return whole runs of a seed of motions by a model, and by others beside it."""
        finer = self._yards.finer
        return Turn(
            [
                Timed(
                    model,
                    [whole_run(each, finer, seed, multiple) for each in motions],
                    self._batches,
                )
                for model, multiple in made
            ]
        )

    def _all_stepped(self, models: Sequence[Stepped]) -> list[Stepped]:
        return [(self._stepped(*each), each[1]) for each in models]

    def _stepped(self, model: mujoco.MjModel, multiple: int) -> mujoco.MjModel:
        model.opt.timestep = multiple * self._yards.step
        return model

    def _timed(self, model: mujoco.MjModel, multiple: int) -> Timed:
        steps = max(2, round(self._stretch / (multiple * self._yards.step)))
        stretches = list[Stretch]()
        for yard in self._yards.parts:
            which = yard.starts
            places = np.linspace(0, len(which) - 1, min(self._places, len(which))).astype(int)
            begun = yard.begun(multiple, which[places], steps)
            stretches.append(Stretch(*begun, yard.motion.spec, steps))
        return Timed(self._stepped(model, multiple), stretches, self._batches)


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


def _in_turns(turns: Sequence[Turn], taken: list[list[list[Floats]]], until: float) -> bool:
    """Time all seeds in turns until these leave a narrow interval; False if time is over first."""
    begin = time.thread_time()
    while len(taken[0]) < _FEWEST or (
        len(taken[0]) < _MOST
        and (time.thread_time() < begin + _COMPARING or not _all_narrow(_told(taken, seeds=False)))
    ):
        if time.monotonic() > until:
            return False
        for seed, turn in enumerate(turns):
            taken[seed].append(turn.taken())
    return True


def whole_run(motion: Motion, finer: int, seed: int, multiple: int) -> Stretch:
    """Return a seed of a motion from its start to its end, by steps of so many fine ones."""
    run = at_steps(motion, finer, np.array([seed]), multiple)
    return Stretch(run.starts, run.inputs, run.spec, run.steps)


def over_seeds(base: Sequence[Floats], model: Sequence[Floats], *, seeds: bool = True) -> Price:
    """Return the ratio of the least times that all seeds take, and an interval by resampling.

    Args:
        base: for each seed, (T, P) times of pieces in turns, of the model as written.
        model: for each seed, (T, Q) of another model, in the same turns, which are drawn with
            replacement.
        seeds: whether seeds are drawn, too; else the interval is of these seeds.
    """
    generator, count = np.random.default_rng(0), len(base)
    turns = len(base[0])
    drawn = generator.integers(turns, size=(_RESAMPLED, turns))
    which = np.tile(np.arange(count), (_RESAMPLED, 1))
    if seeds:  # one less than there are: n drawn of n vary by n - 1 over n of what n others do
        which = generator.integers(count, size=(_RESAMPLED, max(1, count - 1)))
    row = np.arange(_RESAMPLED)[:, None]
    below, above = (
        np.stack([each[drawn].min(axis=1).sum(axis=1) for each in times], axis=1)[row, which]
        for times in (base, model)
    )
    found = above.sum(axis=1) / below.sum(axis=1)
    low, high = np.quantile(found, [_OUTSIDE / 2, 1 - _OUTSIDE / 2])
    whole, other = (sum(each.min(axis=0).sum() for each in times) for times in (base, model))
    ratio = float(other / whole)
    return Price(ratio, float(min(low, ratio)), float(max(high, ratio)))


def _told(taken: Sequence[Sequence[Sequence[Floats]]], *, seeds: bool = True) -> list[Price]:
    """Return the price of each model but the first, of its times by seed and turn."""
    base, *models = (
        [np.array([turn[place] for turn in turns]) for turns in taken]
        for place in range(len(taken[0][0]))
    )
    refused = Price(math.inf, math.inf, math.inf)
    return [
        over_seeds(base, model, seeds=seeds) if np.isfinite(model[0]).all() else refused
        for model in models
    ]


def _all_narrow(prices: Sequence[Price]) -> bool:
    return all(half_width(price) <= NARROW for price in prices)


def half_width(price: Price) -> float:
    """Return half the interval of a price, as a share of it."""
    return (price.high - price.low) / (2 * price.ratio)
