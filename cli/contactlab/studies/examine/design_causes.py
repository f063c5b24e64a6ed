"""Causes that no numerics remove: a servo that sags, and an object that a hand does not hold."""

import math
from collections.abc import Iterator

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.contact.trace_arrays import Floats
from contactlab.measure.friction import RATE
from contactlab.rendering.amounts import format_digits, format_percent
from contactlab.scene.contact_pairs import half_extents
from contactlab.schema.examination import Cause
from contactlab.schema.grip import GripReport
from contactlab.studies.examine.standing_starts import (
    begin_motion,
    list_held_positions,
    step_first_seed,
)
from contactlab.studies.examine.undone_designs import TaskEnds

_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
_MOST_SPEED = RATE.default or 0.0  # sizes per second: faster, a body does not rest


def find_sagging_servo(ends: TaskEnds, most: float = 0.05) -> Iterator[Cause]:
    """Yield the servo that moves farthest from where it begins, and where its control holds it.

    It rests at the end, and no contact, limit or equality carries a tenth of its force.

    Args:
        ends: of the task.
        most: share of a joint's range that a servo may yield to its load.
    """
    if not ends.is_driven_evenly:
        return
    model, data = ends.model, ends.end
    worst, sentence = most, ""
    for _, joint, aim, _ in list_held_positions(model, data):
        dof, hinge = int(model.jnt_dofadr[joint]), int(model.jnt_type[joint]) == _HINGE
        size, place = ends.find_size(joint), int(model.jnt_qposadr[joint])
        begin, end = float(ends.begin.qpos[place]), float(data.qpos[place])
        carried = abs(data.qfrc_constraint[dof]) > 0.1 * abs(data.qfrc_actuator[dof])
        moves = abs(data.qvel[dof]) > _MOST_SPEED * size
        sag = min(abs(end - aim), abs(end - begin)) / size
        if carried or moves or abs(begin - aim) > most * size / 2 or not sag > worst:
            continue
        amount = _describe_length(model, joint, end - aim)
        worst = sag
        sentence = (
            f"the servo of {model.joint(joint).name or f'joint[{joint}]'} sags by {amount} from "
            f"where the keyframe holds it, under {format_digits(abs(data.qfrc_actuator[dof]), 2)} "
            f"{'N m' if hinge else 'N'}: a gain {format_digits(10 * sag / most, 2)} times as "
            f"large, with its damping, sags by {format_percent(most / 10)} of the range"
        )
    if sentence:
        yield Cause(stage="design", sentence=sentence)


def find_overrun_stop(ends: TaskEnds, most: float = 0.05) -> Iterator[Cause]:
    """Yield the servo that rests farthest beyond a limit of its joint, with its target beyond it.

    Args:
        ends: of the task.
        most: share of a joint's range that a limit may yield to its servo, as in
            `find_sagging_servo`.
    """
    if not ends.is_driven_evenly:
        return
    model, data = ends.model, ends.end
    worst, sentence = most, ""
    for _, joint, nearest, target in list_held_positions(model, data):
        size, end = ends.find_size(joint), float(data.qpos[model.jnt_qposadr[joint]])
        rests = abs(data.qvel[model.jnt_dofadr[joint]]) <= _MOST_SPEED * size
        # A target within the range leaves nothing beyond it, and both lie on the same side.
        beyond = math.copysign(1.0, target - nearest) * (end - nearest) if target != nearest else 0
        if not rests or not beyond / size > worst:
            continue
        worst = beyond / size
        far, out = (_describe_length(model, joint, each) for each in (target - nearest, beyond))
        sentence = (
            f"the servo of {model.joint(joint).name or f'joint[{joint}]'} presses it {out} beyond "
            f"its limit ({format_percent(worst)} of its range): its control asks for {far} beyond"
        )
    if sentence:
        yield Cause(stage="design", sentence=sentence)


def _describe_length(model: mujoco.MjModel, joint: int, amount: float) -> str:
    if int(model.jnt_type[joint]) == _HINGE:
        return f"{format_digits(math.degrees(abs(amount)), 2)} deg"
    return f"{format_digits(1e3 * abs(amount), 2)} mm"


def find_lost_grip(model: mujoco.MjModel, grip: GripReport, sentence: str) -> Iterator[Cause]:
    """Yield the cause of a grip that does not hold, as `contactlab grip` judges it.

    An object that a keyframe holds may creep as fast as any other at rest, and is judged under its
    own weight: loads from other sides are not those of the task.
    """
    if grip.holds:
        return
    creeps = grip.verdict == "creeps" and grip.keyframe is not None
    if creeps and (grip.drifts[0].speed or 0.0) <= _MOST_SPEED * _measure_held_size(model, grip):
        return
    is_choice = any(cause.kind == "regularized friction" for cause in grip.causes)
    yield Cause(stage="modeling choice" if is_choice else "design", sentence=sentence)


def leaves_hand(motion: Motion, grip: GripReport) -> bool:
    """Return whether the object of a keyframe's grip moves in the hand more than if it rested."""
    model, data = motion.model, begin_motion(motion)
    held_body, base = _find_held_body(model, grip), model.body(grip.base).id
    size = _measure_held_size(model, grip)
    begun = _place_in(data, held_body, base)
    for _ in step_first_seed(motion, data):
        pass
    seconds = motion.steps * float(model.opt.timestep)
    way = float(np.linalg.norm(_place_in(data, held_body, base) - begun))
    return bool(size) and way > _MOST_SPEED * seconds * size


def _find_held_body(model: mujoco.MjModel, grip: GripReport) -> int:
    return int(model.body(grip.object.removeprefix("body ")).id)


def _measure_held_size(model: mujoco.MjModel, grip: GripReport) -> float:
    # Half of the largest extent of its geoms [m].
    geoms = np.flatnonzero(model.geom_bodyid == _find_held_body(model, grip))
    return float(half_extents(model)[geoms].max(initial=0.0))


def _place_in(data: mujoco.MjData, body: int, base: int) -> Floats:
    turn = np.asarray(data.xmat[base]).reshape(3, 3)
    place: Floats = turn.T @ (data.xpos[body] - data.xpos[base])
    return place
