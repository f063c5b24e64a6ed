"""Features and parts of a model: what each is worth in its task and under load, and what it costs.

Each is left out of the model as written, in the windows of its own motion. Load is what the task
has, controls and pushes, then gravity tilted, so that what stands has to hold, then inputs twice.
"""

import copy
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from operator import eq

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.measuring import reference_of
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.prices import Price
from contactlab.budget.rows import ROWS, Row
from contactlab.budget.showing import shown_rows
from contactlab.budget.windows import without_sensors
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.scene.model_names import geom_words, name_of
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.error_budget import BudgetPrice
from contactlab.schema.parts_report import REPORT, PartKind, PartsReport, PartWorth, Worth
from contactlab.studies.examine.examination import ExamineRequest, open_model
from contactlab.studies.search.clock import Clock
from contactlab.studies.search.exercise import TILT, bits_of, doubled, tilted
from contactlab.studies.search.tune_request import refuse_metrics
from contactlab.studies.search.unused_pairs import untouched_geoms
from contactlab.studies.search.yardstick import Apart, Yardsticks
from contactlab.studies.session import Session

_MEASURING = 0.85  # of the time allowed, after which nothing more is begun
_SAFEGUARDS = ("clamps", "limits", "margin")
_TURNS = 5
_TENDON = tuple(
    field
    for field in (
        "tendon_stiffness",
        "tendon_stiffnesspoly",
        "tendon_damping",
        "tendon_dampingpoly",
        "tendon_frictionloss",
    )
    if hasattr(mujoco.MjModel, field)
)
"""Fields by which a tendon pulls within its limits, as far as this MuJoCo has them."""
_NEVER = "cannot touch, whatever their joints do within their ranges"

Change = Callable[[mujoco.MjModel], None]


@dataclass(frozen=True)
class PartsRequest:
    """Whose parts, with which settings and task, in which wall time [s]."""

    model: str
    assign: Sequence[str] = ()
    task: TaskOptions = AS_INFERRED
    max_time: float = 120.0


@dataclass(frozen=True)
class Part:
    """A feature or part, and how a copy of a model is made to do without."""

    kind: PartKind
    name: str
    without: Change
    exercised: bool
    proof: str = ""
    safeguard: bool = False


def run(request: PartsRequest, session: Session) -> PartsReport:
    """Leave out one part after the other; the report is written to `parts.json`.

    Raises:
        SceneError: there is no such model, or it does not compile.
        SweepFileError: a setting is wrong, or the tolerance is no share.
        EngineError: nothing moves, or MuJoCo is not what simulates.
        OutputError: the folder cannot be written, or has another model's results.
    """
    begin = time.monotonic()
    refuse_metrics(request.task)
    asked = ExamineRequest(request.model, request.assign, request.task, ("budget",))
    examined = open_model(asked, session)
    session.claim("parts", request.model)
    session.notify(f"leaving out parts of {request.model}: {examined.task.line}")
    motions = examined.motions
    threads = max(1, session.workers)
    loaded = loads_of(motions)
    yards = Yardsticks.of(loaded, 1, threads).known_ones()
    parts = parts_of(loaded, [part.positions for part in yards.parts], threads)
    clock = Clock(yards, motions[0].model)
    measured, ended = list[tuple[Part, Apart | None, Price | None]](), False
    same = yards.around(reference_of)
    for part in parts:
        ended = ended or time.monotonic() > begin + _MEASURING * request.max_time
        apart = price = None
        if part.exercised and not part.proof and not ended:

            def without(model: mujoco.MjModel, own: Change = part.without) -> mujoco.MjModel:
                changed = reference_of(model, 1)
                own(changed)
                return changed

            apart = yards.apart_from(without, same)
        if not ended:
            (price,) = clock.prices([(_made(motions[0].model, part.without), 1)], _TURNS)
        measured.append((part, apart, price))
    (twin,) = clock.prices([(copy.copy(motions[0].model), 1)], _TURNS)
    report = PartsReport(
        model=request.model,
        scene_hash=examined.scene.hash,
        mujoco=VERSION,
        task=examined.task,
        tilt=TILT,
        within=examined.task.within,
        parts=tuple(_worth(*each, examined.task.within) for each in measured),
        twin=_price(twin),
        ended=ended,
        seconds=time.monotonic() - begin,
    )
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


def loads_of(motions: Sequence[Motion]) -> list[Motion]:
    """Return the motions of a task, with gravity tilted, and by twice the inputs."""
    return [*motions, *map(tilted, motions), *map(doubled, motions)]


def _made(model: mujoco.MjModel, *changes: Change) -> mujoco.MjModel:
    made = copy.copy(model)
    for change in changes:
        change(made)
    return made


def _worth(part: Part, apart: Apart | None, price: Price | None, within: float) -> PartWorth:
    worth: Worth = "needed"
    if part.proof:
        worth = "provably unused"
    elif not part.exercised or apart is None:
        worth = "unused in this task, kept"
    elif apart.share <= within:
        worth = "below the tolerance"
    safeguard = "a safeguard" if worth.endswith("kept") else "a safeguard, kept"
    reason = part.proof or (safeguard if part.safeguard else "")
    if part.exercised and not part.proof and apart is None:
        worth, reason = "not measured, kept", "the time was over"
    return PartWorth(
        kind=part.kind,
        name=part.name,
        worth=worth,
        exercised=part.exercised,
        share=apart.share if apart and math.isfinite(apart.share) else None,
        body=apart.body if apart else "",
        phase=apart.phase if apart else "",
        time=apart.time if apart else None,
        price=_price(price),
        reason=reason,
    )


def _price(price: Price | None) -> BudgetPrice | None:
    return price and BudgetPrice(ratio=price.ratio, low=price.low, high=price.high)


def parts_of(
    motions: Sequence[Motion], positions: Sequence[np.ndarray], threads: int
) -> list[Part]:
    """Return the features and parts of a model, and which of them any step makes use of.

    What no step shows in use, and no proof leaves out, has to be unused indeed: without it, the
    motions are the same bit for bit.
    """
    model = motions[0].model
    found = [*_features(motions), *_pieces(model, used_by(motions), positions)]
    own = [*bits_of(motions, threads)]

    def unused(parts: Sequence[Part]) -> bool:
        changes = [part.without for part in parts]
        others = [replace(motion, model=_made(motion.model, *changes)) for motion in motions]
        return all(map(eq, own, bits_of(others, threads)))

    idle = [part for part in found if not (part.exercised or part.proof)]
    if unused(idle):
        return found
    used = [part for part in idle if not unused([part])]
    return [replace(part, exercised=True) if part in used else part for part in found]


def _features(motions: Sequence[Motion]) -> Iterator[Part]:
    model = motions[0].model
    rows = [row for row in ROWS if row.kind == "effect" and row.uses(model)]
    shown = {name for motion in motions for name in shown_rows(motion, rows)}
    for row in rows:
        without, safeguard = _by_row(row, model), row.name in _SAFEGUARDS
        yield Part("feature", row.summary, without, row.name in shown, safeguard=safeguard)


def _by_row(row: Row, model: mujoco.MjModel) -> Change:
    return lambda changed: row.changes[0](changed, model)


@dataclass(frozen=True)
class Used:
    """Which parts any step of a motion makes use of, by id."""

    geoms: frozenset[int]
    limits: frozenset[int]
    tendons: frozenset[int]
    actuators: frozenset[int]


def used_by(motions: Sequence[Motion]) -> Used:
    """Step through motions, and see what touches, is at its limit, is taut, or pushes."""
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
    pulling = (
        tendon
        for tendon in range(model.ntendon)
        if any(np.any(getattr(model, field)[tendon]) for field in _TENDON)
    )
    return Used(
        frozenset(geoms), frozenset(limits), frozenset({*tendons, *pulling}), frozenset(actuators)
    )


def _pieces(model: mujoco.MjModel, used: Used, positions: Sequence[np.ndarray]) -> Iterator[Part]:
    yield from _collisions(model, used, positions)
    for joint in _ids(model.jnt_limited):
        without, name = _zero(joint, "jnt_limited"), name_of(model, "joint", joint)
        yield Part("limit", name, without, joint in used.limits, safeguard=True)
    for tendon in range(model.ntendon):
        without = _zero(tendon, *_TENDON, "tendon_limited")
        yield Part("tendon", name_of(model, "tendon", tendon), without, tendon in used.tendons)
    for actuator in range(model.nu):
        without = _zero(actuator, "actuator_gainprm", "actuator_biasprm")
        name = name_of(model, "actuator", actuator)
        yield Part("actuator", name, without, actuator in used.actuators)


def _collisions(
    model: mujoco.MjModel, used: Used, positions: Sequence[np.ndarray]
) -> Iterator[Part]:
    unused, words = untouched_geoms(model, positions), geom_words(model)
    for geom in _ids(model.geom_contype | model.geom_conaffinity):
        without, name = (
            _zero(geom, "geom_contype", "geom_conaffinity"),
            name_of(model, "geom", geom),
        )
        proof = f"they {_NEVER}" if name in unused.masked else ""
        yield Part("geom", words.get(name, name), without, geom in used.geoms, proof)
    for one, other in unused.excluded:
        proof = f"their bodies {_NEVER}"
        yield Part("pair", f"{one} - {other}", lambda _: None, exercised=False, proof=proof)


def _ids(field: np.ndarray) -> list[int]:
    return np.flatnonzero(field).tolist()


def _zero(index: int, *fields: str) -> Change:
    def change(model: mujoco.MjModel) -> None:
        for field in fields:
            getattr(model, field)[index] = 0

    return change
