"""Forecast of a sweep before it runs: runs, time, disk; and settings that look wrong."""

import time
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from contactlab.accuracy.discretization import reference_steps
from contactlab.accuracy.timing import timing_seconds
from contactlab.budget import backward_error
from contactlab.contact.contact_laws import refsafe_solref, stiffness_damping
from contactlab.engines import engine_of
from contactlab.engines.engine import ChecksRuns, PreparedRuns, bytes_of_run
from contactlab.plan.grid import Plan
from contactlab.plan.kept_traces import KeptTraces
from contactlab.run.planned_runs import RunIndex, reference_models
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene

# Above this product of step and natural frequency, contacts gain energy under the Euler family.
_FASTEST = 0.8
_SAMPLES = 12
_SAMPLE_STEPS = 200
_MAX_CACHED = 1 << 12
# Steps of a run in one that is checked: once more, and in windows by itself and by references.
_CHECKED, _CHECKED_STEPS = 8, 2
# Recording, metrics and traces take so many times what stepping takes, least and most.
_OVERHEAD = (1.2, 2.5)
# Size of a trace, least and most, as a share of the recorded arrays.
_COMPRESSED = {"messages": (0.1, 0.6), "compact": (0.03, 0.2)}


@dataclass(frozen=True)
class Forecast:
    """The expected cost of a sweep of distinct runs, and warnings of settings that look wrong.

    Wall time [s] and size of the traces are estimated from below and above; of the time, some is
    for references and errors, some for times and work, some at least for checks of all runs. The
    size is told for every `trace_format` too, and is 0 where no trace is kept.
    """

    runs: int
    steps: int
    seconds: tuple[float, float]
    accuracy_seconds: float
    timing_seconds: float
    checks_seconds: float
    bytes: tuple[float, float]
    bytes_by_format: Mapping[str, tuple[float, float]]
    warnings: tuple[str, ...]


@dataclass
class _Sums:
    """Sums over the runs, and a sample of them.

    So many are too fast: their timestep is too long for a contact; or clamped: so long that refsafe
    changes its solref.
    """

    steps: int = 0
    bytes: int = 0
    fast: int = 0
    clamped: int = 0
    sampled: list[RunSpec] = field(default_factory=list[RunSpec])


def forecast(plan: Plan, scene: Scene, workers: int) -> Forecast:
    """Estimate the cost of a sweep from a few hundred steps of a few of its runs."""
    index = RunIndex(plan, scene)
    sums, sweep, workers = _summed(index, scene), plan.sweep, max(1, workers)
    per_step = [_step_cost(scene, resolved) for resolved in sums.sampled] or [0.0]
    least, likely, most = np.quantile(per_step, (0.25, 0.5, 0.75)).tolist()
    share = sums.steps / workers
    accuracy = timing = 0.0
    if sweep.accuracy or sweep.timing:
        planned = list(index.runs())
        resolved = {run.run_id: run for run in planned}
        if sweep.accuracy:
            models = reference_models(scene, sweep, planned)
            steps = reference_steps(sweep.accuracy.refine, resolved, models, scene)
            accuracy = likely * steps / workers
        if sweep.timing:
            steps = [run.steps for run in resolved.values()]
            # What is counted is run once more by the workers, before the clock runs.
            timing = likely * share + timing_seconds(sweep.timing, steps, likely)
    checks = 0.0
    if sweep.checks == "all" and sums.sampled:
        alone = _check_cost(scene, sums.sampled[0])
        checks = (alone * len(index) + _CHECKED * likely * sums.steps) / workers
    passes = accuracy + timing
    fewest, all_kept = KeptTraces.of(sweep.trace).shares(len(index))
    sizes = {
        form: (sums.bytes * fewest * low, sums.bytes * all_kept * high)
        for form, (low, high) in _COMPRESSED.items()
    }
    return Forecast(
        runs=len(index),
        steps=sums.steps,
        seconds=(
            least * share * _OVERHEAD[0] + checks + passes,
            (most * share + checks) * _OVERHEAD[1] + passes,
        ),
        accuracy_seconds=accuracy,
        timing_seconds=timing,
        checks_seconds=checks,
        bytes=sizes[sweep.trace_format],
        bytes_by_format=sizes,
        warnings=tuple(_warnings(plan, len(index), sums)),
    )


def _summed(index: RunIndex, scene: Scene) -> _Sums:
    sums, sizes = _Sums(), dict[Hashable, int]()
    stride, runs = max(1, len(index) // _SAMPLES), 0
    for run, count in index.rows():
        steps, solref = run.steps, run.settings.get("solref")
        sums.steps += count * steps
        shape = (*run.structure.values(), run.without, steps)
        if shape not in sizes:
            sizes[shape] = bytes_of_run(scene.base_of(run).model, steps)
        sums.bytes += count * sizes[shape]
        if isinstance(solref, tuple):
            used = refsafe_solref(solref, run.timestep) if run.flags["refsafe"] else solref
            sums.fast += count * (round(run.timestep * _frequency(used), 1) > _FASTEST)
            sums.clamped += count * (used != solref)
        # One for each multiple of the stride among the indices of the row's runs.
        samples = -(-(runs + count) // stride) - -(-runs // stride)
        sums.sampled += [replace(run, seed=seed) for seed in range(samples)]
        runs += count
    return sums


def _step_cost(scene: Scene, resolved: RunSpec) -> float:
    """Return the CPU time of a step [s]."""
    silence_mujoco()
    runs = PreparedRuns.of(scene, resolved)
    first_steps = replace(runs, steps=min(runs.steps, _SAMPLE_STEPS))
    return engine_of(resolved).seconds_per_step(first_steps)


def _check_cost(scene: Scene, resolved: RunSpec) -> float:
    """Return the CPU time that the check of a run takes beside its steps [s]."""
    if not isinstance(engine_of(resolved), ChecksRuns):
        return 0.0
    runs = PreparedRuns.of(scene, resolved)
    begin = time.thread_time()
    backward_error(replace(runs, steps=min(runs.steps, _CHECKED_STEPS)), 0)
    return time.thread_time() - begin


def _warnings(plan: Plan, runs: int, sums: _Sums) -> Iterator[str]:
    yield from (warning.message for warning in plan.warnings)
    if plan.count > runs:
        yield f"{plan.count - runs:,} runs are equal to others and run only once"
    if sums.fast:
        yield (
            f"in {sums.fast:,} of {runs:,} runs the timestep is too long for the contacts: "
            f"timestep / (timeconst * dampratio) is above {_FASTEST}, where contacts gain energy"
        )
    if sums.clamped:
        yield (
            f"in {sums.clamped:,} of {runs:,} runs refsafe raises the time constant of solref to "
            "2 timesteps, so that the solref of the sweep is not the one in use"
        )


@lru_cache(_MAX_CACHED)
def _frequency(solref: tuple[float, ...]) -> float:
    """Return the natural frequency of a contact [rad/s]."""
    return float(stiffness_damping(solref)[0]) ** 0.5
