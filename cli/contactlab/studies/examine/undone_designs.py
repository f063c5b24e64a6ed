"""Designs that a right simulation shows to do nothing: each is found by its motion.

A suction cup that lets its object go and a wheel that spins in place fail. A servo that its load
stops at its limit of force, or that its own robot stops, and a body that hangs in the air, may be
meant.
"""

import math
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.force_places import contact_name
from contactlab.contact.trace_arrays import Floats
from contactlab.measure.friction import RATE
from contactlab.rendering.amounts import format_amount, format_digits, format_percent
from contactlab.scene.closed_start import moving_extent
from contactlab.scene.contact_pairs import touch_pairs
from contactlab.scene.model_names import name_of
from contactlab.scene.part_bodies import AT_JOINT
from contactlab.schema.examination import Cause, Fact
from contactlab.studies.examine.standing_starts import (
    HeldPosition,
    begin_motion,
    list_held_positions,
    step_first_seed,
)

_FREE, _HINGE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_HINGE)
_AT_BODY = int(mujoco.mjtTrn.mjTRN_BODY)
_LEAST_RATE = RATE.default or 0.0  # sizes per second: slower, a body rests
_NEAR = 0.05  # share that counts as all of it: of a range, of a limit of force, of a rim's way


@dataclass(frozen=True)
class TaskEnds:
    """The begin and the end of a motion, which is run once when its end is first requested.

    Attributes:
        motion: the first phase of a task.
    """

    motion: Motion

    @property
    def model(self) -> mujoco.MjModel:
        """The model of the motion."""
        return self.motion.model

    @cached_property
    def is_driven_evenly(self) -> bool:
        """Whether the controls are constant, so that its end is where they hold the model."""
        return not np.any(self.motion.inputs[0] != self.motion.inputs[0][0])

    @cached_property
    def begin(self) -> mujoco.MjData:
        """The first state of the first seed, forwarded."""
        return begin_motion(self.motion)

    @cached_property
    def end(self) -> mujoco.MjData:
        """The last state of the first seed, forwarded."""
        data = begin_motion(self.motion)
        for _ in step_first_seed(self.motion, data):
            pass
        mujoco.mj_forward(self.model, data)
        return data

    def find_size(self, joint: int) -> float:
        """Return the range of a joint [rad, m]; unlimited, a turn or the model's extent."""
        model = self.model
        if model.jnt_limited[joint]:
            return float(np.ptp(model.jnt_range[joint]))
        hinge = int(model.jnt_type[joint]) == _HINGE
        return 2 * math.pi if hinge else moving_extent(model, self.begin)


def list_undone_designs(ends: TaskEnds) -> Iterator[Cause]:
    """Yield the causes of a suction cup or a wheel that its drive moves in vain."""
    if not ends.is_driven_evenly:
        return
    for sentence in (*_list_lost_suctions(ends), *_list_spinning_wheels(ends)):
        yield Cause(stage="design", sentence=sentence)


def list_idle_facts(ends: TaskEnds) -> Iterator[Fact]:
    """Yield facts that may be meant: bodies that hang in the air, servos short of their controls.

    Servos count if all of their force does not lift their load, and the one that links of its own
    robot stop farthest from its control.
    """
    if not ends.is_driven_evenly:
        return
    yield from _list_hanging_bodies(ends)
    for held in _list_stalled_servos(ends):
        sentence = f"{_describe_gap(ends, held)}, its limit: it does not lift its load"
        yield _state_servo(ends, held, sentence, "limp")
    worst, found = _NEAR, list[tuple[HeldPosition, str]]()
    for held in _list_resting_servos(ends):
        place = _find_own_stop(ends.model, ends.end, held.joint)
        share = _measure_gap(ends.model, ends.end, held) / ends.find_size(held.joint)
        if place and share > worst:
            worst, found = share, [(held, place)]
    for held, place in found:
        yield _state_servo(ends, held, f"{_describe_gap(ends, held)}: {place} stops it", "servo")


def _state_servo(
    ends: TaskEnds, held: HeldPosition, sentence: str, kind: Literal["limp", "servo"]
) -> Fact:
    return Fact(
        kind=kind,
        place=name_of(ends.model, "joint", held.joint),
        value=_measure_gap(ends.model, ends.end, held),
        unit="rad" if ends.model.jnt_type[held.joint] == _HINGE else "m",
        sentence=sentence,
    )


def _list_resting_servos(ends: TaskEnds) -> Iterator[HeldPosition]:
    # Position servos that rest at the end far from where their control holds them.
    model, data = ends.model, ends.end
    for held in list_held_positions(model, data):
        size, dof = ends.find_size(held.joint), int(model.jnt_dofadr[held.joint])
        rests = abs(data.qvel[dof]) <= _LEAST_RATE * size
        if rests and _measure_gap(model, data, held) > _NEAR * size:
            yield held


def _measure_gap(model: mujoco.MjModel, data: mujoco.MjData, held: HeldPosition) -> float:
    return abs(float(data.qpos[model.jnt_qposadr[held.joint]]) - held.position)


def _describe_gap(ends: TaskEnds, held: HeldPosition) -> str:
    model, data = ends.model, ends.end
    hinge = model.jnt_type[held.joint] == _HINGE
    gap = _measure_gap(model, data, held)
    amount = f"{format_digits(math.degrees(gap), 2)} deg" if hinge else format_amount(gap, "mm")
    force = abs(float(data.qfrc_actuator[model.jnt_dofadr[held.joint]]))
    torque = f"{format_digits(force)} {'N m' if hinge else 'N'}"
    name = name_of(model, "joint", held.joint)
    return f"the servo of {name} rests {amount} short of its control, at {torque}"


def _list_stalled_servos(ends: TaskEnds) -> Iterator[HeldPosition]:
    # That weight stops at their limit of force: without gravity, they arrive.
    model = ends.model
    stalled = [held for held in _list_resting_servos(ends) if _is_at_limit(model, ends.end, held)]
    if not stalled or not np.any(model.opt.gravity):
        return
    weightless = copy(model)
    weightless.opt.gravity[:] = 0
    free = TaskEnds(replace(ends.motion, model=weightless)).end
    for held in stalled:
        if _measure_gap(model, free, held) <= _NEAR * ends.find_size(held.joint):
            yield held


def _is_at_limit(model: mujoco.MjModel, data: mujoco.MjData, held: HeldPosition) -> bool:
    # Whether its actuator, or the joint for all of its actuators, gives all of its force.
    dof, actuator = int(model.jnt_dofadr[held.joint]), held.actuator
    limits = list[tuple[float, Floats]]()
    if model.actuator_forcelimited[actuator]:
        limits.append((float(data.actuator_force[actuator]), model.actuator_forcerange[actuator]))
    if model.jnt_actfrclimited[held.joint]:
        limits.append((float(data.qfrc_actuator[dof]), model.jnt_actfrcrange[held.joint]))
    return any(
        force <= low + _NEAR * abs(low) or force >= high - _NEAR * abs(high)
        for force, (low, high) in limits
    )


def _find_own_stop(model: mujoco.MjModel, data: mujoco.MjData, joint: int) -> str:
    # The contact of a joint's links with another link of the robot that presses most.
    force, forces = np.empty(6), dict[str, float]()
    moved = _list_moved(model, int(model.jnt_bodyid[joint]))
    for place in range(data.ncon):
        geoms = data.contact.geom[place]
        if geoms.min() < 0:
            continue
        bodies = model.geom_bodyid[geoms]
        one, other = model.body_rootid[bodies]
        mujoco.mj_contactForce(model, data, place, force)
        if one == other and moved[bodies[0]] != moved[bodies[1]] and force[0] > 0:
            name = contact_name(model, geoms)
            forces[name] = forces.get(name, 0.0) + float(force[0])
    return max(forces, key=lambda name: forces[name], default="")


def _list_moved(model: mujoco.MjModel, body: int) -> np.ndarray:
    # Whether each body is this one, or carried by it.
    moved = np.arange(model.nbody) == body
    for each in range(body + 1, model.nbody):
        moved[each] |= moved[model.body_parentid[each]]
    return moved


def _list_lost_suctions(ends: TaskEnds) -> Iterator[str]:
    # Adhesions that pull all the time, and let go of the objects that they begin on.
    model = ends.model
    for actuator in np.flatnonzero(model.actuator_trntype == _AT_BODY).tolist():
        body = int(model.actuator_trnid[actuator, 0])
        if not (ends.begin.ctrl[actuator] > 0 and ends.end.ctrl[actuator] > 0):
            continue
        lost = _list_touched(model, ends.begin, body) - _list_touched(model, ends.end, body)
        for other in sorted(lost):
            pull = float(ends.end.actuator_force[actuator])
            weight = float(model.body_subtreemass[other] * np.linalg.norm(model.opt.gravity))
            yield (
                f"{name_of(model, 'body', body)} lets go of {name_of(model, 'body', other)}, where "
                f"it begins: its adhesion pulls with {format_digits(pull)} N all the time, and "
                f"{name_of(model, 'body', other)} weighs {format_digits(weight)} N"
            )


def _list_touched(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> set[int]:
    # The roots of floating bodies in contact with a body of another tree.
    floating = set(model.jnt_bodyid[model.jnt_type == _FREE].tolist())
    bodies = model.geom_bodyid[data.contact.geom[(data.contact.geom >= 0).all(axis=1)]]
    roots = {
        int(model.body_rootid[other])
        for pair in bodies.tolist()
        for one, other in (pair, pair[::-1])
        if one == body
    }
    return (roots & floating) - {int(model.body_rootid[body])}


def _list_spinning_wheels(ends: TaskEnds) -> Iterator[str]:
    # The first driven wheel of a floating robot that turns, while the robot stays in place.
    model, data = ends.model, ends.end
    driven = np.unique(model.actuator_trnid[np.isin(model.actuator_trntype, AT_JOINT), 0])
    for joint in driven[model.jnt_type[driven] == _HINGE].tolist():
        body = int(model.jnt_bodyid[joint])
        root = int(model.body_rootid[body])
        roots = model.jnt_type[model.body_jntadr[root]] == _FREE if root != body else False
        turned = abs(_measure_turn(ends, joint))
        if not roots or turned < 2 * math.pi * _NEAR:
            continue
        for place in range(data.ncon):
            radius, slip = _measure_slip(model, data, joint, place)
            way = float(np.linalg.norm(ends.end.xpos[root] - ends.begin.xpos[root]))
            if radius and slip >= 1 - _NEAR and way <= _NEAR * radius * turned:
                friction = float(data.contact.friction[place][0])
                of = (
                    "has no friction (condim 1)"
                    if data.contact.dim[place] == 1
                    else f"has friction {format_digits(friction)}"
                )
                yield (
                    f"the wheel of {name_of(model, 'joint', joint)} spins in place: its rim goes "
                    f"{format_amount(radius * turned, 'mm')}, and {name_of(model, 'body', root)} "
                    f"{format_amount(way, 'mm')}; "
                    f"{contact_name(model, data.contact.geom[place])} {of}"
                )
                return


def _measure_turn(ends: TaskEnds, joint: int) -> float:
    place = int(ends.model.jnt_qposadr[joint])
    return float(ends.end.qpos[place] - ends.begin.qpos[place])


def _measure_slip(
    model: mujoco.MjModel, data: mujoco.MjData, joint: int, place: int
) -> tuple[float, float]:
    # The radius of a wheel at a contact with another tree [m], and the share of its speed that
    # slips; zeros if it does not roll there: a wheel's axle is across the contact's normal.
    contact, body = data.contact[place], int(model.jnt_bodyid[joint])
    if contact.geom.min() < 0:
        return 0.0, 0.0
    bodies = model.geom_bodyid[contact.geom]
    if body not in bodies or len(set(model.body_rootid[bodies])) < len(bodies):
        return 0.0, 0.0
    axis, normal = data.xaxis[joint], contact.frame[:3]
    arm = contact.pos - data.xanchor[joint]
    arm = arm - axis * (axis @ arm)
    rim = data.qvel[model.jnt_dofadr[joint]] * np.cross(axis, arm)
    if abs(axis @ normal) > _NEAR or not rim.any():
        return 0.0, 0.0
    ways = np.empty((2, 3, model.nv))
    for way, one in zip(ways, bodies, strict=True):
        mujoco.mj_jac(model, data, way, None, contact.pos, int(one))
    speeds = ways @ data.qvel
    own = list(bodies).index(body)
    slip = (speeds[own] - speeds[1 - own]) @ rim / (rim @ rim)
    return float(np.linalg.norm(arm)), float(slip)


def _list_hanging_bodies(ends: TaskEnds) -> Iterator[Fact]:
    # Passive bodies that could collide, and that gravcomp alone keeps in the air.
    model = ends.model
    at_joint = np.isin(model.actuator_trntype, AT_JOINT)
    # Tendons, equalities and the medium may move any body.
    is_moved = model.opt.density or model.neq or model.ntendon or not at_joint.all()
    if not model.body_gravcomp.any() or is_moved:
        return
    colliding = {int(model.geom_bodyid[geom]) for pair in touch_pairs(model) for geom in pair}
    driven = model.body_rootid[model.jnt_bodyid[model.actuator_trnid[:, 0]]].tolist()
    for joint in np.flatnonzero(model.jnt_type == _FREE).tolist():
        root, dof = int(model.jnt_bodyid[joint]), int(model.jnt_dofadr[joint])
        own = np.flatnonzero(model.body_rootid == root)
        if root in driven or colliding.isdisjoint(own.tolist()):
            continue
        lifted = float(model.body_mass[own] @ model.body_gravcomp[own])
        share = lifted / float(model.body_mass[own].sum())
        moves = any(data.qvel[dof : dof + 6].any() for data in (ends.begin, ends.end))
        if abs(share - 1) <= _NEAR and not moves:
            name = name_of(model, "body", root)
            yield Fact(
                kind="limp",
                place=name,
                value=share,
                unit="1",
                sentence=f"{name} hangs in the air and never moves: its gravcomp cancels "
                f"{format_percent(share)} of its weight, and nothing drives or touches it",
            )
