"""Measures the time of changed models over that of the original, in turns from the same states."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from contactlab.budget.motion import Motion
from contactlab.budget.windows import Batch, Run, start_rows
from contactlab.contact.trace_arrays import Floats
from contactlab.schema.time_ratio import TimeRatio
from contactlab.timing.interleaved import (
    TURN_SECONDS,
    TimingProtocol,
    compare_times,
    stopwatch,
)

Made = Callable[[], mujoco.MjModel]


QUICK_PROTOCOL = TimingProtocol(rounds=6, looks=1)
"""For ratios that are shown next to an effect and decide nothing: an interval of 95 %, once."""


def measure_time_ratios(
    motion: Motion,
    run: Run,
    changed: Mapping[str, tuple[Made, int]],
    protocol: TimingProtocol | None = None,
) -> dict[str, TimeRatio]:
    """Return the time of changed models over that of the model as written.

    Each is rolled out on one thread from the same states, which are spread over the run, in turns
    with the others. The number is that of its steps in one of the run. Models that take much memory
    together are timed in groups.
    """
    # Windows that the engine finished are the beginning of each run.
    most_windows = 5  # in a stretch, so that setting states is no part of the time
    length = min(most_windows, int(run.valid.sum(axis=1).max()))
    if not length or not changed:
        return {}
    # Fewer of a slow model, so that a turn has several places of the run.
    one = _Stretches(motion, run, run.steps).prepare_batch(
        motion.model, 1, np.argwhere(run.valid)[:1]
    )
    one.measure_seconds()  # loads its memory
    turn_places = 3
    length = min(length, max(1, math.ceil(TURN_SECONDS / (turn_places * one.measure_seconds()))))
    valid = np.argwhere(run.valid[:, length - 1 :])
    stretches = _Stretches(motion, run, length * run.steps)
    timed_places = valid[:1]
    # One place tells roughly how many are enough, and these tell it better.
    for _ in range(2):
        own = stretches.prepare_batch(motion.model, 1, timed_places)
        count = max(1, math.ceil(TURN_SECONDS / (own.measure_seconds() / len(timed_places))))
        few = np.linspace(0, len(valid) - 1, min(count, len(valid))).astype(int)
        timed_places = np.resize(valid[few], (max(count, len(few)), 2))
    own = stretches.prepare_batch(motion.model, 1, timed_places)
    held_bytes = 1 << 27  # of models at a time
    most = max(1, held_bytes // motion.model.nbuffer)
    ratios = dict[str, TimeRatio]()
    for begin in range(0, len(changed), most):
        names = [*changed][begin : begin + most]
        model_makers = [changed[name] for name in names]
        group = [
            stretches.prepare_batch(model(), rate, timed_places) for model, rate in model_makers
        ]
        timers = [each.measure_seconds for each in (own, *group)]
        ratios |= zip(names, compare_times(timers, protocol), strict=True)
    return ratios


class _TimedBatch(NamedTuple):
    """A batch, which has a copy of its model, the states that it begins in, and its inputs."""

    batch: Batch
    starts: Floats
    steps: int
    inputs: dict[str, Any]

    def measure_seconds(self) -> float:
        """Return its thread time [s]."""
        self.batch.state[:] = self.starts
        return stopwatch(lambda: self.batch.rollout(self.steps, record=[], **self.inputs))()


class _Stretches(NamedTuple):
    """Parts of a motion with a number of steps, which begin where windows begin."""

    motion: Motion
    run: Run
    steps: int

    def prepare_batch(self, model: mujoco.MjModel, rate: int, which: np.ndarray) -> _TimedBatch:
        """Return a model to be timed from (M, 2) seeds and windows."""
        seeds, windows = which.T
        starts = self.run.starts[seeds, windows]
        spans = self.run.begins[windows][:, None] + np.arange(self.steps)
        rows = [self.motion.rows(seed, span) for seed, span in zip(seeds, spans, strict=True)]
        input_options: dict[str, Any] = {}
        if rows[0] is not None:
            inputs = np.stack([row for row in rows if row is not None]).repeat(rate, axis=1)
            input_options = {"control": inputs, "control_spec": self.motion.spec}
        return _TimedBatch(start_rows(model, starts, 1), starts, self.steps * rate, input_options)
