"""The influence and the cost of each feature and part of a model, in its task and under load.

Each is removed alone from the model as written, in windows along the motion of that model. The
motions are the task, the task with gravity tilted, so that standing bodies must hold, and the task
with twice its controls and pushes.
"""

import copy
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from operator import eq

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.exercised_rows import exercised_rows
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.restarts import build_reference_model
from contactlab.budget.windows import without_sensors
from contactlab.modifications.catalogue import CATALOGUE, list_rows
from contactlab.modifications.mechanics import TENDON_FORCE_FIELDS
from contactlab.modifications.modification import ModelChange, Modification, PartRemoval
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.scene.model_names import geom_names_by_address, name_of
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.parts_report import REPORT, PartEffect, PartKind, PartsReport, PartVerdict
from contactlab.schema.time_ratio import TimeRatio
from contactlab.studies.search.clock import Clock
from contactlab.studies.search.tune_request import refuse_metrics
from contactlab.studies.search.unused_pairs import unreachable_edits
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.reference_error import ErrorEstimate, TaskReference
from contactlab.tasks.session import Session
from contactlab.tasks.stress_motions import (
    TILT_DEGREES,
    double_inputs,
    state_bytes,
    tilt_gravity,
)

_MEASURING_SHARE = 0.85  # of the time limit, after which no measurement starts
_CANNOT_TOUCH = "cannot touch, whatever their joints do within their ranges"

Removal = Callable[[mujoco.MjModel], None]


@dataclass(frozen=True)
class PartsRequest:
    """The model to ablate, its settings and task, and the wall time limit [s]."""

    model: str
    assign: Sequence[str] = ()
    task: TaskOptions = AS_INFERRED
    max_time: float = 120.0


@dataclass(frozen=True)
class Feature:
    """A feature or part of a model, and the function that removes it from a copy."""

    kind: PartKind
    name: str
    removal: Removal
    exercised: bool
    proof: str = ""
    safeguard: bool = False


def ablate_model(request: PartsRequest, session: Session) -> PartsReport:
    """Remove one part after the other, and write the report to `parts.json`.

    Raises:
        SceneError: there is no such model, or it does not compile.
        SweepFileError: a setting is wrong, or the tolerance is not a share.
        EngineError: nothing moves, or MuJoCo is not what simulates.
        OutputError: the folder cannot be written, or has another model's results.
    """
    begin = time.monotonic()
    refuse_metrics(request.task)
    examined = open_model(request.model, session, request.task, request.assign)
    session.claim("parts", request.model)
    session.notify(f"removing parts of {request.model}: {examined.task.line}")
    motions = examined.motions
    threads = max(1, session.workers)
    loaded = stress_motions_of(motions)
    reference = TaskReference.run_references(loaded, 1, threads).complete_phases()
    parts = find_features(loaded, [part.positions for part in reference.phases], threads)
    clock = Clock(reference, motions[0].model)
    measured, timed_out = list[tuple[Feature, ErrorEstimate | None, TimeRatio | None]](), False
    same = reference.velocities_around(build_reference_model)
    for part in parts:
        timed_out = timed_out or time.monotonic() > begin + _MEASURING_SHARE * request.max_time
        estimate = ratio = None
        if part.exercised and not part.proof and not timed_out:

            def without(model: mujoco.MjModel, own: Removal = part.removal) -> mujoco.MjModel:
                changed = build_reference_model(model, 1)
                own(changed)
                return changed

            estimate = reference.error_against(without, same)
        if not timed_out:
            (ratio,) = clock.time_ratios([(_changed_model(motions[0].model, part.removal), 1)])
        measured.append((part, estimate, ratio))
    (noise_floor,) = clock.time_ratios([(copy.copy(motions[0].model), 1)])
    report = PartsReport(
        model=request.model,
        scene_hash=examined.scene.hash,
        mujoco=VERSION,
        task=examined.task,
        tilt=TILT_DEGREES,
        tolerance=examined.task.tolerance,
        parts=tuple(_effect_of(*each, examined.task.tolerance) for each in measured),
        noise_floor=noise_floor,
        timed_out=timed_out,
        seconds=time.monotonic() - begin,
    )
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


def stress_motions_of(motions: Sequence[Motion]) -> list[Motion]:
    """Return the motions of a task, then with gravity tilted, then with twice the inputs."""
    return [*motions, *map(tilt_gravity, motions), *map(double_inputs, motions)]


def _changed_model(model: mujoco.MjModel, *changes: Removal) -> mujoco.MjModel:
    made = copy.copy(model)
    for change in changes:
        change(made)
    return made


def _effect_of(
    part: Feature, estimate: ErrorEstimate | None, ratio: TimeRatio | None, tolerance: float
) -> PartEffect:
    verdict: PartVerdict = "needed"
    if part.proof:
        verdict = "unused"
    elif not part.exercised or estimate is None:
        verdict = "not exercised"
    elif estimate.error <= tolerance:
        verdict = "below the tolerance"
    safeguard = "a safeguard" if verdict == "not exercised" else "a safeguard, kept"
    reason = part.proof or (safeguard if part.safeguard else "")
    if part.exercised and not part.proof and estimate is None:
        verdict, reason = "not measured", "the time limit was reached"
    return PartEffect(
        kind=part.kind,
        name=part.name,
        verdict=verdict,
        exercised=part.exercised,
        error=estimate.error if estimate else None,
        body=estimate.body if estimate else "",
        phase=estimate.phase if estimate else "",
        time=estimate.time if estimate else None,
        time_ratio=ratio,
        reason=reason,
    )


def find_features(
    motions: Sequence[Motion], positions: Sequence[np.ndarray], threads: int
) -> list[Feature]:
    """Return the features and parts of a model, and whether any step uses each of them.

    A part that no step uses, and that has no proof, is checked: without it, the motions must be
    the same bit for bit. Otherwise it counts as exercised.
    """
    model = motions[0].model
    found = [*_budget_features(motions), *_model_parts(model, find_active(motions), positions)]
    own = [*state_bytes(motions, threads)]

    def unused(parts: Sequence[Feature]) -> bool:
        changes = [part.removal for part in parts]
        others = [
            replace(motion, model=_changed_model(motion.model, *changes)) for motion in motions
        ]
        return all(map(eq, own, state_bytes(others, threads)))

    idle = [part for part in found if not (part.exercised or part.proof)]
    if unused(idle):
        return found
    used = [part for part in idle if not unused([part])]
    return [replace(part, exercised=True) if part in used else part for part in found]


def _budget_features(motions: Sequence[Motion]) -> Iterator[Feature]:
    model = motions[0].model
    rows = [row for row in list_rows() if row.kind == "effect" and row.applies(model)]
    shown = {name for motion in motions for name in exercised_rows(motion, rows)}
    safeguards = {row.name for entry in CATALOGUE.values() if entry.safeguard for row in entry.rows}
    for row in rows:
        without, safeguard = _bind_change(row.changes[0], model), row.name in safeguards
        yield Feature("feature", row.summary, without, row.name in shown, safeguard=safeguard)


def _bind_change(change: ModelChange, model: mujoco.MjModel) -> Removal:
    return lambda changed: change(changed, model)


@dataclass(frozen=True)
class ActiveFeatures:
    """Ids of the parts that any step of a motion uses."""

    geoms: frozenset[int]
    limits: frozenset[int]
    tendons: frozenset[int]
    actuators: frozenset[int]


def find_active(motions: Sequence[Motion]) -> ActiveFeatures:
    """Step through motions, and find the geoms, limits, tendons and actuators that act."""
    geoms, limits, tendons, actuators = set[int](), set[int](), set[int](), set[int]()
    limited = (mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT, mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON)
    for motion in motions:
        model = without_sensors(motion.model)
        data = mujoco.MjData(model)
        for seed in range(motion.seeds):
            mujoco.mj_setState(model, data, motion.starts[seed], INTEGRATION)
            rows = motion.rows(seed, np.arange(motion.steps))
            for step in range(motion.steps):
                if rows is not None:
                    mujoco.mj_setState(model, data, rows[step], motion.spec)
                mujoco.mj_step(model, data)
                geoms.update(data.contact.geom[data.contact.exclude == 0].ravel().tolist())
                kinds = np.asarray(data.efc_type[: data.nefc])
                limits.update(np.asarray(data.efc_id)[: data.nefc][kinds == limited[0]].tolist())
                tendons.update(np.asarray(data.efc_id)[: data.nefc][kinds == limited[1]].tolist())
                actuators.update(np.flatnonzero(data.actuator_force).tolist())
    model = motions[0].model
    pull_fields = [field for field in TENDON_FORCE_FIELDS if hasattr(model, field)]
    pulling = (
        tendon
        for tendon in range(model.ntendon)
        if any(np.any(getattr(model, field)[tendon]) for field in pull_fields)
    )
    return ActiveFeatures(
        frozenset(geoms), frozenset(limits), frozenset({*tendons, *pulling}), frozenset(actuators)
    )


def _model_parts(
    model: mujoco.MjModel, used: ActiveFeatures, positions: Sequence[np.ndarray]
) -> Iterator[Feature]:
    yield from _collision_parts(model, used, positions)
    active = {"limit": used.limits, "tendon": used.tendons, "actuator": used.actuators}
    objects = {"limit": "joint"}
    for entry, removal in _list_removals():
        for part in removal.find_parts(model) if removal.kind in active else ():
            yield Feature(
                removal.kind,
                name_of(model, objects.get(removal.kind, removal.kind), part),
                _zero_fields(part, removal.fields),
                part in active[removal.kind],
                safeguard=entry.safeguard,
            )


def _list_removals() -> list[tuple[Modification, PartRemoval]]:
    return [(entry, removal) for entry in CATALOGUE.values() for removal in entry.removals]


def _collision_parts(
    model: mujoco.MjModel, used: ActiveFeatures, positions: Sequence[np.ndarray]
) -> Iterator[Feature]:
    unused, words = unreachable_edits(model, positions), geom_names_by_address(model)
    removal = next(removal for _, removal in _list_removals() if removal.kind == "geom")
    for geom in removal.find_parts(model):
        without, name = _zero_fields(geom, removal.fields), name_of(model, "geom", geom)
        proof = f"they {_CANNOT_TOUCH}" if name in unused.masked else ""
        yield Feature("geom", words.get(name, name), without, geom in used.geoms, proof)
    for one, other in unused.excluded:
        proof = f"their bodies {_CANNOT_TOUCH}"
        yield Feature("pair", f"{one} - {other}", lambda _: None, exercised=False, proof=proof)


def _zero_fields(index: int, fields: Sequence[str]) -> Removal:
    def change(model: mujoco.MjModel) -> None:
        for field in fields:
            if hasattr(model, field):
                getattr(model, field)[index] = 0

    return change
