"""Checks of the model's own runs and bodies.

Is each run the motion of its model, and free of failure labels? Does it meet its requirements? Can
its bodies exist? Does it repeat bit for bit?
"""

import math

from contactlab.budget import PhaseBudget
from contactlab.judge.limits import PERCENT, Limit
from contactlab.measure import METRICS, labels_with
from contactlab.rendering.amounts import format_percent
from contactlab.scene.body_inertia import (
    IMPOSSIBLE,
    in_words,
    inertia_faults,
    scene_inertia_faults,
)
from contactlab.schema.check_report import Measure, Reference
from contactlab.studies.check.check_entries import Measured, check
from contactlab.tasks.checked_model import TASK_STORE, CheckedModel, CheckedRun


@check(
    "task",
    question="in every phase, the run is the motion of its model, and has no failure label",
    place=1,
    limits=(
        Limit("numerical_error", "1", "gate", printed_unit=PERCENT),
        Limit("energy_drift", "1", "gate", printed_unit=PERCENT),
        Limit("failure_labels", "1", "gate", 0),
    ),
)
def check_task(checked: CheckedModel) -> Measured:
    """Judge the phases of the task one by one, and count the runs with failure labels."""
    verdict, task = checked.verdict, checked.task
    phases = checked.budget.phases if checked.moves else ()
    measures = [_measure_error(checked, phase) for phase in phases]
    measures += [
        checked.measure(
            "energy_drift",
            abs(phase.energy_drift),
            f"{phase.energy_origin.body}, {phase.name}",
            limit=task.tolerance,
        )
        for phase in phases
    ]
    for phase in verdict.phases:
        for label, runs in phase.labels.items():
            measures.append(checked.measure("failure_labels", runs, f"{label}, {phase.name}"))
    if not any(phase.labels for phase in verdict.phases):
        measures.append(checked.measure("failure_labels", 0))
    notes = [] if verdict.is_accurate else [verdict.sentence]
    return Measured(measures, notes, checked.stores(TASK_STORE))


def _measure_error(checked: CheckedModel, phase: PhaseBudget) -> Measure:
    # Its upper bound if the references differ.
    tolerance, error, bound = checked.task.tolerance, phase.run.error, ""
    if phase.warnings:
        error = math.inf
    elif phase.invalid_windows:
        error = math.nan  # not measured, which exceeds every limit
    elif error <= tolerance < phase.doubt:
        error, bound = phase.upper_bound, ", at most"
    where = f"{phase.bodies[phase.run.body]}, {phase.name}{bound}"
    return checked.measure("numerical_error", error, where, limit=tolerance)


@check(
    "requirements",
    question="every requirement of the scene and of --require is met",
    place=2,
    limits=(Limit("requirements_broken", "1", "gate", 0),),
)
def check_requirements(checked: CheckedModel) -> Measured:
    """Look for requirements of the scene or the request that a run does not meet."""
    manifest = checked.scene.source.manifest
    required = checked.options.require or (manifest.must if manifest else ())
    if not required:
        return Measured([], ["no requirements: --require and `must:` set them"])
    labels = labels_with("required")
    measures: list[Measure] = []
    notes: list[str] = []
    for run in checked.runs:
        broken = [entry for entry in run.record.labels if entry.label in labels]
        seed = f"seed {run.record.seed}"
        measures.append(checked.measure("requirements_broken", float(bool(broken)), seed))
        notes += [f"{seed}: {entry.reason}" for entry in broken]
    return Measured(measures, notes, checked.stores(TASK_STORE))


@check(
    "inertia",
    question="each body can exist: its inertia is that of some mass, within its shape",
    place=3,
    limits=(Limit("impossible_bodies", "1", "gate", 0),),
    findings=("inertia_not_positive", "inertia_triangle", "inertia_balanced"),
)
def check_inertia(checked: CheckedModel) -> Measured:
    """Judge the mass and inertia of each body that moves, as written and as simulated."""
    written_faults = scene_inertia_faults(
        checked.scene.source, checked.resolved.structure, checked.base.model
    )
    all_faults = (*inertia_faults(checked.prepared.model), *written_faults)
    faults = {(fault.body, fault.kind): fault for fault in all_faults}.values()
    impossible = [
        Measure(
            name=f"inertia_{fault.kind}",
            of=fault.body,
            value=fault.value,
            unit=fault.unit,
            limit=float(fault.limit),
            holds=False,
            level="gate",
        )
        for fault in faults
        if fault.kind in IMPOSSIBLE
    ]
    bodies = {measure.of for measure in impossible}
    measures = [checked.measure("impossible_bodies", len(bodies)), *impossible]
    return Measured(measures, list(in_words(faults)))


# Largest accepted relative difference between one environment and many in parallel.
TOLERANCE = 0.05


@check(
    "repeat",
    question="the same run in another process is the same bit for bit",
    place=4,
    limits=(Limit("trajectories_differ", "1", "gate", 0),),
)
def check_repeat(checked: CheckedModel) -> Measured:
    """Run the model again in another process, and compare the trajectories."""
    first = checked.runs[0].record
    if first.trajectory_hash is None:
        reason = f"the model could not be run: {first.status_reason}"
        return Measured([], [reason], checked.stores(TASK_STORE))
    (again,) = checked.elsewhere(1).run("repeat", "The model once more", checks="none")
    unequal = first.trajectory_hash != again.record.trajectory_hash
    differing = {"in another process": float(unequal)}
    if (repeats := first.metrics.get("repeats")) is not None:
        differing["in the same process"] = 1.0 - repeats
    measures = [
        checked.measure("trajectories_differ", value, where) for where, value in differing.items()
    ]
    within = format_percent(TOLERANCE)
    note = f"reference.json has the run that a parallel engine must reproduce within {within}"
    return Measured(measures, [note], checked.stores(TASK_STORE, "repeat"))


def describe_reference(run: CheckedRun) -> Reference:
    """Return the reference that another engine must reproduce: a run of the model."""
    record = run.record
    metrics = {
        name: value
        for name, metric in METRICS.items()
        if metric.equivalence and (value := record.metrics.get(name)) is not None
    }
    return Reference(
        **record.model_dump(include={*Reference.model_fields} - {"metrics", "units"}),
        store=TASK_STORE,
        success=record.label == "stable",
        metrics=metrics,
        units={name: record.units[name] for name in metrics},
        tolerance=TOLERANCE,
        resolution={name: METRICS[name].resolution for name in metrics},
    )
