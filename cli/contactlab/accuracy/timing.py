"""The timing pass: every run alone, interleaved with the others, with nothing recorded.

It has its own rounds besides those of `contactlab.timing`, which compare models with the first one.
Here each run has an absolute time per simulated second and the distribution of its single steps,
and groups that cannot win end early. Both are columns of stores, and `timing_settings` hashes this
protocol: times of another one could not be compared with stored ones.
"""

import base64
import gc
import hashlib
import json
import math
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain
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
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import Timing
from contactlab.schema.sweep_schema import TimingRequest

# CPU time [s] of a run in a round, least and most, and most of its single steps.
MIN_SECONDS, MAX_SECONDS, STEP_SECONDS = 0.02, 0.1, 0.02
_TIME_FIELDS = ("time_min", "time_median", "step_p50", "step_p99", "compile_time")
Groups = Sequence[Sequence[str]]
Select = Callable[[Mapping[str, float]], Groups]
"""Selects the groups of runs, by id, to continue, from the CPU time per simulated time of runs."""
_WORK_FIELDS = ("steps", "iterations", "contacts", "rows")


def work_of_runs(scene: Scene, runs: Sequence[PlannedModel], watch: Watch) -> Iterator[Note]:
    """Yield a note of the work of each run, and of states along it from which to time it.

    The runs are of one structure and engine; `watch` is called before steps, to start their time
    limit. The models are those that are timed, so that the states fit them.
    """
    compiled = scene.written_model(runs[0].run)
    engine = _timing_engine(runs[0].run)
    for run in runs:
        model = scene.prepare(run.run, run.start, compiled).model
        work = engine.count_work(model, run.start, run.run.steps, watch)
        states = base64.b64encode(work.states.astype("<f8").tobytes()).decode() if work else ""
        yield {**work._asdict(), "states": states} if work else {}


def _timing_engine(run: RunSpec) -> TimesSteps:
    engine = engine_of(run)
    assert isinstance(engine, TimesSteps)
    return engine


def _decode_work(note: Note) -> Work:
    raw = np.frombuffer(base64.b64decode(note["states"]), dtype="<f8")
    states = raw.reshape(len(note["places"]), -1).astype(np.float64)
    return Work(*(note[name] for name in _WORK_FIELDS), places=tuple(note["places"]), states=states)


def timing_seconds(request: TimingRequest, steps: Sequence[int], per_step: float) -> float:
    """Return the time to measure runs with these numbers of steps, one after the other [s]."""
    seconds = [min(max(step * per_step, MIN_SECONDS), MAX_SECONDS) for step in steps]
    return request.rounds * (sum(seconds) + len(seconds) * STEP_SECONDS)


class _TimedPortion(NamedTuple):
    """Steps of each segment of a run that are timed in a round, repetitions, and single steps."""

    most: int
    repeats: int
    single: int


@dataclass
class InterleavedTimer:
    """Times runs of one scene in this process."""

    scene: Scene
    rounds: int  # most measurements of each run; within a round all take turns
    # Recorded actions of policies in runs, by id.
    controls: Mapping[str, RecordedControls] = field(default_factory=dict[str, RecordedControls])
    _compiled: dict[str, tuple[mujoco.MjModel, float]] = field(
        default_factory=dict[str, tuple[mujoco.MjModel, float]]
    )

    def time_runs(
        self,
        runs: Mapping[str, RunSpec],
        work: Mapping[str, Note],
        groups: Groups,
        select: Select,
        advance: Callable[[int], None],
    ) -> Iterator[tuple[str, Note]]:
        """Yield each run's id and times, after all rounds.

        The runs of a group share the time for one run. After each round, groups are selected for
        the next one from the median time of each run so far. `advance` is called with the number of
        finished or skipped turns.
        """
        silence_mujoco()
        counted_work = {run_id: _decode_work(work[run_id]) for run_id in runs}
        shares = {run_id: len(group) for group in groups for run_id in group}
        run_times: dict[str, list[tuple[float, float, float]]] = {run_id: [] for run_id in shares}

        def prepare_run(run_id: str) -> tuple[TimesSteps, Segments]:
            resolved = runs[run_id]
            return _timing_engine(resolved), self._timed_segments(
                run_id, resolved, counted_work[run_id]
            )

        with _no_garbage_collection():
            portions = {
                run_id: _choose_portion(*prepare_run(run_id), share)
                for run_id, share in shares.items()
            }
            for later in reversed(range(self.rounds)):
                for run_id in chain(*groups):
                    run_times[run_id].append(_measure_times(*prepare_run(run_id), portions[run_id]))
                    advance(1)
                before = sum(map(len, groups))
                groups = select(
                    {
                        key: median(time for time, *_ in measured_times)
                        for key, measured_times in run_times.items()
                    }
                )
                advance(later * (before - sum(map(len, groups))))
        for run_id, rounds in run_times.items():
            times, p50, p99 = zip(*rounds, strict=True)
            medians = (median(samples) for samples in (times, p50, p99))
            clocked = (min(times), *medians, self._compiled_model(runs[run_id])[1])
            yield run_id, dict(zip(_TIME_FIELDS, clocked, strict=True))

    def _timed_segments(self, run_id: str, resolved: RunSpec, work: Work) -> Segments:
        """Return the timed segments of a run; made again each time to limit memory."""
        start = self.scene.initial_states([resolved])
        if run_id in self.controls:
            start = start.with_recorded_inputs([self.controls[run_id]])
        model = self.scene.prepare(resolved, start, self._compiled_model(resolved)[0]).model
        return Segments(model, start, work)

    def _compiled_model(self, resolved: RunSpec) -> tuple[mujoco.MjModel, float]:
        """Return a run's compiled structure, and the least CPU time of compiling it [s]."""
        key = json.dumps([resolved.structure, sorted(resolved.without)])
        if key not in self._compiled:
            compiled = [_clocked_compile(self.scene, resolved) for _ in range(self.rounds)]
            self._compiled[key] = compiled[-1][0], min(seconds for _, seconds in compiled)
        return self._compiled[key]


def _clocked_compile(scene: Scene, resolved: RunSpec) -> tuple[mujoco.MjModel, float]:
    # MuJoCo compiles meshes on separate threads, which a thread's clock does not include.
    begin = time.process_time()
    compiled = scene.written_model(resolved)
    return compiled, time.process_time() - begin


def _measure_times(
    engine: TimesSteps, segments: Segments, portion: _TimedPortion
) -> tuple[float, float, float]:
    """Return the CPU time per simulated time, and of a step [s]: median, 99th percentile."""
    seconds, steps = engine.time_segments(segments, portion.most, portion.repeats)
    p50, p99 = np.quantile(engine.time_steps(segments, portion.single), (0.5, 0.99)).tolist()
    return seconds / (steps * segments.model.opt.timestep), p50, p99


def _choose_portion(engine: TimesSteps, segments: Segments, runs: int) -> _TimedPortion:
    """Return the timed portion of a run in a round, if `runs` runs share the time for one."""
    warm_steps, most_repeats, most_single_steps = 10, 50, 1000
    seconds, steps = engine.time_segments(segments, warm_steps, 1)
    cost = runs * max(seconds / steps, 1e-7)
    most = max(1, math.ceil(MAX_SECONDS / (cost * len(segments.work.places))))
    repeats = math.ceil(MIN_SECONDS / (cost * sum(segments.lengths(most))))
    single = min(most_single_steps / runs, STEP_SECONDS / cost) / len(segments.work.places)
    return _TimedPortion(most, min(most_repeats, max(1, repeats)), max(1, math.ceil(single)))


@contextmanager
def _no_garbage_collection() -> Generator[None]:
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def run_timings(
    runs: Mapping[str, RunSpec],
    request: TimingRequest,
    work: Mapping[str, Note],
    times: Mapping[str, Note],
) -> dict[str, Timing]:
    """Return times and work of every run for the table, by run id; null if missing."""
    settings = {
        "version": 1,
        "clock": "CPU time of one thread",
        "model": "as written, without sensors that record",
        "rounds": request.rounds,
        "seconds": [MIN_SECONDS, MAX_SECONDS, STEP_SECONDS],
        "places": SEGMENTS,
        **({"contenders": True} if request.contenders else {}),
    }
    settings_hash = hashlib.sha256(json.dumps(settings).encode()).hexdigest()[:16]
    timings: dict[str, Timing] = {}
    for run_id, resolved in runs.items():
        counted_work, clocked = work.get(run_id) or {}, times.get(run_id) or {}
        simulated = resolved.steps * resolved.timestep
        rates = {
            f"work_{name}": counted_work[name] / simulated if counted_work else None
            for name in _WORK_FIELDS
        }
        columns = {name: clocked.get(name) for name in _TIME_FIELDS}
        timings[run_id] = Timing(**columns, **rates, timing_settings=settings_hash)
    return timings
