"""The timing pass: every run by itself in this process, in turns, with nothing recorded."""

import gc
import json
import math
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from contactlab.engines import Segments, Work, time_segments, time_steps
from contactlab.run.job import Finished
from contactlab.run.jobs import Planned
from contactlab.run.notes import Note, note
from contactlab.run.timing_job import work_in
from contactlab.scene import (
    ResolvedRun,
    Scene,
    compile_without_sensors,
    prepare_without_sensors,
    silence_mujoco,
)

# CPU time of a run in a round, least and most, and of its single steps at most [s].
LEAST, MOST, SINGLE = 0.02, 0.1, 0.02
_MOST_REPEATS = 50
_MOST_SINGLE = 1000
_WARM_STEPS = 10


@dataclass(frozen=True)
class _Pace:
    """How much of a run is timed at once.

    Attributes:
        most: steps from each place.
        repeats: how often.
        single: steps from each place, one by one.
    """

    most: int
    repeats: int
    single: int


class _Taken(NamedTuple):
    """What a run took in one round.

    Attributes:
        time: CPU seconds per simulated second.
        half: CPU time of a single step, median [s].
        most: the same, 99th percentile [s].
    """

    time: float
    half: float
    most: float


@dataclass
class Stopwatch:
    """Times runs of one scene.

    Attributes:
        scene: theirs.
        rounds: how often each is timed; within a round all take turns.
    """

    scene: Scene
    rounds: int
    _compiled: dict[str, tuple[Any, float]] = field(default_factory=dict[str, tuple[Any, float]])

    def times(self, runs: Planned, work: Mapping[str, Note]) -> Iterator[Finished]:
        """Yield the times of each run, after all rounds.

        Args:
            runs: the runs.
            work: run id to what was counted of it.
        """
        silence_mujoco()
        todo = [(run.run_id, resolved, work_in(work[run.run_id])) for run, resolved in runs]
        with _undisturbed():
            paces = [_pace(self._segments(resolved, done)) for _, resolved, done in todo]
            rounds = [
                [
                    self._once(resolved, done, pace)
                    for (_, resolved, done), pace in zip(todo, paces, strict=True)
                ]
                for _ in range(self.rounds)
            ]
        for (run_id, resolved, _), taken in zip(todo, zip(*rounds, strict=True), strict=True):
            yield note("times", run_id, _summed(taken, self._model(resolved)[1]))

    def _once(self, resolved: ResolvedRun, work: Work, pace: _Pace) -> _Taken:
        segments = self._segments(resolved, work)
        seconds, steps = time_segments(segments, pace.most, pace.repeats)
        half, most = np.quantile(time_steps(segments, pace.single), (0.5, 0.99)).tolist()
        return _Taken(seconds / (steps * resolved.timestep), half, most)

    def _segments(self, resolved: ResolvedRun, work: Work) -> Segments:
        """Return what is timed of a run; made anew each time, so that memory does not grow."""
        start = self.scene.starts([resolved])
        model = prepare_without_sensors(self.scene, resolved, start, self._model(resolved)[0])
        return Segments(model, start, work.places, work.states, work.steps)

    def _model(self, resolved: ResolvedRun) -> tuple[Any, float]:
        """Return a run's compiled structure, and the least CPU time that compiling it took [s]."""
        key = json.dumps([resolved.structure, sorted(resolved.without)])
        if key not in self._compiled:
            made = [_clocked_compile(self.scene, resolved) for _ in range(self.rounds)]
            self._compiled[key] = made[-1][0], min(seconds for _, seconds in made)
        return self._compiled[key]


def _clocked_compile(scene: Scene, resolved: ResolvedRun) -> tuple[Any, float]:
    # The engine compiles meshes on threads of its own, which a thread's clock does not see.
    begin = time.process_time()
    compiled = compile_without_sensors(scene, resolved)
    return compiled, time.process_time() - begin


def _summed(rounds: Sequence[_Taken], compile_time: float) -> Note:
    times, halves, most = zip(*rounds, strict=True)
    return {
        "time_min": min(times),
        "time_median": median(times),
        "step_p50": median(halves),
        "step_p99": median(most),
        "compile_time": compile_time,
    }


def _pace(segments: Segments) -> _Pace:
    seconds, steps = time_segments(segments, _WARM_STEPS, 1)
    cost = max(seconds / steps, 1e-7)
    most = max(1, math.ceil(MOST / (cost * len(segments.places))))
    whole = cost * sum(segments.lengths(most))
    single = min(_MOST_SINGLE, SINGLE / cost) / len(segments.places)
    return _Pace(
        most=most,
        repeats=min(_MOST_REPEATS, max(1, math.ceil(LEAST / whole))),
        single=max(1, math.ceil(single)),
    )


@contextmanager
def _undisturbed() -> Generator[None]:
    """Keep the collector from running in the middle of a measurement."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
