"""Forecast of a sweep before it runs: number of runs, time, disk, and suspicious settings."""

import time
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from contactlab.accuracy.discretization import reference_steps
from contactlab.accuracy.timing import timing_seconds
from contactlab.advisories.met_advisories import describe_met_advisory
from contactlab.budget import backward_error
from contactlab.contact.contact_laws import refsafe_solref, stiffness_damping
from contactlab.engines import engine_of
from contactlab.engines.engine import ChecksRuns, PreparedRuns, bytes_of_run
from contactlab.plan.grid import Plan
from contactlab.plan.kept_traces import KeptTraces
from contactlab.plan.refined_axes import smallest_run_count
from contactlab.rendering.amounts import format_setting
from contactlab.run.planned_runs import RunIndex, reference_models
from contactlab.run.sweep_advisories import find_sweep_advisories
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.store_reports import PlannedAxis, SweepForecast

# Above this product of step and natural frequency, contacts gain energy under the Euler family.
_MAX_STEP_RATE = 0.8
_RUN_SAMPLES = 12
_SAMPLE_STEPS = 200
_MAX_CACHED = 1 << 12
# Steps for a checked run, in runs: a repetition, and windows of the run and of its references.
_CHECK_REPETITIONS, _CHECKED_STEPS = 8, 2
# Time with recording, metrics and traces over the time of stepping, least and most.
_OVERHEAD_FACTORS = (1.2, 2.5)
# Size of a trace, least and most, as a share of the recorded arrays.
_COMPRESSED_SHARES = {"messages": (0.1, 0.6), "compact": (0.03, 0.2)}


@dataclass
class _RunSums:
    """Sums over the runs, and a sample of them.

    `fast` runs have a timestep too long for a contact; `clamped` ones so long that refsafe changes
    their solref.
    """

    steps: int = 0
    bytes: int = 0
    fast: int = 0
    clamped: int = 0
    sampled: list[RunSpec] = field(default_factory=list[RunSpec])


def forecast_sweep(plan: Plan, scene: Scene, workers: int) -> SweepForecast:
    """Estimate the cost of a sweep from a few hundred steps of a few of its runs."""
    index = RunIndex(plan, scene)
    sums, sweep, workers = _sum_runs(index, scene), plan.sweep, max(1, workers)
    per_step = [_step_cost(scene, resolved) for resolved in sums.sampled] or [0.0]
    least, likely, most = np.quantile(per_step, (0.25, 0.5, 0.75)).tolist()
    share = sums.steps / workers
    accuracy = timing = 0.0
    if sweep.accuracy or sweep.timing:
        planned = list(index.iterate_runs())
        resolved = {run.run_id: run for run in planned}
        if sweep.accuracy:
            models = reference_models(scene, sweep, planned)
            steps = reference_steps(sweep.accuracy.refine, resolved, models, scene)
            accuracy = likely * steps / workers
        if sweep.timing:
            steps = [run.steps for run in resolved.values()]
            # Workers run these once more to count work, before they are timed.
            timing = likely * share + timing_seconds(sweep.timing, steps, likely)
    checks = 0.0
    if sweep.checks == "all" and sums.sampled:
        alone = _check_cost(scene, sums.sampled[0])
        checks = (alone * len(index) + _CHECK_REPETITIONS * likely * sums.steps) / workers
    passes = accuracy + timing
    fewest, all_kept = KeptTraces.read_rule(sweep.trace).share_bounds(len(index))
    sizes = {
        form: (sums.bytes * fewest * low, sums.bytes * all_kept * high)
        for form, (low, high) in _COMPRESSED_SHARES.items()
    }
    refine = sweep.refining
    return SweepForecast(
        axes=tuple(
            PlannedAxis(
                name=axis.name, role=axis.role, count=axis.count, values=_values_text(axis.values)
            )
            for axis in plan.axes
        ),
        seeds=len(sweep.seed_values),
        runs=len(index),
        least_runs=smallest_run_count(refine, len(index)) if refine else None,
        steps=sums.steps,
        seconds=(
            least * share * _OVERHEAD_FACTORS[0] + checks + passes,
            (most * share + checks) * _OVERHEAD_FACTORS[1] + passes,
        ),
        accuracy_seconds=accuracy,
        timing_seconds=timing,
        checks_seconds=checks,
        bytes=sizes[sweep.trace_format],
        bytes_by_format=sizes,
        trace=sweep.trace,
        trace_format=sweep.trace_format,
        warnings=(
            *_forecast_warnings(plan, len(index), sums),
            *(
                f"{share}: {describe_met_advisory(each)}"
                for each, share in find_sweep_advisories(index, scene)
            ),
        ),
    )


def _values_text(values: tuple[object, ...]) -> str:
    shown = values if len(values) <= 6 else (*values[:2], "...", values[-1])
    return ", ".join(map(format_setting, shown))


def _sum_runs(index: RunIndex, scene: Scene) -> _RunSums:
    sums, sizes = _RunSums(), dict[Hashable, int]()
    stride, runs = max(1, len(index) // _RUN_SAMPLES), 0
    for run, count in index.iterate_rows():
        steps, solref = run.steps, run.settings.get("solref")
        sums.steps += count * steps
        shape = (*run.structure.values(), run.without, steps)
        if shape not in sizes:
            sizes[shape] = bytes_of_run(scene.base_of(run).model, steps)
        sums.bytes += count * sizes[shape]
        if isinstance(solref, tuple):
            used = refsafe_solref(solref, run.timestep) if run.flags["refsafe"] else solref
            sums.fast += count * (
                round(run.timestep * _contact_frequency(used), 1) > _MAX_STEP_RATE
            )
            sums.clamped += count * (used != solref)
        # One sample for each multiple of the stride among the indices of the row's runs.
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
    """Return the CPU time of the check of a run, besides its steps [s]."""
    if not isinstance(engine_of(resolved), ChecksRuns):
        return 0.0
    runs = PreparedRuns.of(scene, resolved)
    begin = time.thread_time()
    backward_error(replace(runs, steps=min(runs.steps, _CHECKED_STEPS)), 0)
    return time.thread_time() - begin


def _forecast_warnings(plan: Plan, runs: int, sums: _RunSums) -> Iterator[str]:
    yield from (warning.message for warning in plan.warnings)
    if plan.count > runs:
        yield f"{plan.count - runs:,} runs are equal to others and run only once"
    if sums.fast:
        yield (
            f"in {sums.fast:,} of {runs:,} runs the timestep is too long for the contacts: "
            f"timestep / (timeconst * dampratio) is above {_MAX_STEP_RATE}, so contacts gain energy"
        )
    if sums.clamped:
        yield (
            f"in {sums.clamped:,} of {runs:,} runs refsafe raises the time constant of solref to "
            "2 timesteps, so the solref of the sweep is not used"
        )


@lru_cache(_MAX_CACHED)
def _contact_frequency(solref: tuple[float, ...]) -> float:
    return float(stiffness_damping(solref)[0]) ** 0.5
