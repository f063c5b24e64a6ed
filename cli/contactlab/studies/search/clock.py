"""Measures the cost of changed models as ratios of times, in turns from the same states.

Times are those of a plain loop of `mj_step`, as users run a model: with its sensors, and with the
overhead of Python. If MuJoCo gives up, it resets the model and goes on. Short segments steer the
search. Reported ratios are measured on whole runs of the task, with seeds of the search and fresh
ones: iterations depend on the motion, so that seeds differ by more than turns do.
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
from contactlab.contact.trace_arrays import Floats
from contactlab.schema.time_ratio import TimeRatio
from contactlab.tasks.reference_error import TaskReference, motion_at_steps

_MIN_SEGMENTS, _MAX_SEGMENTS = 4, 12  # states of each phase in which segments begin
_MAX_SEGMENT_SECONDS, _MIN_SEGMENT_SECONDS = 0.2, 0.04  # s of simulated time
_TURN_SECONDS = 0.01  # approximate s for which the model as written is timed in each turn
_MIN_TURN_SECONDS = 5e-3  # s for which the slowest model is timed in each turn
SLICE_SECONDS, _MAX_SLICES = (
    5e-4,
    200,
)  # s per slice: other processes seldom interrupt such a short one
_MAX_RUNS_PER_SLICE = 100  # runs per slice of a model that ends sooner
_MAX_COMPARISON_TURNS, _COMPARISON_SECONDS = (
    25,
    0.2,
)  # turns of two models; s of turns, if they are short
_MIN_ELAPSED = 1e-7  # s; a shorter time counts as this
_WHOLE_TURNS = 4  # turns of two models that are compared by whole runs
_SEED_TURNS = 3  # turns of a seed; one if time is short
_MIN_SEEDS, _ENOUGH_SEEDS = 2, 6  # seeds that show their spread, and seeds that show it well
_AUTORESET_OFF = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
MAX_HALF_WIDTH = 0.05
"""Target half-width of intervals, as a share of the ratio."""
_SIGNIFICANCE = 0.05
_RESAMPLINGS = 200


class Segment(NamedTuple):
    """Segments of a phase: (M, nstate) initial states, and (M, steps, width) inputs."""

    starts: Floats
    inputs: Floats
    spec: int
    steps: int


class TimedModel:
    """A model that is ready to run through segments repeatedly.

    Attributes:
        simulated: simulated time of all segments [s].
        total_seconds: estimated thread time of all slices [s]; infinite if MuJoCo refuses it.
        repeats: timings of each slice per turn.
        copies: copies of each slice.
    """

    def __init__(self, model: mujoco.MjModel, stretches: Sequence[Segment]) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self._runs = [(each, row) for each in stretches for row in range(len(each.starts))]
        steps = sum(len(each.starts) * (each.steps - 1) for each in stretches)
        self.simulated = steps * float(model.opt.timestep)
        self.repeats = self.copies = 1
        self._ends, self._often = list[list[int]](), list[int]()
        self.total_seconds = math.inf
        with suppress(mujoco.FatalError):
            once = [self._run_seconds(*run) for run in self._runs]
            for (stretch, _), spent in zip(self._runs, once, strict=True):
                pieces = max(1, min(_MAX_SLICES, stretch.steps - 1, round(spent / SLICE_SECONDS)))
                self._ends.append(np.linspace(1, stretch.steps, pieces + 1).astype(int).tolist())
                self._often.append(max(1, min(_MAX_RUNS_PER_SLICE, round(SLICE_SECONDS / spent))))
            self.total_seconds = float(np.dot(once, self._often))

    def elapsed(self) -> Floats:
        """Return (P,) thread time of the slices of all segments, over their simulated time.

        The least of the repeats of each slice counts: disturbances only add, and a slice is short
        enough to be undisturbed now and then. Infinite if MuJoCo refuses the model, for example
        tendon equalities of sleeping bodies.
        """
        if math.isinf(self.total_seconds):
            return np.full(1, np.inf)
        spent = np.concatenate([self._piece_seconds(place) for place in range(len(self._runs))])
        return np.maximum(spent, _MIN_ELAPSED) / self.simulated

    def _run_seconds(self, stretch: Segment, row: int) -> float:
        """Estimate the thread time of all steps of a run except the first [s]."""
        return max(self._step_segment(stretch, row, [1, stretch.steps])[0], _MIN_ELAPSED)

    def _piece_seconds(self, place: int) -> Floats:
        """Return (copies * slices,) thread time of all steps of a run except the first [s].

        A run begins with the caches of another one, so the first slice is run once before. If a
        slice consists of several runs, their mean counts.
        """
        stretch, row = self._runs[place]
        ends, often = self._ends[place], self._often[place]
        least = np.full((self.copies, len(ends) - 1), np.inf)
        self._step_segment(stretch, row, ends[:2])
        for _ in range(self.repeats):
            for own in least:
                runs = [self._step_segment(stretch, row, ends) for _ in range(often)]
                np.minimum(own, np.mean(runs, axis=0), out=own)
        return least.ravel() / self.copies

    def _step_segment(self, stretch: Segment, row: int, ends: Sequence[int]) -> list[float]:
        """Return the thread time between the given steps; the first part is not timed [s]."""
        model, data, spec = self._model, self._data, stretch.spec
        inputs, taken = stretch.inputs[row], list[float]()
        mujoco.mj_resetData(model, data)  # wakes sleeping bodies
        mujoco.mj_setState(model, data, stretch.starts[row], INTEGRATION)
        for first, last in itertools.pairwise([0, *ends]):
            begin = time.thread_time()
            for step in range(first, last):
                if inputs.shape[1]:
                    mujoco.mj_setState(model, data, inputs[step], spec)
                mujoco.mj_step(model, data)
            taken.append(time.thread_time() - begin)
        return taken[1:]


ModelAtStep = tuple[mujoco.MjModel, int]
"""A model, and its timestep in fine steps."""


class Clock:
    """Times models on segments of a task, spread over its phases.

    The clock sets the timesteps of the models that it gets, since copies of meshes are large.
    """

    def __init__(self, reference: TaskReference, base: mujoco.MjModel) -> None:
        """Take the model as written, compiled from its files."""
        self._reference, self._written = reference, copy.copy(base)
        # Segments that begin at rest or in flight have no contacts, so they are spread over the
        # phase.
        self._segment_count, self._segment_seconds = _MAX_SEGMENTS // 2, _MIN_SEGMENT_SECONDS
        self.base_seconds = float(
            self._timed_model(self._written, reference.substeps).elapsed().sum()
        )
        """Time of the model as written over simulated time."""
        wanted = _TURN_SECONDS / self.base_seconds / len(reference.phases)
        self._segment_count = max(
            _MIN_SEGMENTS, min(_MAX_SEGMENTS, math.ceil(wanted / _MAX_SEGMENT_SECONDS))
        )
        self._segment_seconds = min(
            _MAX_SEGMENT_SECONDS, max(_MIN_SEGMENT_SECONDS, wanted / self._segment_count)
        )

    def time_ratios(self, models: Sequence[ModelAtStep], turns: int = 4) -> list[TimeRatio]:
        """Return the times of models over the time of the model as written, for the same motion."""
        turn = InterleavedTimer(
            [
                self._timed_model(*each)
                for each in [(self._written, self._reference.substeps), *models]
            ]
        )
        taken = [turn.elapsed() for _ in range(turns)]
        self.base_seconds = float(np.min([each[0] for each in taken], axis=0).sum())
        return _ratios_over_turns(taken)

    def compare_segments(self, one: ModelAtStep, other: ModelAtStep, turns: int) -> TimeRatio:
        """Return the time of one model over the time of another, for the same motion.

        It takes at least `turns` turns, and more if they are short.
        """
        begin, taken = time.thread_time(), list[list[Floats]]()
        turn = InterleavedTimer([self._timed_model(*other), self._timed_model(*one)])
        while len(taken) < turns or (
            len(taken) < _MAX_COMPARISON_TURNS and time.thread_time() < begin + _COMPARISON_SECONDS
        ):
            taken.append(turn.elapsed())
        return _ratios_over_turns(taken)[0]

    def compare_whole_runs(self, one: ModelAtStep, other: ModelAtStep) -> TimeRatio:
        """Return the time of one model over the time of another, for whole runs of one seed."""
        motions = [part.motion for part in self._reference.phases]
        turn = self._whole_run_timer(self._with_steps([other, one]), motions, 0)
        return _ratios_over_turns([turn.elapsed() for _ in range(_WHOLE_TURNS)])[0]

    def time_whole_runs(
        self, models: Sequence[ModelAtStep], tasks: Iterable[Sequence[Motion]], until: float
    ) -> list[TimeRatio]:
        """Return the times of models over the time of the model as written, for whole runs.

        Seeds of one task after the other are run until the interval is narrow enough, or until the
        given time of `time.monotonic`. At least two are run, since one shows no spread.
        """
        made, taken = (
            self._with_steps([(self._written, self._reference.substeps), *models]),
            list[Floats](),
        )
        for motions in tasks:
            for seed in range(motions[0].seeds):
                if len(taken) < _MIN_SEEDS or time.monotonic() < until:
                    taken.append(_seed_seconds(self._whole_run_timer(made, motions, seed), until))
            late = len(taken) >= _MIN_SEEDS and time.monotonic() > until
            if late or (len(taken) >= _ENOUGH_SEEDS and _all_narrow(_ratios_over_seeds(taken))):
                break
        self.base_seconds = float(np.mean(taken, axis=0)[0])
        return _ratios_over_seeds(taken)

    def _whole_run_timer(
        self, made: Sequence[ModelAtStep], motions: Sequence[Motion], seed: int
    ) -> "InterleavedTimer":
        """Return a timer of whole runs of one seed by several models."""
        finer = self._reference.substeps
        return InterleavedTimer(
            [
                TimedModel(model, [whole_run(each, finer, seed, multiple) for each in motions])
                for model, multiple in made
            ]
        )

    def _with_steps(self, models: Sequence[ModelAtStep]) -> list[ModelAtStep]:
        return [(self._step_segment(*each), each[1]) for each in models]

    def _step_segment(self, model: mujoco.MjModel, multiple: int) -> mujoco.MjModel:
        model.opt.timestep = multiple * self._reference.step
        model.opt.disableflags &= ~_AUTORESET_OFF  # as in files; recording never resets
        return model

    def _timed_model(self, model: mujoco.MjModel, multiple: int) -> TimedModel:
        steps = max(2, round(self._segment_seconds / (multiple * self._reference.step)))
        stretches = list[Segment]()
        for yard in self._reference.phases:
            which = yard.starts
            places = np.linspace(0, len(which) - 1, min(self._segment_count, len(which))).astype(
                int
            )
            begun = yard.starts_and_inputs(multiple, which[places], steps)
            stretches.append(Segment(*begun, yard.motion.spec, steps))
        return TimedModel(self._step_segment(model, multiple), stretches)


class InterleavedTimer:
    """Times models in turns, from the first to the last and back again.

    A slice of a fast model takes as long as one of a slow model and is timed as often. Few slices
    have copies: the minimum over more copies would be less disturbed, and a sum of fewer is chance.
    """

    def __init__(self, timed: Sequence[TimedModel]) -> None:
        self._timed_model, self._backwards = timed, False
        slowest = max(
            (one.total_seconds for one in timed if math.isfinite(one.total_seconds)),
            default=_MIN_TURN_SECONDS,
        )
        for one in timed:
            one.repeats = max(1, math.ceil(_MIN_TURN_SECONDS / slowest))
            if math.isfinite(one.total_seconds):
                one.copies = max(1, round(min(slowest, _MIN_TURN_SECONDS) / one.total_seconds))

    def elapsed(self) -> list[Floats]:
        """Return the times of the slices of each model; see `TimedModel.elapsed`."""
        found = [np.empty(0)] * len(self._timed_model)
        places = range(len(found))
        for place in reversed(places) if self._backwards else places:
            found[place] = self._timed_model[place].elapsed()
        self._backwards = not self._backwards
        return found


def _seed_seconds(turn: InterleavedTimer, until: float) -> Floats:
    """Return the time of each model for a seed, from one turn if time is short."""
    begin, least = time.monotonic(), turn.elapsed()
    lasts = time.monotonic() - begin
    often = _SEED_TURNS if begin + _ENOUGH_SEEDS * _SEED_TURNS * lasts < until else 1
    for _ in range(often - 1):
        least = [np.minimum(*each) for each in zip(least, turn.elapsed(), strict=True)]
    return np.array([pieces.sum() for pieces in least])


def whole_run(motion: Motion, finer: int, seed: int, multiple: int) -> Segment:
    """Return a seed of a motion from start to end, at a timestep of `multiple` fine steps."""
    run = motion_at_steps(motion, finer, np.array([seed]), multiple)
    return Segment(run.starts, run.inputs, run.spec, run.steps)


def ratio_over_turns(base: Floats, model: Floats) -> TimeRatio:
    """Return the ratio of the least slice times, with an interval by resampling turns.

    Args:
        base: (T, P) slice times by turn, of the model as written.
        model: (T, Q) of another model, in the same turns.
    """
    turns = len(base)
    drawn = np.random.default_rng(0).integers(turns, size=(_RESAMPLINGS, turns))
    below, above = (each[drawn].min(axis=1).sum(axis=1) for each in (base, model))
    ratio = float(model.min(axis=0).sum() / base.min(axis=0).sum())
    low, high = np.quantile(above / below, [_SIGNIFICANCE / 2, 1 - _SIGNIFICANCE / 2])
    return TimeRatio.of(ratio, float(min(low, ratio)), float(max(high, ratio)))


def ratio_over_seeds(base: Floats, model: Floats) -> TimeRatio:
    """Return the ratio of the total times of all seeds, with an interval over seeds.

    Each seed is timed separately, so that differences of seeds contain the noise of times. For a
    ratio of sums, the deviation of a seed is its residual, in first order (W. G. Cochran, Sampling
    Techniques, 1977, 6.4), with n - 1 degrees of freedom.

    Args:
        base: (n,) times of seeds, of the model as written.
        model: (n,) of another model.
    """
    count, ratio = len(base), float(model.sum() / base.sum())
    off = model / ratio - base
    share = math.sqrt(count / (count - 1) * float(off @ off)) / float(base.sum())
    half = float(stdtrit(count - 1, 1 - _SIGNIFICANCE / 2)) * share
    return TimeRatio.of(ratio, ratio * math.exp(-half), ratio * math.exp(half))


_INFINITE_RATIO = TimeRatio.of(math.inf, math.inf, math.inf)


def _ratios_over_seeds(taken: Sequence[Floats]) -> list[TimeRatio]:
    """Return the time ratio of each model to the first, from times by seed."""
    base, *models = np.array(taken).T
    return [
        ratio_over_seeds(base, one) if np.isfinite(one).all() else _INFINITE_RATIO for one in models
    ]


def _ratios_over_turns(taken: Sequence[Sequence[Floats]]) -> list[TimeRatio]:
    """Return the time ratio of each model to the first, from times by turn."""
    base, *models = (np.array(turns) for turns in zip(*taken, strict=True))
    return [
        ratio_over_turns(base, one) if np.isfinite(one).all() else _INFINITE_RATIO for one in models
    ]


def _all_narrow(prices: Sequence[TimeRatio]) -> bool:
    return all(price.half_width <= MAX_HALF_WIDTH for price in prices)
