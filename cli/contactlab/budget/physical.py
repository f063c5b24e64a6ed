"""Changes of physics that a verdict points to: gains, damping and armature of a joint, solref.

Each makes another model. What a step can hold has a closed form. In a semi-implicit step h, a joint
of inertia I with stiffness k and damping c that act explicitly, and damping d that acts implicitly,
has x' = x + h v' and v' (1 + h d / I) = v (1 - h c / I) - h k x / I, which is stable where

    h^2 k / I + 2 h c / I < 4 + 2 h d / I

(Jury's criterion of its characteristic polynomial). A quarter of that bound is aimed at, where the
fastest motion of the joint has at least about four steps.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget.motion import INTEGRATION, Motion
from contactlab.budget.rows import disabled, stiffened, used
from contactlab.budget.verdict import Reason, Verdict
from contactlab.budget.windows import joint_name
from contactlab.contact.trace_arrays import Floats
from contactlab.scene.model_edits import FIELD_KINDS, derive
from contactlab.scene.model_names import find_id, name_of
from contactlab.scene.part_bodies import hauled

_AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)
_STIFFNESS, _DAMPING = 1, 2  # places of their negatives in biasprm
_DIGITS = 2


class FieldValue(NamedTuple):
    """A value of a model's field, and where it stands there."""

    field: str
    place: tuple[int, ...]
    axis: str  # such as dof_armature[left_knee]
    value: float | tuple[float, ...]


@dataclass(frozen=True)
class FieldChange:
    """Values of a model's fields, and the word and the phrase that the change goes by.

    Attributes:
        word: as `--accept` has it.
        phrase: as a sentence has it.
        values: of fields.
        rate: how many steps in one of the run's they take.
        after: phrases of changes that are enough where they help.
    """

    word: str
    phrase: str
    values: tuple[FieldValue, ...]
    rate: int = 1
    after: tuple[str, ...] = ()

    def make(self, model: mujoco.MjModel) -> None:
        """Make the change in a model, in place."""
        for value in self.values:
            getattr(model, value.field)[value.place] = value.value
        if any(value.field == "dof_armature" for value in self.values):
            derive(model)


def field_changes(motions: Sequence[Motion], verdict: Verdict) -> tuple[FieldChange, ...]:
    """Return changes of fields against a verdict; none where its reasons point to none."""
    motion, word = motions[0], verdict.word
    if word == "sound":
        return ()
    reasons = [reason for reason in verdict.reasons if reason.word == verdict.reasons[0].word]
    if word == "model":
        return tuple(_stiffer(motion.model, reasons, verdict.within))
    joints = [joint for reason in reasons for joint in _joints(motion.model, reason)]
    found = [change for joint in dict.fromkeys(joints) for change in _servo(motion, joint)]
    return tuple({change.word: change for change in reversed(found)}.values())[::-1]


def _joints(model: mujoco.MjModel, reason: Reason) -> Iterator[int]:
    """Yield the hinge or slide that a reason names."""
    for joint in np.flatnonzero(model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)):
        if reason.place == joint_name(model, int(joint)):
            yield int(joint)


def joint_inertia(motion: Motion, joint: int) -> float:
    """Return the inertia that a hinge or slide moves where a motion starts [kg m^2, or kg].

    1 / (M^-1)_jj, the others being free: armature a of the joint makes it I + a exactly.
    """
    model, data = motion.model, mujoco.MjData(motion.model)
    mujoco.mj_setState(model, data, motion.starts[0], INTEGRATION)
    mujoco.mj_forward(model, data)
    unit, moved = np.zeros((1, model.nv)), np.zeros((1, model.nv))
    dof = int(model.jnt_dofadr[joint])
    unit[0, dof] = 1
    mujoco.mj_solveM(model, data, moved, unit)
    return 1 / float(moved[0, dof])


def _servo(motion: Motion, joint: int) -> Iterator[FieldChange]:
    """Yield what lets the step hold a joint's servos and spring, where it cannot."""
    model, name = motion.model, name_of(motion.model, "joint", joint)
    step, dof, inertia = (
        float(model.opt.timestep),
        int(model.jnt_dofadr[joint]),
        joint_inertia(motion, joint),
    )
    servos = list(_servos(model, joint))
    square = model.actuator_gear[servos, 0] ** 2
    kp = float(-(model.actuator_biasprm[servos, _STIFFNESS] * square).sum())
    kv = float(-(model.actuator_biasprm[servos, _DAMPING] * square).sum())
    spring = float(np.ravel(model.jnt_stiffness[joint])[0])
    first, second = step**2 * (kp + spring) / inertia, step * kv / inertia
    load = first + 2 * second
    if not load > 1:
        return
    if servos:
        # Of the same damping ratio: kp s^2 and kv s, where a s^2 + 2 b s = 1.
        part = (math.hypot(second, math.sqrt(max(first, 0))) - second) / first if first > 0 else 0.0
        slower = part or 1 / (2 * second)
        phrase = f"gains of joint {name} that the step holds"
        yield FieldChange("gains", phrase, tuple(_slower(model, servos, slower)))
    armature = _rounded(float(model.dof_armature[dof]) + inertia * (load - 1))
    yield _of_joint(model, joint, "armature", armature)
    explicit = int(model.opt.integrator) == mujoco.mjtIntegrator.mjINT_RK4
    if not explicit and not disabled(model, "eulerdamp"):
        own = float(np.ravel(model.dof_damping[dof])[0])
        damping = _rounded(own + 2 * inertia * (load - 1) / step)
        yield _of_joint(model, joint, "damping", damping)


def _of_joint(model: mujoco.MjModel, joint: int, word: str, value: float) -> FieldChange:
    name, field, dof = name_of(model, "joint", joint), f"dof_{word}", int(model.jnt_dofadr[joint])
    index = (dof,) if np.ndim(getattr(model, field)) == 1 else (dof, 0)
    made = FieldValue(field, index, f"{field}[{name}]", value)
    return FieldChange(word, f"{word} {value:g} of joint {name}", (made,))


def _servos(model: mujoco.MjModel, joint: int) -> Iterator[int]:
    """Yield the actuators of a joint whose force depends on its position or speed."""
    for actuator in range(model.nu):
        at_joint = int(model.actuator_trntype[actuator]) == mujoco.mjtTrn.mjTRN_JOINT
        if (
            at_joint
            and int(model.actuator_trnid[actuator, 0]) == joint
            and int(model.actuator_biastype[actuator]) == _AFFINE
            and (model.actuator_biasprm[actuator, [_STIFFNESS, _DAMPING]] < 0).any()
        ):
            yield actuator


def _slower(model: mujoco.MjModel, servos: Sequence[int], part: float) -> Iterator[FieldValue]:
    """Yield the gains of servos that are slower by a factor."""
    for actuator in servos:
        gain, bias = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator]
        stiff, damped = -float(bias[_STIFFNESS]), -float(bias[_DAMPING])
        kp = _rounded(stiff * part**2, up=False) if stiff > 0 else 0.0
        kv = _rounded(damped * part, up=False) if damped > 0 else 0.0
        leading, own = (kp, stiff) if kp else (kv, damped)
        yield _parameter(model, actuator, ("gain", 0), float(gain) / own * leading)
        if kp:
            yield _parameter(model, actuator, ("bias", _STIFFNESS), -kp)
        if kv:
            yield _parameter(model, actuator, ("bias", _DAMPING), -kv)


def _parameter(
    model: mujoco.MjModel, actuator: int, which: tuple[str, int], value: float
) -> FieldValue:
    (kind, place), name = which, name_of(model, "actuator", actuator)
    field = f"actuator_{kind}prm"
    return FieldValue(field, (actuator, place), f"{field}[{name},{place}]", value)


def _rounded(number: float, *, up: bool = True) -> float:
    """Return a positive number in two digits, no smaller, or no larger."""
    unit = 10.0 ** (math.floor(math.log10(number)) + 1 - _DIGITS)
    whole = math.ceil(number / unit) if up else math.floor(number / unit)
    return float(f"{whole * unit:.{_DIGITS}g}")


_MORE, _LESS = (4, 16), (2,)  # how much shorter time constants get still; less if no step holds it
_COARSEST = 4  # the most steps in one of the run's that may hold it
PARTS_OF_A_STEP = {2: "half", 4: "a quarter of", 8: "an eighth of", 16: "a sixteenth of"}
# The fields that a row of softness is of, by kind.
_SOFT: Mapping[str, Sequence[str]] = {
    "contact softness": ("geom_solref", "pair_solref"),
    "limit softness": ("jnt_solref", "tendon_solref_lim"),
    "friction loss softness": ("dof_solref", "tendon_solref_fri"),
    "equality softness": ("eq_solref",),
}


def _stiffer(
    model: mujoco.MjModel, reasons: Sequence[Reason], within: float
) -> Iterator[FieldChange]:
    """Yield a shorter solref of the parts that are named, and of all of their kind.

    What gives under a load goes with the square of a time constant, and so does what a row reads of
    it: the constant is divided by a power of two, of which the square is at least the row's share
    over the tolerance; or by more, since what gives so much that it only swings then sways first.
    Where the step would not hold it, the step is divided, too.
    """
    soft = [reason for reason in reasons if reason.row in _SOFT]
    if not soft:
        return
    excess = max(reason.share for reason in soft) / within
    times = 2 ** max(1, math.ceil(math.log2(excess) / 2)) if math.isfinite(excess) else 2
    parts = list(dict.fromkeys(part for reason in soft for part in _named_parts(model, reason)))
    kinds = list(dict.fromkeys(reason.row.removesuffix(" softness") for reason in soft))
    fields = [field for kind in kinds for field in _SOFT[f"{kind} softness"]]
    every = [(field, row) for field in fields for row in _used_rows(model, field)]
    places = ", ".join(dict.fromkeys(reason.place for reason in soft if reason.place))
    every_one = f"every {' and '.join(kinds)}"
    for some, word, what in ((parts, "solref", places), (every, "solref-all", every_one)):
        if some and (word == "solref" or every != parts):
            yield from _ever_stiffer(model, some, times, word, what)


def _ever_stiffer(
    model: mujoco.MjModel, parts: Sequence[tuple[str, int]], times: int, word: str, what: str
) -> Iterator[FieldChange]:
    """Yield a shorter solref of parts, then those that go further, each in place of all before."""

    def shorter(more: int) -> FieldChange:
        own = word if more == 1 else f"{word}-{more * times}"
        return _of_solref(model, parts, more * times, own, what)

    def held(powers: Sequence[int]) -> list[FieldChange]:
        return [change for more in powers if (change := shorter(more)).rate <= _COARSEST]

    before = tuple[str, ...]()
    for change in (shorter(1), *(held(_MORE) or held(_LESS))):
        yield replace(change, after=before)
        before = (*before, change.phrase)


def _of_solref(
    model: mujoco.MjModel, parts: Sequence[tuple[str, int]], times: int, word: str, what: str
) -> FieldChange:
    """Return a solref of so many times the frequency of rows of fields, at a step that holds it."""
    found, rate = list[FieldValue](), 1
    for field, row in parts:
        kind = FIELD_KINDS[field.partition("_")[0]]
        index = int(model.dof_jntid[row]) if field.startswith("dof_") else row
        own: Floats = stiffened(getattr(model, field)[[row]], times)[0]
        # A time constant is at least two steps long, whether or not refsafe sees to it.
        if own[0] > 0:
            rate = max(rate, 2 ** math.ceil(math.log2(2 * model.opt.timestep / own[0])))
        axis = f"{field}[{name_of(model, kind, index)}]"
        found.append(FieldValue(field, (row,), axis, tuple(map(float, own))))
    at = "" if rate == 1 else f" at {PARTS_OF_A_STEP.get(rate, f'1/{rate} of')} the step"
    return FieldChange(word, f"solref / {times} of {what}{at}", tuple(found), rate)


def _named_parts(model: mujoco.MjModel, reason: Reason) -> Iterator[tuple[str, int]]:
    """Yield fields and rows of what a reason names."""
    kind, _, name = reason.place.partition(" ")
    if kind == "contact":
        yield from _touching(model, {find_id(model, "body", body) for body in name.split(" - ")})
        return
    for field in _SOFT[reason.row]:
        yield from (
            (field, row)
            for row in _used_rows(model, field)
            if _said(model, field, row) == reason.place
        )


def _touching(model: mujoco.MjModel, bodies: set[int]) -> Iterator[tuple[str, int]]:
    """Yield geoms of bodies, and pairs of two of them."""
    for geom in _used_rows(model, "geom_solref"):
        if int(model.geom_bodyid[geom]) in bodies:
            yield "geom_solref", geom
    geoms = np.stack([model.pair_geom1, model.pair_geom2], axis=1)
    for pair, both in enumerate(model.geom_bodyid[geoms]):
        if set(map(int, both)) == bodies:
            yield "pair_solref", pair


def _said(model: mujoco.MjModel, field: str, row: int) -> str:
    """Return how a reason speaks of what a row of a field belongs to."""
    if field.startswith("dof_"):
        return joint_name(model, int(model.dof_jntid[row]))
    kind = FIELD_KINDS[field.partition("_")[0]]
    return joint_name(model, row) if kind == "joint" else f"{kind} {_own(model, kind, row)}"


def _own(model: mujoco.MjModel, kind: str, index: int) -> str:
    return getattr(model, kind)(index).name or f"[{index}]"


def _used_rows(model: mujoco.MjModel, field: str) -> list[int]:
    """Return the rows of a field of solref that anything uses; those of a joint are one."""
    rows = used(model, field)
    if field == "eq_solref":
        rows &= (model.eq_active0 != 0) & ~hauled(model)
    rows = np.flatnonzero(rows)
    if field == "dof_solref":
        rows = rows[[int(model.jnt_dofadr[model.dof_jntid[row]]) == row for row in rows]]
    return [int(row) for row in rows]
