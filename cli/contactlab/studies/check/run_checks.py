"""Checks of the model's own runs.

Is the timestep short enough for the task, the geometry and the contacts; do the pairs that are held
or stand stay in their places; does it do what it must; does the model repeat bit for bit.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from contactlab.contact.contact_laws import stiffness_damping
from contactlab.judge.limits import (
    MILLIMETRES,
    MILLISECONDS,
    PERCENT,
    Limit,
    exceeding,
    informative,
    utilization,
)
from contactlab.measure import METRICS, labels_with
from contactlab.scene.run_setup import make_setup
from contactlab.schema.check_report import CheckResult, Measure, Reference, TaskKind
from contactlab.schema.setting_values import as_vector
from contactlab.studies.check.check_entries import Measured, check, remedy
from contactlab.studies.check.check_runs import CheckRun, HeldPair, Holding, pair_speeds
from contactlab.studies.check.checked_model import NOMINAL_STORE, CheckedModel
from contactlab.studies.check.contact_checks import STIFF_SOLREF, contact_sets, rounded_down
from contactlab.studies.session import Values

# Longest accepted timestep [s] by kind of task.
LONGEST: dict[TaskKind, float] = {"manipulation": 2e-3, "locomotion": 4e-3}
_SUITS = "the timestep suits the task, the thinnest geometry and the stiffest contact"


@check(
    "timestep",
    asks=_SUITS,
    place=1,
    limits=(
        Limit("timestep", "s", "warn", shown=MILLISECONDS),
        Limit("step_ratio", "1", "warn", 0.8),
        Limit("travel", "m", "gate", shown=MILLIMETRES),
    ),
)
def check_timestep(checked: CheckedModel) -> Measured:
    """Compare the timestep with the kind of task, the thinnest geoms and the stiffest contact."""
    step, limit = checked.resolved.timestep, LONGEST[checked.kind]
    measures = [
        checked.measure("timestep", step, checked.kind, limit=limit),
        *_ratios(checked),
        *_travels(checked),
    ]
    notes = list(_notes(checked))
    return Measured(measures, notes, checked.stores(NOMINAL_STORE))


def _ratios(checked: CheckedModel) -> Iterator[Measure]:
    """Yield the timestep times the natural frequency of each contact: h / (timeconst dampratio).

    Up to 0.8 a contact gains no energy with Euler. The solref is the engine's effective one.
    """
    for contacts in contact_sets(checked):
        stiffness, _ = stiffness_damping(contacts.solref)
        ratio = checked.resolved.timestep * math.sqrt(max(float(stiffness), 0.0))
        yield checked.measure("step_ratio", ratio, contacts.name)


def _travels(checked: CheckedModel) -> Iterator[Measure]:
    """Yield the travel of each pair's surfaces in a step, against half its thinnest geom."""
    base, model = checked.base, checked.prepared.model
    if not base.pairs or not checked.nominal.is_complete or not checked.resolved.flags["contact"]:
        return
    trace, step = checked.nominal.trace, checked.resolved.timestep
    speeds = pair_speeds(model, base.pairs, trace.qpos, trace.qvel, step=step)
    thickness = make_setup(base, None, [checked.resolved], [model], {}).thickness
    for pair, speed, half in zip(base.pairs, speeds, thickness, strict=True):
        if math.isfinite(half):
            yield checked.measure("travel", float(speed) * step, pair.name, limit=float(half))
    gravity = float(np.linalg.norm(as_vector(checked.resolved.settings["gravity"])))
    fall = math.sqrt(2 * gravity * model.stat.extent)
    yield informative("travel_of_a_fall", fall * step, "m", "over the model's extent")


@remedy("timestep", "step_ratio", "travel")
def shorter_timestep(checked: CheckedModel, result: CheckResult) -> Iterator[Values]:
    """Yield the longest timestep, to two digits, at which every limit holds."""
    failed = exceeding(result.measures)
    timestep = checked.resolved.timestep
    longest = [
        timestep / utilization(measure.value, measure.limit)
        for measure in failed
        if measure.name != "step_ratio"
    ]
    ratios = [measure.limit or 0.0 for measure in failed if measure.name == "step_ratio"]
    if ratios:
        # By solref as the model has it: raised time constants shrink with the timestep.
        stiffness, _ = stiffness_damping(
            [contacts.record.solref for contacts in contact_sets(checked)]
        )
        longest.append(min(ratios) / float(stiffness.max()) ** 0.5)
    if longest and min(longest) > 0:
        yield {"timestep": rounded_down(min(longest))}


def _notes(checked: CheckedModel) -> Iterator[str]:
    for contacts in contact_sets(checked):
        if contacts.solref != contacts.record.solref:
            yield (
                f"the engine raises the time constant of solref {contacts.record.solref[0]:g} "
                f"{contacts.record.solref[1]:g} to {contacts.solref[0]:g} s, two timesteps "
                "(refsafe)"
            )


_SHARES = (0.5, 0.25)
_BANDS = ((5e-3, "broken"), (3e-3, "exploited"), (1e-3, "a compromise"))
_STAYS = "what is held or stands stays: below 5 mode switches a second, 1 mm deep, 0.1 mm of slip"


@check(
    "hold",
    asks=_STAYS,
    place=4,
    limits=(
        Limit("steps_lost", "1", "gate", 1, strict=True),
        Limit("mode_switches", "1/s", "gate", 5, strict=True, shown=(1.0, " a second")),
        Limit("slip", "m", "warn", 1e-4, strict=True, shown=MILLIMETRES),
        Limit("penetration_mean", "m", "warn", 1e-3, strict=True, shown=MILLIMETRES),
        Limit("loose_share", "1", "gate", 0.5),
    ),
)
def check_hold(checked: CheckedModel) -> Measured:
    """Measure the pairs that are held or stand in the window of a hold."""
    nominal = checked.nominal.record
    stores = checked.stores(NOMINAL_STORE)
    if not checked.nominal.is_complete:
        lost = nominal.steps_asked - nominal.steps
        notes = [f"the run is not complete: {nominal.status_reason}"]
        measures = [checked.measure("steps_lost", max(lost, 1))]
        return Measured(measures, notes, stores)
    holding = checked.holding
    measures = [measure for pair in holding.held for measure in _hold_measures(checked, pair)]
    if holding.declared:
        measures += _declared(checked)
    if not measures:
        return Measured([], [holding.nothing], stores)
    notes = [f"measured from {holding.window[0]:g} to {holding.window[1]:g} s", *_bands(holding)]
    return Measured(measures, notes, stores)


def _hold_measures(checked: CheckedModel, held: HeldPair) -> list[Measure]:
    level = "gate" if checked.holding.declared else None
    return [
        checked.measure("mode_switches", held.switches, held.name),
        checked.measure("penetration_mean", held.depth, held.name),
        checked.measure("slip", held.slip, held.name, level=level),
        informative("force_mean", held.force, "N", held.name),
    ]


def _declared(checked: CheckedModel) -> list[Measure]:
    """Return the measures of a hold that the scene declares."""
    metrics = checked.nominal.record.metrics
    contact, drop = (metrics.get(name) for name in ("hold_contact", "hold_drop"))
    share = np.nan if contact is None else contact
    more = [] if drop is None else [informative("drop", drop, "m")]
    return [checked.measure("loose_share", 1 - share), *more]


def _bands(holding: Holding) -> Iterator[str]:
    """Yield what the guideline calls the depth of the deepest pair."""
    deepest = max(holding.held, key=lambda pair: pair.depth, default=None)
    if deepest and (word := next((word for least, word in _BANDS if deepest.depth >= least), "")):
        yield f"{deepest.name} overlaps by {deepest.depth * 1e3:.2g} mm on average: {word}"


@remedy("steps_lost")
def shorter_steps(checked: CheckedModel, _: CheckResult) -> Iterator[Values]:
    """Yield shares of the timestep, against an engine that stops."""
    yield from ({"timestep": checked.resolved.timestep * share} for share in _SHARES)


@remedy("mode_switches")
def harder(checked: CheckedModel, result: CheckResult) -> Iterator[Values]:
    """Yield changes against chatter, the guideline's first, which is the cheapest."""
    yield {"solimp": (0.99, 0.999, 0.001, 0.5, 2.0)}
    yield from shorter_steps(checked, result)


@remedy("slip", "penetration_mean")
def firmer(_: CheckedModel, __: CheckResult) -> Iterator[Values]:
    """Yield the guideline's changes: against slip, then against slip and depth."""
    firm: Values = {"cone": "elliptic", "impratio": 10.0}
    yield firm
    yield {**firm, "solref": STIFF_SOLREF}


# Largest accepted relative difference between one environment and many in parallel.
TOLERANCE = 0.05
_REPEATS = "the same run in another process is the same bit for bit"


@check(
    "repeat",
    asks=_REPEATS,
    place=5,
    limits=(Limit("trajectories_differ", "1", "gate", 0),),
)
def check_repeat(checked: CheckedModel) -> Measured:
    """Run the model again in another process, and compare the trajectories."""
    nominal = checked.nominal
    if nominal.record.trajectory_hash is None:
        reason = f"the model could not be run: {nominal.record.status_reason}"
        return Measured([], [reason], checked.stores(NOMINAL_STORE))
    other = replace(checked, session=replace(checked.session, workers=1))
    again = other.run("repeat", "The model once more", [{}], checks="none")[0]
    unequal = nominal.record.trajectory_hash != again.record.trajectory_hash
    differing = {"in another process": float(unequal)}
    if (repeats := nominal.record.metrics.get("repeats")) is not None:
        differing["in the same process"] = 1.0 - repeats
    measures = [
        checked.measure("trajectories_differ", value, where) for where, value in differing.items()
    ]
    note = f"reference.json has what a parallel engine must reproduce within {TOLERANCE:.0%}"
    stores = checked.stores(NOMINAL_STORE, "repeat")
    return Measured(measures, [note], stores)


def reference_of(nominal: CheckRun) -> Reference:
    """Return what another engine must reproduce: the nominal run."""
    record = nominal.record
    metrics = {
        name: value
        for name, metric in METRICS.items()
        if metric.equivalence and (value := record.metrics.get(name)) is not None
    }
    return Reference(
        **record.model_dump(include={*Reference.model_fields} - {"metrics", "units"}),
        store=NOMINAL_STORE,
        success=record.label == "stable",
        metrics=metrics,
        units={name: record.units[name] for name in metrics},
        tolerance=TOLERANCE,
        resolution={name: METRICS[name].resolution for name in metrics},
    )


@check(
    "must",
    asks="what the model must do, it does",
    place=4.5,
    limits=(Limit("requirements_broken", "1", "gate", 0),),
)
def check_must(checked: CheckedModel) -> Measured:
    """Look for what the scene or the request requires that a run of the model does not do."""
    manifest = checked.scene.source.manifest
    required = checked.options.must or (manifest.must if manifest else ())
    if not required:
        return Measured([], ["nothing is required"])
    labels = labels_with("required")
    measures: list[Measure] = []
    notes: list[str] = []
    for run in checked.nominals:
        broken = [each for each in run.record.labels if each.label in labels]
        seed = f"seed {run.record.seed}"
        measures.append(checked.measure("requirements_broken", float(bool(broken)), seed))
        notes += [f"{seed}: {each.reason}" for each in broken]
    return Measured(measures, notes, checked.stores(NOMINAL_STORE))


@check(
    "task",
    asks="in every phase of its task it moves as its model does, and no label holds",
    place=0.5,
    limits=(
        Limit("phantom_forces", "1", "gate", shown=PERCENT),
        Limit("labelled_runs", "1", "gate", 0),
    ),
)
def check_task(checked: CheckedModel) -> Measured:
    """Judge the phases of the task one by one, and count the runs that have a label."""
    verdict, task = checked.verdict, checked.task
    measures = [
        checked.measure(
            "phantom_forces",
            np.nan if phase.share is None else phase.share,
            f"{phase.body}, {phase.name}",
            limit=task.within,
        )
        for phase in verdict.phases
        if phase.body is not None
    ]
    for phase in verdict.phases:
        for label, runs in phase.labels.items():
            measures.append(checked.measure("labelled_runs", runs, f"{label}, {phase.name}"))
    if not any(phase.labels for phase in verdict.phases):
        measures.append(checked.measure("labelled_runs", 0))
    return Measured(
        measures, [] if verdict.sound else [verdict.sentence], checked.stores(NOMINAL_STORE)
    )
