"""Measures the cost of changed models as ratios of times, in turns from the same states.

Times are those of a plain loop of `mj_step`, as users run a model: with its sensors, and without
the replay of inputs. If MuJoCo gives up, it resets the model and goes on. Removed features are
timed on short segments. Ratios of written models are measured on whole runs of the task, with seeds
of the search and fresh ones: iterations depend on the motion, so that seeds differ by more than
turns do.
"""

import copy
import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.restarts import motion_at_steps
from contactlab.budget.step_work import UNIT_SECONDS, StepWork
from contactlab.contact.trace_arrays import Floats
from contactlab.scene.model_edits import set_timestep
from contactlab.schema.time_ratio import TimeRatio
from contactlab.tasks.reference_error import TaskReference
from contactlab.timing.interleaved import (
    TURN_SECONDS,
    Timer,
    TimingProtocol,
    ratios_of_rounds,
    ratios_of_samples,
    time_rounds,
    time_samples,
)

_SEGMENT_PROTOCOL = TimingProtocol(rounds=6)
"""Fewest rounds that hold a median with 95 %: turns of slow models are long, and disturbed less."""
_AUTORESET_OFF = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)


@dataclass(frozen=True)
class _SegmentLimits:
    """How many segments of a phase are timed, and their simulated time [s]."""

    least_count: int = 2  # one may be free of contacts
    most_count: int = 12
    least_seconds: float = 0.04  # a window of an error budget
    most_seconds: float = 0.2  # five windows


_LIMITS = _SegmentLimits()


class Segment(NamedTuple):
    """Segments of a phase: (M, nstate) initial states, and (M, steps, width) inputs."""

    starts: Floats
    inputs: Floats
    spec: int
    steps: int


class TimedModel:
    """A model that is ready to run through segments repeatedly.

    Attributes:
        simulated: simulated time of all timed steps [s].
    """

    def __init__(self, model: mujoco.MjModel, segments: Sequence[Segment]) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self._segments = segments
        steps = sum(len(each.starts) * (each.steps - 1) for each in segments)
        self.simulated = steps * float(model.opt.timestep)
        self._input_seconds = sum(
            len(each.starts) * (each.steps - 1) * self._measure_input_seconds(each)
            for each in segments
        )

    def _measure_input_seconds(self, segment: Segment) -> float:
        # Setting a recorded input takes as long as a step of a small model. A user sets controls.
        if not segment.inputs.shape[2] or not len(segment.starts):
            return 0.0
        row = segment.inputs[0, 0]
        spent = list[float]()
        input_rounds, inputs_in_a_round = 3, 40  # the fastest round is not disturbed
        for _ in range(input_rounds):
            begin = time.thread_time()
            for _ in range(inputs_in_a_round):
                mujoco.mj_setState(self._model, self._data, row, segment.spec)
            spent.append((time.thread_time() - begin) / inputs_in_a_round)
        return min(spent)

    def measure_cost(self) -> float:
        """Return the thread time of the steps of all segments over their simulated time.

        A segment begins with the caches of another one, so that its first step is not timed.
        Infinite if MuJoCo refuses the model, for example tendon equalities of sleeping bodies.
        """
        try:
            spent = sum(
                self._step_segment(segment, row)
                for segment in self._segments
                for row in range(len(segment.starts))
            )
        except mujoco.FatalError:
            return math.inf
        return (spent - self._input_seconds) / self.simulated

    def _step_segment(self, segment: Segment, row: int) -> float:
        model, data, spec, inputs = self._model, self._data, segment.spec, segment.inputs[row]
        mujoco.mj_resetData(model, data)  # wakes sleeping bodies
        mujoco.mj_setState(model, data, segment.starts[row], INTEGRATION)
        begin = 0.0
        for step in range(segment.steps):
            if step == 1:
                begin = time.thread_time()
            if inputs.shape[1]:
                mujoco.mj_setState(model, data, inputs[step], spec)
            mujoco.mj_step(model, data)
        return time.thread_time() - begin


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
        self._segment_count, self._segment_seconds = _LIMITS.most_count // 2, _LIMITS.least_seconds
        self.base_seconds = self._timed_model(self._written, reference.substeps).measure_cost()
        """Time of the model as written over simulated time."""
        # Counted time, so that a busy machine times the same segments, and plans the same rounds.
        self._counted_seconds = self._count_seconds(self._written, reference.substeps)
        turn_runs = TURN_SECONDS / self._counted_seconds / len(reference.phases)
        self._segment_count = max(
            _LIMITS.least_count,
            min(_LIMITS.most_count, math.ceil(turn_runs / _LIMITS.most_seconds)),
        )
        self._segment_seconds = min(
            _LIMITS.most_seconds, max(_LIMITS.least_seconds, turn_runs / self._segment_count)
        )

    @property
    def turn_seconds(self) -> float:
        """Counted time of a turn of the model as written [s]."""
        phases = len(self._reference.phases)
        return phases * self._segment_count * self._segment_seconds * self._counted_seconds

    def time_ratios(
        self, models: Sequence[ModelAtStep], protocol: TimingProtocol = _SEGMENT_PROTOCOL
    ) -> list[TimeRatio]:
        """Return the times of models over the time of the model as written, for the same motion."""
        all_models = [(self._written, self._reference.substeps), *models]
        round_times = time_rounds([self._build_timer(*each) for each in all_models], protocol)
        self.base_seconds = float(np.median(round_times[:, 0]))
        return ratios_of_rounds(round_times)

    def count_costs(self, models: Sequence[ModelAtStep]) -> list[float]:
        """Return the counted work of models over that of the model as written.

        It is the same under any load. A model that MuJoCo refuses has infinite work.
        """
        return [self._count_seconds(*each) / self._counted_seconds for each in models]

    def _count_seconds(self, model: mujoco.MjModel, multiple: int) -> float:
        stepped_model = self._with_step(model, multiple)
        data, work = mujoco.MjData(stepped_model), StepWork(stepped_model)
        counted_steps = 4  # from each state; the first, without a warm start, is left out
        for phase in self._reference.phases:
            count = min(_LIMITS.most_count, len(phase.starts))
            places = np.linspace(0, len(phase.starts) - 1, count).astype(int)
            starts_and_inputs = phase.starts_and_inputs(
                multiple, phase.starts[places], counted_steps
            )
            for start, inputs in zip(*starts_and_inputs, strict=True):
                mujoco.mj_resetData(stepped_model, data)  # wakes sleeping bodies
                mujoco.mj_setState(stepped_model, data, start, INTEGRATION)
                rows = inputs if inputs.shape[1] else None
                try:
                    work.count_steps(data, counted_steps, rows, phase.motion.spec)
                except mujoco.FatalError:
                    return math.inf
        seconds = float(work.total @ UNIT_SECONDS) / max(work.steps, 1)
        return seconds / float(stepped_model.opt.timestep)

    def time_whole_runs(
        self,
        models: Sequence[ModelAtStep],
        tasks: Iterable[Sequence[Motion]],
        may_continue: Callable[[], bool],
        fewest_seeds: int = 2,
    ) -> list[TimeRatio]:
        """Return the times of models over the time of the model as written, for whole runs.

        Seeds of one task after the other are run until the interval is narrow enough, or it may not
        continue. One seed shows no spread, and two have an interval that says little.
        """
        all_models = self._with_steps([(self._written, self._reference.substeps), *models])
        seeds = (
            self._whole_run_timers(all_models, motions, seed)
            for motions in tasks
            for seed in range(motions[0].seeds)
        )
        samples = [*time_samples(seeds, least=fewest_seeds, may_continue=may_continue)]
        self.base_seconds = float(np.mean(samples, axis=0)[0])
        return ratios_of_samples(samples)

    def _whole_run_timers(
        self, models: Sequence[ModelAtStep], motions: Sequence[Motion], seed: int
    ) -> list[Timer]:
        finer = self._reference.substeps
        return [
            TimedModel(
                model, [whole_run(each, finer, seed, multiple) for each in motions]
            ).measure_cost
            for model, multiple in models
        ]

    def _with_steps(self, models: Sequence[ModelAtStep]) -> list[ModelAtStep]:
        return [(self._with_step(*each), each[1]) for each in models]

    def _with_step(self, model: mujoco.MjModel, multiple: int) -> mujoco.MjModel:
        set_timestep(model, multiple * self._reference.step)
        model.opt.disableflags &= ~_AUTORESET_OFF  # as in files; recording never resets
        return model

    def _build_timer(self, model: mujoco.MjModel, multiple: int) -> Timer:
        return self._timed_model(model, multiple).measure_cost

    def _timed_model(self, model: mujoco.MjModel, multiple: int) -> TimedModel:
        steps = max(2, round(self._segment_seconds / (multiple * self._reference.step)))
        segments = list[Segment]()
        for phase in self._reference.phases:
            count = min(self._segment_count, len(phase.starts))
            places = np.linspace(0, len(phase.starts) - 1, count).astype(int)
            starts_and_inputs = phase.starts_and_inputs(multiple, phase.starts[places], steps)
            segments.append(Segment(*starts_and_inputs, phase.motion.spec, steps))
        return TimedModel(self._with_step(model, multiple), segments)


def whole_run(motion: Motion, finer: int, seed: int, multiple: int) -> Segment:
    """Return a seed of a motion from start to end, at a timestep of `multiple` fine steps."""
    run = motion_at_steps(motion, finer, np.array([seed]), multiple)
    return Segment(run.starts, run.inputs, run.spec, run.steps)
