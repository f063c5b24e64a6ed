"""Forecast of a sweep before it runs: number of runs, time, disk, and suspicious settings."""

import math
import os
import resource
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TypeGuard

import mujoco
import numpy as np

from contactlab.accuracy.discretization import reference_steps
from contactlab.accuracy.timing import timing_seconds
from contactlab.advisories.met_advisories import describe_met_advisory
from contactlab.contact.contact_laws import STABLE_STEP, refsafe_solref, stiffness_damping
from contactlab.engines import engine_of
from contactlab.engines.engine import PreparedRuns
from contactlab.errors import SweepFileError
from contactlab.mjcf import is_condition
from contactlab.plan.grid import Plan, SweptAxis
from contactlab.plan.kept_traces import KeptTraces
from contactlab.plan.refined_axes import smallest_run_count
from contactlab.rendering.amounts import format_amount, format_setting
from contactlab.run.planned_runs import RunIndex, reference_models
from contactlab.run.sampled_cost import sample_cost
from contactlab.run.sweep_advisories import find_sweep_advisories
from contactlab.run.sweep_request import SweepRequest
from contactlab.scene.contact_pairs import half_extents, touch_places
from contactlab.scene.floating_bases import find_falling_robot
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.scene.task import describe_excitation
from contactlab.schema.drive import PolicyDrive, acts_too_often, describe_drive
from contactlab.schema.store_reports import PlannedAxis, SweepForecast
from contactlab.schema.vocabulary import DROP_HEIGHT

# The shortest impact takes 10 steps: a time constant is at least 2 timesteps, and a ball is pressed
# in and thrown back within pi of them, and settles as long.
_FEWEST_STEPS = 10


@dataclass
class _RunSums:
    """Sums over the runs, and a sample of them.

    `fast` runs have a timestep too long for a contact; `clamped` ones so long that refsafe changes
    their solref; `late` ones so long that their policy cannot act at its rate.
    """

    steps: int = 0
    fast: int = 0
    clamped: int = 0
    late: int = 0
    short: int = 0
    sampled: list[RunSpec] = field(default_factory=list[RunSpec])


def forecast_sweep(request: SweepRequest) -> SweepForecast:
    """Estimate the cost of a sweep by recording a few of its runs.

    Time, memory and disk have no estimate if the runs execute code that is not allowed.
    """
    plan, scene, workers = request.plan, request.scene, max(1, request.workers)
    index = RunIndex(plan, scene)
    sums, sweep = _sum_runs(index), plan.sweep
    cost = None
    # Runs execute the code of a policy or of an environment.
    drive = scene.drive.drive
    runs_policy = isinstance(drive, PolicyDrive) and drive.runs_code
    runs_code = runs_policy or scene.source.environment is not None
    if sums.sampled and (request.allow_code or not runs_code):
        cost = sample_cost(request, index, sums.sampled)
    accuracy = timing = 0.0
    if sweep.accuracy or sweep.timing:
        steps_cost = np.median([_step_cost(scene, run) for run in sums.sampled[::4]]).item()
        runs = list(index.iterate_runs())
        resolved = {run.run_id: run for run in runs}
        if sweep.accuracy:
            models = reference_models(scene, sweep, runs)
            steps = reference_steps(sweep.accuracy.refine, resolved, models, scene)
            accuracy = steps_cost * steps / workers
        if sweep.timing:
            # If contenders are timed, one seed is enough, and only contending configurations count.
            seeds = sweep.seed_values[:1] if sweep.timing.contenders else sweep.seed_values
            steps = [run.steps for run in resolved.values() if run.seed in seeds]
            # Workers run these once more to count work, before they are timed.
            timing = steps_cost * sum(steps) / workers
            timing += timing_seconds(sweep.timing, steps, steps_cost)
    seconds = memory = None
    sizes = dict[str, tuple[float, float]]()
    if cost:
        recording = cost.cpu_seconds * sums.steps / _used_cores(workers, len(index))
        # CPU time to load the command, plan, and finish a store of few runs: 1.9 to 2.2 s measured.
        start_seconds = 2.0
        total = start_seconds + cost.first_seconds + recording + accuracy
        certain = 0.0 if sweep.timing and sweep.timing.contenders else timing
        # Sampled runs and busy machines: `bench.forecasts` measures the ratio.
        time_factor = 1.5
        seconds = (total + certain) / time_factor, (total + timing) * time_factor
        fewest, all_kept = KeptTraces.read_rule(sweep.trace).share_bounds(len(index))
        # Traces of sampled runs differ in size from those of the others by about as much.
        size_factor = 1.25
        sizes = {
            form: (
                bytes_per_step * sums.steps * fewest / size_factor,
                bytes_per_step * sums.steps * all_kept * size_factor,
            )
            for form, bytes_per_step in cost.trace_bytes.items()
        }
        # Linux reports the largest resident memory of this process in KiB. It has recorded runs as
        # a worker does; workers share everything that they load.
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 * (1 + request.workers)
    refine = sweep.refining
    return SweepForecast(
        axes=tuple(
            PlannedAxis(
                name=axis.name,
                role="scenario" if is_condition(axis.name) else axis.role,
                count=axis.count,
                values=_values_text(axis.values),
            )
            for axis in plan.axes
        ),
        start=_join_names(run.keyframe for run in sums.sampled),
        drive=_describe_drives(scene, sums.sampled, inferred=sweep.drive == "auto"),
        seeds=len(sweep.seed_values),
        runs=len(index),
        least_runs=smallest_run_count(refine, len(index)) if refine else None,
        steps=sums.steps,
        cores=_used_cores(workers, len(index)),
        seconds=seconds,
        checks_share=cost.checks_share if cost else 0.0,
        accuracy_seconds=accuracy,
        timing_seconds=timing,
        memory_bytes=memory,
        bytes=sizes.get(sweep.trace_format, (0.0, 0.0)) if cost else None,
        scene_bytes=scene.source.content.count_bytes(),
        # Descriptions of 150 columns, and compressed rows: 50 stores had 181 to 326 kB.
        table_bytes=200_000 + 400 * len(index),
        bytes_by_format=sizes,
        trace=sweep.trace,
        trace_format=sweep.trace_format,
        warnings=(
            *question_units(plan.axes, scene),  # first, since it may explain the others
            *_forecast_warnings(plan, scene, len(index), sums),
            *([] if scene.source.environment else _overlap_warnings(scene, sums.sampled)),
            *(
                f"{share}: {describe_met_advisory(each)}"
                for each, share in find_sweep_advisories(index, scene)
            ),
        ),
    )


def _used_cores(workers: int, runs: int) -> int:
    return max(1, min(workers, runs, os.cpu_count() or 1))


def _describe_drives(scene: Scene, sampled: Sequence[RunSpec], *, inferred: bool) -> str:
    drives = {run.drive for run in sampled if isinstance(run.drive, str)}
    words = _join_names(describe_drive(run.drive) for run in sampled)
    if drives == {"exercise"}:
        inputs = describe_excitation(scene.base(sampled[0].structure).model)
        words = f"a rest, then {inputs} (`drive: exercise`; `drive: none` leaves them out)"
    if not inferred:
        return words
    why = {"none": "its start has controls", "exercise": "no start sets its controls"}
    reasons = _join_names(why[drive] for drive in sorted(drives & why.keys()))
    return f"auto: {words}{reasons and f', because {reasons}'}"


def _values_text(values: tuple[object, ...]) -> str:
    shown_values = values if len(values) <= 6 else (*values[:2], "...", values[-1])
    return ", ".join(map(format_setting, shown_values))


def _sum_runs(index: RunIndex) -> _RunSums:
    sums = _RunSums()
    run_samples = 48  # evenly spread over the sweep: neighbors differ little
    stride, runs = max(1, len(index) // run_samples), 0
    for run, count in index.iterate_rows():
        steps, solref = run.steps, run.settings.get("solref")
        sums.steps += count * steps
        sums.short += count * (steps < _FEWEST_STEPS)
        if isinstance(solref, tuple):
            used_solref = refsafe_solref(solref, run.timestep) if run.flags["refsafe"] else solref
            sums.fast += count * (
                round(run.timestep * _contact_frequency(used_solref), 1) > STABLE_STEP
            )
            sums.clamped += count * (used_solref != solref)
        if isinstance(run.drive, PolicyDrive):
            sums.late += count * acts_too_often(run.drive.rate, run.timestep)
        # One sample for each multiple of the stride among the indices of the row's runs.
        samples = -(-(runs + count) // stride) - -(-runs // stride)
        sums.sampled += [replace(run, seed=seed) for seed in range(samples)]
        runs += count
    return sums


def _step_cost(scene: Scene, resolved: RunSpec) -> float:
    """Return the CPU time of a step [s]."""
    silence_mujoco()
    runs = PreparedRuns.of(scene, resolved)
    sample_steps = 200  # of a run in place of all: the forecast must not take long itself
    first_steps = replace(runs, steps=min(runs.steps, sample_steps))
    return engine_of(resolved).seconds_per_step(first_steps)


def _forecast_warnings(plan: Plan, scene: Scene, runs: int, sums: _RunSums) -> Iterator[str]:
    yield from (warning.message for warning in plan.warnings)
    if plan.count > runs:
        yield f"{plan.count - runs:,} runs are equal to others and run only once"
    if sums.fast:
        yield (
            f"in {sums.fast:,} of {runs:,} runs the timestep is too long for the contacts: "
            f"timestep / (timeconst * dampratio) is above {STABLE_STEP}, so contacts gain energy"
        )
    yield from _setting_warnings(sums, runs)
    yield from _warn_of_fall(scene)
    if sums.sampled and not (scene.source.manifest and scene.source.manifest.pairs):
        base = scene.base(sums.sampled[0].structure)
        count, monitored = len(touch_places(base.model)[0]), len(base.pairs)
        if count > monitored:
            yield (
                f"{monitored} of {count} pairs of geoms that can touch are monitored, the "
                "likeliest: no label judges the others and no axis changes them; list `pairs` in "
                "the scene's manifest to choose, and see ungraded_contacts of the runs"
            )


def warn_of_settings(request: SweepRequest, index: RunIndex) -> Iterator[str]:
    """Yield settings of a sweep's runs that look like another unit, or that runs replace."""
    yield from question_units(request.plan.axes, request.scene)
    yield from _setting_warnings(_sum_runs(index), len(index))
    yield from _warn_of_fall(request.scene)


def _warn_of_fall(scene: Scene) -> Iterator[str]:
    if robot := find_falling_robot(scene.base({}).model):
        yield (
            f"nothing is below the floating base {robot}: it falls for ever, and labels judge only "
            "contacts of its own links; sweep the scene that includes it, or add a floor"
        )


def _setting_warnings(sums: _RunSums, runs: int) -> Iterator[str]:
    if sums.clamped:
        yield (
            f"in {sums.clamped:,} of {runs:,} runs refsafe raises the time constant of solref to "
            "2 timesteps, so the solref of the sweep is not used"
        )
    if sums.short:
        yield (
            f"{sums.short:,} of {runs:,} runs have fewer than {_FEWEST_STEPS} steps, so labels "
            "judge almost nothing: write the `duration` in seconds or with a unit, 300 ms"
        )
    if sums.late:
        yield (
            f"in {sums.late:,} of {runs:,} runs a timestep is longer than the period of its "
            "controller, so they end as `invalid`: lower its rate or the timestep, or exclude them"
        )


def _join_names(names: Iterable[str]) -> str:
    unique_names, most = [*dict.fromkeys(names)], 4
    rest = [f"{len(unique_names) - most} more"] if len(unique_names) > most else []
    return ", ".join([*unique_names[:most], *rest])


def _overlap_warnings(scene: Scene, sampled: Sequence[RunSpec]) -> Iterator[str]:
    # More than a touch: 0.5 of half the thinner geom, where contacts start to push the wrong way.
    deep_share, most_runs = 0.5, 12
    chosen = list(
        {repr((run.keyframe, run.initial, run.structure)): run for run in sampled}.values()
    )
    chosen = chosen[:: max(1, len(chosen) // most_runs)]
    overlaps = list[tuple[float, str]]()
    for run in chosen:
        runs = PreparedRuns.of(scene, run)
        (model,), data = runs.models, mujoco.MjData(runs.models[0])
        data.qpos[:], data.qvel[:] = runs.starts.qpos[0], runs.starts.qvel[0]
        mujoco.mj_forward(model, data)
        halves, pairs = half_extents(model), data.contact.geom
        solid = (pairs >= 0).all(axis=1) if len(pairs) else np.zeros(0, bool)
        shares = np.where(solid, -data.contact.dist / halves[pairs].min(axis=1), 0.0)
        if len(shares) and shares.max() > deep_share:
            worst = int(np.argmax(shares))
            bodies = [model.body(model.geom_bodyid[geom]).name or "?" for geom in pairs[worst]]
            depth = format_amount(-float(data.contact.dist[worst]), "mm")
            overlaps.append((float(shares[worst]), f"{' and '.join(bodies)} by {depth}"))
    if overlaps:
        yield (
            f"in {len(overlaps)} of {len(chosen)} tried starts bodies begin deep inside each "
            f"other, {max(overlaps)[1]}: choose another `keyframe`, or a height"
        )


# Larger values are questioned, and refused from ten times as large: no contact lasts a second.
_LARGEST_VALUES = {"timestep": 0.1, "solref.timeconst": 0.5, "solimp.width": 0.1, "margin": 0.1}


def check_units(plan: Plan, scene: Scene) -> None:
    """Raise a SweepFileError if an axis has values that only make sense in another unit."""
    refused = [
        axis
        for axis in plan.axes
        if axis.name in _LARGEST_VALUES
        and max(map(abs, filter(is_number, axis.values)), default=0.0)
        >= 10 * _LARGEST_VALUES[axis.name]
    ]
    if questions := [*question_units(refused, scene)]:
        question_list = "\n".join(questions)
        raise SweepFileError(f"{question_list}\nValues without a unit are in SI units; write one")


def question_units(axes: Iterable[SweptAxis], scene: Scene) -> Iterator[str]:
    """Yield values of axes that look like another unit, with the value that may be meant."""
    longest, turn = 20.0, 2 * math.pi  # of a robot [m], of an angle [rad]
    for axis in axes:
        spec, numbers = scene.catalogue.find_axis(axis.name), [*filter(is_number, axis.values)]
        most, unit = max(map(abs, numbers), default=0.0), spec.unit if spec else ""
        if most > _LARGEST_VALUES.get(axis.name, math.inf):
            yield f"{axis.name} {most:g} {unit}: is {most:g} m{unit} meant? Write {most / 1e3:g}"
        elif unit == "m" and most > longest:
            yield f"{axis.name} {most:g} m: is {most:g} mm meant? Write {most / 1e3:g}"
        elif unit == "rad" and most > turn:
            yield f"{axis.name} {most:g} rad: are degrees meant? Write {math.radians(most):.4g}"
        if axis.name == DROP_HEIGHT and min(numbers, default=0.0) < 0:
            yield f"{axis.name} {min(numbers):g} m starts the free bodies below their written place"


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value is a number, and not a truth value."""
    return isinstance(value, float | int) and not isinstance(value, bool)


@lru_cache(1 << 12)
def _contact_frequency(solref: tuple[float, ...]) -> float:
    return float(stiffness_damping(solref)[0]) ** 0.5
