"""The timing pass: every run by itself, interleaved with the others, with nothing recorded."""

import base64
import gc
import hashlib
import json
import math
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from statistics import median
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.accuracy.discretization import Note
from contactlab.accuracy.reference import PlannedModel
from contactlab.contact.trace_arrays import RecordedControls
from contactlab.engines import engine_of
from contactlab.engines.engine import SEGMENTS, Segments, TimesSteps, Watch, Work
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.scene.resolution import ResolvedRun
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import Timing
from contactlab.schema.sweep_schema import TimingRequest

# CPU time of a run in a round, least and most, and of its single steps at most [s].
MIN_SECONDS, MAX_SECONDS, STEP_SECONDS = 0.02, 0.1, 0.02
_MAX_REPEATS = 50
_MAX_SINGLE_STEPS = 1000
_WARM_STEPS = 10
_CLOCKED = ("time_min", "time_median", "step_p50", "step_p99", "compile_time")
_COUNTED = ("steps", "iterations", "contacts", "rows")


def work_of_runs(scene: Scene, runs: Sequence[PlannedModel], watch: Watch) -> Iterator[Note]:
    """Yield a note of the work of each run, and of states along it from which to time it.

    The runs are of one structure and engine; `watch` is called before steps, to start their time
    limit. The models are those that are timed, so that the states fit them.
    """
    compiled = scene.compile_without_sensors(runs[0].resolved)
    engine = _timing_engine(runs[0].resolved)
    for run in runs:
        model = scene.prepare(run.resolved, run.start, compiled).model
        work = engine.count_work(model, run.start, run.resolved.steps, watch)
        states = base64.b64encode(work.states.astype("<f8").tobytes()).decode() if work else ""
        yield {**work._asdict(), "states": states} if work else {}


def _timing_engine(run: ResolvedRun) -> TimesSteps:
    engine = engine_of(run)
    assert isinstance(engine, TimesSteps)
    return engine


def _work_of(note: Note) -> Work:
    raw = np.frombuffer(base64.b64decode(note["states"]), dtype="<f8")
    states = raw.reshape(len(note["places"]), -1).astype(np.float64)
    counts = (note[name] for name in _COUNTED)
    return Work(*counts, places=tuple(note["places"]), states=states)


def timing_seconds(request: TimingRequest, steps: Sequence[int], per_step: float) -> float:
    """Return how long it takes to time runs of so many steps, one after the other [s]."""
    seconds = [min(max(each * per_step, MIN_SECONDS), MAX_SECONDS) for each in steps]
    return request.rounds * (sum(seconds) + len(seconds) * STEP_SECONDS)


class _Portion(NamedTuple):
    """How many steps of each segment of a run are timed in a round, how often, and one by one."""

    most: int
    repeats: int
    single: int


@dataclass
class InterleavedTimer:
    """Times runs of one scene in this process."""

    scene: Scene
    rounds: int  # how often each is timed; within a round all take turns
    # What policies did in runs, by id.
    controls: Mapping[str, RecordedControls] = field(default_factory=dict[str, RecordedControls])
    _compiled: dict[str, tuple[mujoco.MjModel, float]] = field(
        default_factory=dict[str, tuple[mujoco.MjModel, float]]
    )

    def times(
        self, runs: Mapping[str, ResolvedRun], work: Mapping[str, Note]
    ) -> Iterator[tuple[str, Note]]:
        """Yield each run's id and times, after all rounds."""
        silence_mujoco()
        counted = [(run_id, each, _work_of(work[run_id])) for run_id, each in runs.items()]
        with _no_garbage_collection():
            portions = [
                _portion(_timing_engine(resolved), self._segments(run_id, resolved, done))
                for run_id, resolved, done in counted
            ]
            rounds = [
                [
                    self._time(self._segments(run_id, resolved, done), resolved, portion)
                    for (run_id, resolved, done), portion in zip(counted, portions, strict=True)
                ]
                for _ in range(self.rounds)
            ]
        for (run_id, resolved), taken in zip(runs.items(), zip(*rounds, strict=True), strict=True):
            times, p50, p99 = zip(*taken, strict=True)
            medians = (median(each) for each in (times, p50, p99))
            clocked = (min(times), *medians, self._model(resolved)[1])
            yield run_id, dict(zip(_CLOCKED, clocked, strict=True))

    def _time(
        self, segments: Segments, resolved: ResolvedRun, portion: _Portion
    ) -> tuple[float, float, float]:
        """Return the CPU time per simulated time, and of a step [s]: median, 99th percentile."""
        engine = _timing_engine(resolved)
        seconds, steps = engine.time_segments(segments, portion.most, portion.repeats)
        single = engine.time_steps(segments, portion.single)
        p50, p99 = np.quantile(single, (0.5, 0.99)).tolist()
        return seconds / (steps * resolved.timestep), p50, p99

    def _segments(self, run_id: str, resolved: ResolvedRun, work: Work) -> Segments:
        """Return what is timed of a run; made anew each time, so that memory does not grow."""
        start = self.scene.starts([resolved])
        if run_id in self.controls:
            start = start.acted_on([self.controls[run_id]])
        model = self.scene.prepare(resolved, start, self._model(resolved)[0]).model
        return Segments(model, start, work)

    def _model(self, resolved: ResolvedRun) -> tuple[mujoco.MjModel, float]:
        """Return a run's compiled structure, and the least CPU time that compiling it took [s]."""
        key = json.dumps([resolved.structure, sorted(resolved.without)])
        if key not in self._compiled:
            compiled = [_clocked_compile(self.scene, resolved) for _ in range(self.rounds)]
            self._compiled[key] = compiled[-1][0], min(seconds for _, seconds in compiled)
        return self._compiled[key]


def _clocked_compile(scene: Scene, resolved: ResolvedRun) -> tuple[mujoco.MjModel, float]:
    # MuJoCo compiles meshes on threads of its own, which a thread's clock does not see.
    begin = time.process_time()
    compiled = scene.compile_without_sensors(resolved)
    return compiled, time.process_time() - begin


def _portion(engine: TimesSteps, segments: Segments) -> _Portion:
    seconds, steps = engine.time_segments(segments, _WARM_STEPS, 1)
    cost = max(seconds / steps, 1e-7)
    most = max(1, math.ceil(MAX_SECONDS / (cost * len(segments.work.places))))
    repeats = math.ceil(MIN_SECONDS / (cost * sum(segments.lengths(most))))
    single = min(_MAX_SINGLE_STEPS, STEP_SECONDS / cost) / len(segments.work.places)
    return _Portion(most, min(_MAX_REPEATS, max(1, repeats)), max(1, math.ceil(single)))


@contextmanager
def _no_garbage_collection() -> Generator[None]:
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def timings(
    runs: Mapping[str, ResolvedRun],
    rounds: int,
    work: Mapping[str, Note],
    times: Mapping[str, Note],
) -> dict[str, Timing]:
    """Return times and work of every run as the table has them, by run id; null where missing."""
    settings = {
        "version": 1,
        "clock": "CPU time of one thread",
        "model": "as written, without sensors that record",
        "rounds": rounds,
        "seconds": [MIN_SECONDS, MAX_SECONDS, STEP_SECONDS],
        "places": SEGMENTS,
    }
    settings_hash = hashlib.sha256(json.dumps(settings).encode()).hexdigest()[:16]
    found: dict[str, Timing] = {}
    for run_id, resolved in runs.items():
        counted, clocked = work.get(run_id) or {}, times.get(run_id) or {}
        simulated = resolved.steps * resolved.timestep
        rates = {
            f"work_{name}": counted[name] / simulated if counted else None for name in _COUNTED
        }
        columns = {name: clocked.get(name) for name in _CLOCKED}
        found[run_id] = Timing(**columns, **rates, timing_settings=settings_hash)
    return found
