"""Changes of model fields for a verdict: gains, damping and armature of a joint, solref.

Each makes another model. The stiffness that a step can hold has a closed form. In a semi-implicit
step h, a joint of inertia I with stiffness k and damping c that act explicitly, and damping d that
acts implicitly, has x' = x + h v' and v' (1 + h d / I) = v (1 - h c / I) - h k x / I, which is
stable if

    h^2 k / I + 2 h c / I < 4 + 2 h d / I

(Jury's criterion of its characteristic polynomial). A quarter of that bound is aimed at, where the
fastest motion of the joint has at least about four steps.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget.motion import INTEGRATION, Motion
from contactlab.budget.verdict import Verdict, VerdictWord
from contactlab.budget.windows import joint_name
from contactlab.contact.trace_arrays import Floats
from contactlab.modifications.catalogue import list_part_fixes
from contactlab.modifications.model_changes import stiffen_solref
from contactlab.modifications.model_predicates import find_used_rows, is_disabled
from contactlab.modifications.modification import Candidate, FieldValue
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_edits import FIELD_KINDS, derive_fields
from contactlab.scene.model_names import find_id, name_of
from contactlab.scene.part_bodies import (
    AT_JOINT,
    bodies_of_equality,
    bodies_of_tendon,
    is_mocap_driven,
)
from contactlab.schema.error_budget import BudgetReason

_AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)
_STIFFNESS, _DAMPING = 1, 2  # places of their negatives in biasprm


def build_candidate(
    name: str,
    apply: str,
    values: Sequence[FieldValue],
    *,
    word: VerdictWord = "inaccurate",
    rate: int = 1,
) -> Candidate:
    """Return the candidate that writes values into fields of a model."""
    return Candidate(
        name,
        word,
        partial(write_values, values=values),
        rate,
        apply=apply,
        edits=ModelEdits({value.axis: value.value for value in values}),
        values=tuple(values),
        must_come_nearer=word == "inaccurate",  # of several rows it comes nearer to none
    )


def write_values(model: mujoco.MjModel, values: Sequence[FieldValue]) -> None:
    """Write values into fields of a model in place."""
    for value in values:
        getattr(model, value.field)[value.place] = value.value
    if any(value.field == "dof_armature" for value in values):
        derive_fields(model)


def field_changes(motions: Sequence[Motion], verdict: Verdict) -> tuple[Candidate, ...]:
    """Return changes of fields against a verdict; none where its reasons point to none."""
    motion, word = motions[0], verdict.word
    if word == "ok":
        return ()
    reasons = [reason for reason in verdict.reasons if reason.verdict == verdict.reasons[0].verdict]
    if word == "depends":
        return tuple(_stiffen_parts(motion.model, reasons, verdict.tolerance))
    return tuple(_slower_servos(motion, reasons))


def _slower_servos(motion: Motion, reasons: Sequence[BudgetReason]) -> Iterator[Candidate]:
    """Yield changes by which the step holds the first servo that reasons point to, then all.

    A wheel, a leg or a finger seldom has a motor that no other has.
    """
    model = motion.model
    joints = np.flatnonzero(model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)).tolist()
    inertias = joint_inertias(motion, joints) if joints else ()
    servos = map(partial(_Servo.of, model), joints, inertias)
    unheld = [servo for servo in servos if servo.load > 1]
    pointed = [servo for reason in reasons for servo in unheld if _points_to(model, reason, servo)]
    if not pointed:
        return
    alone = {change.apply: change for change in _hold_servos(model, pointed[:1])}
    yield from alone.values()
    if len(unheld) > 1:
        first, others = pointed[0], [servo for servo in unheld if servo is not pointed[0]]
        for change in _hold_servos(model, [first, *others]):
            includes = (alone[change.apply].name,)
            yield replace(change, apply=f"{change.apply}-all", includes=includes)


def joint_inertias(motion: Motion, joints: Sequence[int]) -> list[float]:
    """Return the inertias that hinges and slides move where a motion starts [kg m^2, or kg].

    1 / (M^-1)_jj, the others being free: armature a of the joint makes it I + a exactly.
    """
    model, data = motion.model, mujoco.MjData(motion.model)
    mujoco.mj_setState(model, data, motion.starts[0], INTEGRATION)
    mujoco.mj_forward(model, data)
    dofs = model.jnt_dofadr[joints]
    units = np.zeros((len(joints), model.nv))
    units[np.arange(len(joints)), dofs] = 1
    moved = np.zeros_like(units)
    mujoco.mj_solveM(model, data, moved, units)
    return (1 / moved[np.arange(len(joints)), dofs]).tolist()


class _Servo(NamedTuple):
    """The servos and the spring of a joint, against the step.

    Attributes:
        joint: a hinge or slide.
        actuators: of its servos.
        inertia: that it moves [kg m^2, or kg].
        stiff: h^2 k / I of servos and spring.
        damped: h c / I of servos.
    """

    joint: int
    actuators: Sequence[int]
    inertia: float
    stiff: float
    damped: float

    @classmethod
    def of(cls, model: mujoco.MjModel, joint: int, inertia: float) -> "_Servo":
        """Return the servos and the spring of a joint that moves an inertia."""
        # The force of a servo depends on the position or the speed of its joint.
        actuators = [
            actuator
            for actuator in range(model.nu)
            if int(model.actuator_trntype[actuator]) in AT_JOINT
            and int(model.actuator_trnid[actuator, 0]) == joint
            and int(model.actuator_biastype[actuator]) == _AFFINE
            and (model.actuator_biasprm[actuator, [_STIFFNESS, _DAMPING]] < 0).any()
        ]
        step = float(model.opt.timestep)
        square = model.actuator_gear[actuators, 0] ** 2
        kp, kv = (
            float(-(model.actuator_biasprm[actuators, place] * square).sum())
            for place in (_STIFFNESS, _DAMPING)
        )
        spring = float(np.ravel(model.jnt_stiffness[joint])[0])
        return cls(
            joint, actuators, inertia, step**2 * (kp + spring) / inertia, step * kv / inertia
        )

    @property
    def load(self) -> float:
        """Load on the step: it holds up to four, and resolves one."""
        return self.stiff + 2 * self.damped

    @property
    def slower(self) -> float:
        """The factor s by which gains of the same damping ratio, s^2 kp and s kv, are held."""
        root = math.sqrt(max(self.stiff, 0))
        part = (math.hypot(self.damped, root) - self.damped) / self.stiff if self.stiff > 0 else 0.0
        return part or 1 / (2 * self.damped)


def _points_to(model: mujoco.MjModel, reason: BudgetReason, servo: _Servo) -> bool:
    """Return whether a reason names the joint of a servo, or a body that the joint moves."""
    if reason.place == joint_name(model, servo.joint):
        return True
    # Bodies of a reason are the one that moves, and those of its place.
    bodies = [reason.body]
    kind, _, name = reason.place.partition(" ")
    if kind == "contact":
        bodies += name.split(" - ")
    for part, count, bodies_of in (
        ("equality", model.neq, bodies_of_equality),
        ("tendon", model.ntendon, bodies_of_tendon),
    ):
        for index in range(count if kind == part else 0):
            if _find_own_name(model, part, index) == name:
                bodies += bodies_of(model, index)
    return name_of(model, "body", int(model.jnt_bodyid[servo.joint])) in bodies


def _hold_servos(model: mujoco.MjModel, servos: Sequence[_Servo]) -> Iterator[Candidate]:
    """Yield changes by which the step holds the servos and springs of joints."""
    step = float(model.opt.timestep)
    names = f"joint {name_of(model, 'joint', servos[0].joint)}"
    names += f" and {len(servos) - 1} more" if len(servos) > 1 else ""
    if all(servo.actuators for servo in servos):
        slower = [
            value for servo in servos for value in _slow_gains(model, servo.actuators, servo.slower)
        ]
        yield build_candidate(f"gains of {names} that the step holds", "gains", slower)
    dofs = [int(model.jnt_dofadr[servo.joint]) for servo in servos]
    missing = [servo.inertia * (servo.load - 1) for servo in servos]
    yield _of_dofs(model, "armature", dofs, missing, names)
    explicit = int(model.opt.integrator) == mujoco.mjtIntegrator.mjINT_RK4
    if not explicit and not is_disabled(model, "eulerdamp"):
        yield _of_dofs(model, "damping", dofs, [2 * one / step for one in missing], names)


def _of_dofs(
    model: mujoco.MjModel, word: str, dofs: Sequence[int], more: Sequence[float], names: str
) -> Candidate:
    """Return the change by which joints have more armature, or damping."""
    field, values = f"dof_{word}", list[FieldValue]()
    for dof, added in zip(dofs, more, strict=True):
        own = getattr(model, field)[dof]
        index = (dof,) if np.ndim(own) == 0 else (dof, 0)
        axis = f"{field}[{name_of(model, 'joint', int(model.dof_jntid[dof]))}]"
        values.append(
            FieldValue(field, index, axis, _round_digits(float(np.ravel(own)[0]) + added))
        )
    numbers = [value.value for value in values]
    size = f"{numbers[0]:g}" if len({*numbers}) == 1 else f"of up to {max(numbers):g}"
    return build_candidate(f"{word} {size} of {names}", word, values)


def _slow_gains(model: mujoco.MjModel, servos: Sequence[int], part: float) -> Iterator[FieldValue]:
    """Yield the gains of servos that are slower by a factor."""
    for actuator in servos:
        gain, bias = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator]
        stiff, damped = -float(bias[_STIFFNESS]), -float(bias[_DAMPING])
        kp = _round_digits(stiff * part**2, up=False) if stiff > 0 else 0.0
        kv = _round_digits(damped * part, up=False) if damped > 0 else 0.0
        leading, own = (kp, stiff) if kp else (kv, damped)
        yield _make_parameter_value(model, actuator, ("gain", 0), float(gain) / own * leading)
        if kp:
            yield _make_parameter_value(model, actuator, ("bias", _STIFFNESS), -kp)
        if kv:
            yield _make_parameter_value(model, actuator, ("bias", _DAMPING), -kv)


def _make_parameter_value(
    model: mujoco.MjModel, actuator: int, which: tuple[str, int], value: float
) -> FieldValue:
    (kind, place), name = which, name_of(model, "actuator", actuator)
    field = f"actuator_{kind}prm"
    return FieldValue(field, (actuator, place), f"{field}[{name},{place}]", value)


def _round_digits(number: float, *, up: bool = True) -> float:
    """Return a positive number in two digits, no smaller, or no larger."""
    digits = 2
    unit = 10.0 ** (math.floor(math.log10(number)) + 1 - digits)
    whole = math.ceil(number / unit) if up else math.floor(number / unit)
    return float(f"{whole * unit:.{digits}g}")


PARTS_OF_A_STEP = {2: "half", 4: "a quarter of", 8: "an eighth of", 16: "a sixteenth of"}


def _find_soft_fields(row: str) -> tuple[str, ...]:
    """Return the fields of solref that a row of softness is about; none for other rows."""
    return tuple(
        field for fix in list_part_fixes("solref") if row in fix.rows for field in fix.fields
    )


def _stiffen_parts(
    model: mujoco.MjModel, reasons: Sequence[BudgetReason], tolerance: float
) -> Iterator[Candidate]:
    """Yield a shorter solref of the parts that are named, and of all of their kind.

    Compliance is proportional to the square of a time constant, and so is the error of a row. The
    constant is divided by a power of two, with a square of at least the row's error over the
    tolerance; or by more, since a very soft part swings first.
    If the step would not hold it, the step is divided, too.
    """
    soft = [reason for reason in reasons if _find_soft_fields(reason.row)]
    if not soft:
        return
    excess = max(reason.error for reason in soft) / tolerance
    times = 2 ** max(1, math.ceil(math.log2(excess) / 2)) if math.isfinite(excess) else 2
    parts = list(dict.fromkeys(part for reason in soft for part in _named_parts(model, reason)))
    kinds = list(dict.fromkeys(reason.row.removesuffix(" softness") for reason in soft))
    fields = [field for kind in kinds for field in _find_soft_fields(f"{kind} softness")]
    every = [(field, row) for field in fields for row in _used_rows(model, field)]
    places = ", ".join(dict.fromkeys(reason.place for reason in soft if reason.place))
    every_one = f"every {' and '.join(kinds)}"
    for some, word, what in ((parts, "solref", places), (every, "solref-all", every_one)):
        if some and (word == "solref" or every != parts):
            yield from _ever_stiffer(model, some, times, word, what)


def _ever_stiffer(
    model: mujoco.MjModel, parts: Sequence[tuple[str, int]], times: int, word: str, what: str
) -> Iterator[Candidate]:
    """Yield a shorter solref of parts, then those that go further, each in place of all before."""

    def shorter(more: int) -> Candidate:
        own = word if more == 1 else f"{word}-{more * times}"
        return _of_solref(model, parts, more * times, own, what)

    def possible_changes(powers: Sequence[int]) -> list[Candidate]:
        most_rate = 4  # steps in one of the run's that may hold it
        return [change for more in powers if (change := shorter(more)).rate <= most_rate]

    # Time constants get 4 and 16 times shorter still, or 2 times if no step holds these.
    before = tuple[str, ...]()
    for change in (shorter(1), *(possible_changes((4, 16)) or possible_changes((2,)))):
        yield replace(change, includes=before)
        before = (*before, change.name)


def _of_solref(
    model: mujoco.MjModel, parts: Sequence[tuple[str, int]], times: int, word: str, what: str
) -> Candidate:
    """Return a solref of `times` the frequency of rows of fields, at a step that holds it."""
    field_values, rate = list[FieldValue](), 1
    for field, row in parts:
        kind = FIELD_KINDS[field.partition("_")[0]]
        index = int(model.dof_jntid[row]) if field.startswith("dof_") else row
        own: Floats = stiffen_solref(getattr(model, field)[[row]], times)[0]
        # A time constant is at least two steps long, whether or not refsafe sees to it.
        if own[0] > 0:
            rate = max(rate, 2 ** math.ceil(math.log2(2 * model.opt.timestep / own[0])))
        axis = f"{field}[{name_of(model, kind, index)}]"
        field_values.append(FieldValue(field, (row,), axis, tuple(map(float, own))))
    at = "" if rate == 1 else f" at {PARTS_OF_A_STEP.get(rate, f'1/{rate} of')} the step"
    name = f"solref / {times} of {what}{at}"
    return build_candidate(name, word, field_values, word="depends", rate=rate)


def _named_parts(model: mujoco.MjModel, reason: BudgetReason) -> Iterator[tuple[str, int]]:
    """Yield fields and rows of the parts that a reason names."""
    kind, _, name = reason.place.partition(" ")
    if kind == "contact":
        bodies = {find_id(model, "body", body) for body in name.split(" - ")}
        for geom in _used_rows(model, "geom_solref"):
            if int(model.geom_bodyid[geom]) in bodies:
                yield "geom_solref", geom
        geoms = np.stack([model.pair_geom1, model.pair_geom2], axis=1)
        for pair, both in enumerate(model.geom_bodyid[geoms]):
            if set(map(int, both)) == bodies:
                yield "pair_solref", pair
        return
    for field in _find_soft_fields(reason.row):
        yield from (
            (field, row)
            for row in _used_rows(model, field)
            if _name_part(model, field, row) == reason.place
        )


def _name_part(model: mujoco.MjModel, field: str, row: int) -> str:
    """Return the words of a reason for the owner of a row of a field."""
    if field.startswith("dof_"):
        return joint_name(model, int(model.dof_jntid[row]))
    kind = FIELD_KINDS[field.partition("_")[0]]
    return (
        joint_name(model, row) if kind == "joint" else f"{kind} {_find_own_name(model, kind, row)}"
    )


def _find_own_name(model: mujoco.MjModel, kind: str, index: int) -> str:
    return getattr(model, kind)(index).name or f"[{index}]"


def _used_rows(model: mujoco.MjModel, field: str) -> list[int]:
    """Return the rows of a field of solref that anything uses; those of a joint are one."""
    rows = find_used_rows(model, field)
    if field == "eq_solref":
        rows &= (model.eq_active0 != 0) & ~is_mocap_driven(model)
    rows = np.flatnonzero(rows)
    if field == "dof_solref":
        rows = rows[[int(model.jnt_dofadr[model.dof_jntid[row]]) == row for row in rows]]
    return [int(row) for row in rows]
