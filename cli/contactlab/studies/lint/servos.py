"""Rules of servos and motors: targets out of reach, clipped forces, jaws, fast activations."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact.contact_laws import rest_penetration
from contactlab.contact.trace_arrays import Floats
from contactlab.numerical_tolerance import COARSE_ROUNDING, SUM_ROUNDING
from contactlab.scene.contact_pairs import half_extents
from contactlab.scene.model_text import mjcf_text
from contactlab.studies.lint.linted_model import Edit, Fault, LintedModel
from contactlab.studies.lint.rules import rule

_SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
_FIXED_GAIN = int(mujoco.mjtGain.mjGAIN_FIXED)
_FILTER, _MUSCLE = int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_MUSCLE)
_AFFINE, _NO_BIAS = int(mujoco.mjtBias.mjBIAS_AFFINE), int(mujoco.mjtBias.mjBIAS_NONE)
_LAGS = tuple(int(getattr(mujoco.mjtDyn, f"mjDYN_{name}")) for name in ("NONE", "FILTER"))


class _Servo(NamedTuple):
    """A servo of the position of a slide or hinge."""

    actuator: int
    joint: int
    gain: float  # force per joint position [N/m or Nm/rad]
    gear: float


def _list_servos(model: mujoco.MjModel) -> Iterator[_Servo]:
    # Yield the actuators that pull a joint to the control like a spring.
    for actuator in range(model.nu):
        joint, gear = (
            int(model.actuator_trnid[actuator, 0]),
            float(model.actuator_gear[actuator, 0]),
        )
        at_joint = model.actuator_trntype[actuator] == _JOINT and joint >= 0
        gain = float(model.actuator_gainprm[actuator, 0])
        pulls_back = -float(model.actuator_biasprm[actuator, 1])
        spring = (
            model.actuator_gaintype[actuator] == _FIXED_GAIN
            and model.actuator_biastype[actuator] == _AFFINE
            and gain > 0
            and np.isclose(gain, pulls_back)
        )
        if at_joint and spring and gear and model.jnt_type[joint] in _SCALAR:
            yield _Servo(actuator, joint, gain * gear**2, gear)


@rule("control-range", "warn")
def find_wide_control_ranges(linted: LintedModel) -> Iterator[Fault]:
    """A position servo takes targets far beyond the range of its joint.

    Targets lie more than a whole range beyond the range, as radians for degrees do. Fix: the range
    of the joint.
    """
    model, wide_servos = linted.model, list[tuple[_Servo, float]]()
    for servo in _list_servos(model):
        if not (model.actuator_ctrllimited[servo.actuator] and model.jnt_limited[servo.joint]):
            continue
        targets = np.sort(model.actuator_ctrlrange[servo.actuator] / servo.gear)
        low, high = model.jnt_range[servo.joint]
        beyond = max(low - targets[0], targets[1] - high)
        far_ranges = 1.0  # ranges of the joint: a servo that pushes against a stop asks for less
        if np.isfinite(beyond) and high > low and beyond > far_ranges * (high - low):
            wide_servos.append((servo, float(beyond / (high - low))))
    if wide_servos:
        servo, ranges = max(wide_servos, key=lambda one: one[1])
        more = f"; and {len(wide_servos) - 1} more" if len(wide_servos) > 1 else ""
        low, high = model.actuator_ctrlrange[servo.actuator] / servo.gear
        own = model.jnt_range[servo.joint]
        yield Fault(
            f"servo {linted.name('actuator', servo.actuator)} takes targets from {low:.4g} to "
            f"{high:.4g}, {ranges:.3g} ranges beyond joint {linted.name('joint', servo.joint)}, "
            f"which moves from {own[0]:.4g} to {own[1]:.4g}{more}; are these degrees or "
            "percent?",
            linted.place("actuator", servo.actuator),
        )


class _Motor(NamedTuple):
    """An actuator at a slide or hinge, its force in proportion to its control."""

    actuator: int
    joint: int
    gain: float  # N or Nm, per control
    gear: float


def _list_motors(model: mujoco.MjModel) -> Iterator[_Motor]:
    for actuator in range(model.nu):
        joint = int(model.actuator_trnid[actuator, 0])
        direct = (
            model.actuator_gaintype[actuator] == _FIXED_GAIN
            and model.actuator_biastype[actuator] == _NO_BIAS
            and model.actuator_dyntype[actuator] in _LAGS
            and model.actuator_trntype[actuator] == _JOINT
        )
        gain, gear = model.actuator_gainprm[actuator, 0], model.actuator_gear[actuator, 0]
        if direct and gain and gear and model.jnt_type[joint] in _SCALAR:
            yield _Motor(actuator, joint, float(gain), float(gear))


@rule("keyframe-torque", "warn", voids_starts=True)
def keyframe_torque(linted: LintedModel) -> Iterator[Fault]:
    """A keyframe gives motors the positions of their joints, as a servo would take them.

    Two motors at least have controls other than 0, and each of these equals the position of its
    joint. The motors take them as torques, so nothing holds the pose. Fix: a controller outside
    of the model (`--drive kp=400,kd=10`), or `<position>` for `<motor>`.
    """
    model = linted.model
    motors = list(_list_motors(model))
    for name, data in linted.starts.items():
        held = [motor for motor in motors if data.ctrl[motor.actuator]]
        same = all(
            math.isclose(
                data.ctrl[motor.actuator],
                data.qpos[model.jnt_qposadr[motor.joint]],
                rel_tol=COARSE_ROUNDING,
            )
            for motor in held
        )
        if len(held) > 1 and same:
            first = held[0]
            control = f"{data.ctrl[first.actuator]:.4g}"
            unit = "Nm" if model.jnt_type[first.joint] == mujoco.mjtJoint.mjJNT_HINGE else "N"
            yield Fault(
                f"keyframe '{name}' gives {len(held)} motors the positions of their joints, such "
                f"as {control} to {linted.name('actuator', first.actuator)}: a motor takes it as "
                f"{abs(first.gain * first.gear) * data.ctrl[first.actuator]:.4g} "
                f"{unit}, and nothing holds the pose; use a controller "
                "(--drive kp=400,kd=10, with your gains), or write position servos",
                linted.place("key", name),
            )


@rule("clipped-control", "note")
def clipped_control(linted: LintedModel) -> Iterator[Fault]:
    """Controls of a motor ask for more force than its own range or its joint's lets pass.

    All larger controls act alike, so a policy saturates early. Fix: the `ctrlrange` of that force.
    """
    model, clipped_motors = linted.model, list[tuple[float, float, float, _Motor]]()
    for motor in _list_motors(model):
        limits = list[float]()
        if model.actuator_forcelimited[motor.actuator]:
            limits.append(float(np.abs(model.actuator_forcerange[motor.actuator]).max()))
        if model.jnt_actfrclimited[motor.joint]:
            most = float(np.abs(model.jnt_actfrcrange[motor.joint]).max())
            limits.append(most / abs(motor.gear))
        if not limits or not model.actuator_ctrllimited[motor.actuator]:
            continue
        largest_control = float(np.abs(model.actuator_ctrlrange[motor.actuator]).max())
        acts = min(limits) / abs(motor.gain)
        slight = 1.01  # times the force: a rounded range
        if 0 < acts < largest_control / slight:
            clipped_motors.append((largest_control / acts, largest_control, acts, motor))
    if clipped_motors:
        times, largest_control, acts, motor = max(clipped_motors, key=lambda one: one[0])
        more = f"; and {len(clipped_motors) - 1} more motors" if len(clipped_motors) > 1 else ""
        yield Fault(
            f"motor {linted.name('actuator', motor.actuator)} takes controls up to "
            f"{largest_control:.4g}, but its force is clipped from {acts:.4g} on, {times:.3g} "
            f"times lower{more}; write the control range that acts",
            linted.place("actuator", motor.actuator),
        )


class _JawForce(NamedTuple):
    depth: float  # [m]
    force: float  # [N]
    servo: _Servo
    geom: int
    edits: tuple[Edit, ...]  # that limit the force


@rule("jaw-force", "warn", cause="file")
def find_strong_jaws(linted: LintedModel) -> Iterator[Fault]:
    """Jaws of position servos without a force range press through an object.

    Closed on an object that fills half of its opening, the jaw sinks in by more than half of its
    own thickness. Fix: `forcerange`, with the force of the real gripper.
    """
    model, data = linted.model, linted.reference
    halves, jaw_forces = half_extents(model), list[_JawForce]()
    for servo in _list_servos(model):
        geom = _find_jaw_geom(model, data, servo.joint)
        limited = (
            model.actuator_forcelimited[servo.actuator] or model.jnt_actfrclimited[servo.joint]
        )
        if geom < 0 or limited:
            continue
        span = model.jnt_range[servo.joint]
        if model.actuator_ctrllimited[servo.actuator]:
            ends = np.sort(model.actuator_ctrlrange[servo.actuator] / servo.gear)
            span = np.clip(ends, *span) if model.jnt_limited[servo.joint] else ends
        lever = np.linalg.norm(_joint_motion(model, data, servo.joint, geom))
        # Closed on an object that fills half of the opening.
        force = servo.gain * float(span[1] - span[0]) / 2 / float(lever)
        body = int(model.geom_bodyid[geom])
        depth = float(
            rest_penetration(
                force,
                model.body_invweight0[body, 0],
                model.geom_solref[geom],
                model.geom_solimp[geom],
            )
        )
        if depth > halves[geom]:
            # Depth is in proportion to force, as far as the impedance does not rise.
            rests = 0.5  # of the jaw's half thickness, as deep as contacts may rest
            most = force * float(lever) / abs(servo.gear) * rests * float(halves[geom]) / depth
            limits = mjcf_text([-float(f"{most:.2g}"), float(f"{most:.2g}")])
            edits = linted.set("actuator", servo.actuator, forcerange=limits)
            jaw_forces.append(_JawForce(depth, force, servo, geom, edits))
    if jaw_forces:
        depth, force, servo, geom, _ = max(jaw_forces, key=lambda one: one.depth)
        more = f"; and {len(jaw_forces) - 1} more" if len(jaw_forces) > 1 else ""
        name, jaw = linted.name("actuator", servo.actuator), linted.name("geom", geom)
        yield Fault(
            f"servo {name} of a jaw has no force range: closed on an object that fills half of its "
            f"opening it presses with {force:.3g} N, and {jaw} sinks in by "
            f"{1e3 * depth:.3g} mm{more}; write a forcerange, such as that of the real gripper",
            linted.place("actuator", servo.actuator),
            tuple(edit for one in jaw_forces for edit in one.edits),
        )


@rule("activation-step", "warn", cause="numerics")
def find_fast_activations(linted: LintedModel) -> Iterator[Fault]:
    """An activation is faster than the timestep, which integrates it explicitly.

    It overshoots, and swings without end if the timestep is above two time constants. Fix:
    `dyntype="filterexact"`, or a timestep of at most the time constant.
    """
    model, fast_actuators = linted.model, list[tuple[float, int]]()
    step = float(model.opt.timestep)
    for actuator in range(model.nu):
        dynamics = int(model.actuator_dyntype[actuator])
        # A muscle has one constant to activate and one to deactivate.
        count = 2 if dynamics == _MUSCLE else 1
        shortest = float(model.actuator_dynprm[actuator, :count].min())
        if dynamics in (_FILTER, _MUSCLE) and shortest < step * (1 - SUM_ROUNDING):
            fast_actuators.append((shortest, actuator))
    if fast_actuators:
        shortest, actuator = min(fast_actuators)
        more = f"; and {len(fast_actuators) - 1} more" if len(fast_actuators) > 1 else ""
        overshoots = 2.0  # explicit steps of a first-order lag grow beyond two time constants
        verb = "diverges" if step > overshoots * shortest else "overshoots"
        # Muscles and cylinders have no other activation.
        edits = [
            edit
            for _, one in fast_actuators
            for edit in linted.set("actuator", one, dyntype="filterexact")
            if edit.text.startswith("<general") and model.actuator_dyntype[one] == _FILTER
        ]
        is_exact = len(edits) == len(fast_actuators)
        instead = 'dyntype="filterexact", or ' if is_exact else ""
        shorter = linted.set_in("option", timestep=f"{shortest:.3g}")
        yield Fault(
            f"a step of {1e3 * step:.3g} ms is too long for the activation of "
            f"{linted.name('actuator', actuator)}: with a time constant of "
            f"{1e3 * shortest:.3g} ms, it {verb}{more}; write {instead}a timestep of at most "
            f"{1e3 * shortest:.3g} ms",
            linted.place("actuator", actuator),
            tuple(edits) if is_exact else shorter,
        )


def _joint_motion(model: mujoco.MjModel, data: mujoco.MjData, joint: int, geom: int) -> Floats:
    # Return the velocity (3,) of a geom's center when a joint moves at 1 [m/rad, or 1].
    jacobian = np.empty((3, model.nv))
    body = int(model.geom_bodyid[geom])
    mujoco.mj_jac(model, data, jacobian, None, data.geom_xpos[geom], body)
    return jacobian[:, model.jnt_dofadr[joint]]


def _find_jaw_geom(model: mujoco.MjModel, data: mujoco.MjData, joint: int) -> int:
    # Return the geom of a jaw that a joint closes on another jaw; -1 if it closes nothing.
    # Both jaws end a chain, and one body carries both. Each joint moves its geom along the line
    # between them by most of the gap.
    body = int(model.jnt_bodyid[joint])
    if (model.body_parentid == body).any() or model.body_jntnum[body] != 1:
        return -1
    parent = model.body_weldid[model.body_parentid[body]]
    for other in range(1, model.nbody):
        is_sibling = other != body and model.body_weldid[model.body_parentid[other]] == parent
        if not is_sibling or model.body_jntnum[other] != 1 or (model.body_parentid == other).any():
            continue
        second = int(model.body_jntadr[other])
        if model.jnt_type[second] not in _SCALAR:
            continue
        for geom in _colliding_geoms(model, body):
            for facing in _colliding_geoms(model, other):
                if _close_on_each_other(model, data, (joint, geom), (second, facing)):
                    return geom
    return -1


def _colliding_geoms(model: mujoco.MjModel, body: int) -> list[int]:
    own = model.geom_bodyid == body
    return np.flatnonzero(own & ((model.geom_contype | model.geom_conaffinity) != 0)).tolist()


def _close_on_each_other(
    model: mujoco.MjModel, data: mujoco.MjData, one: tuple[int, int], other: tuple[int, int]
) -> bool:
    # Return whether two joints move two geoms towards each other, until they nearly meet.
    way = data.geom_xpos[other[1]] - data.geom_xpos[one[1]]
    gap = float(np.linalg.norm(way))
    if not gap:
        return False
    reach = 0.0
    for joint, geom in (one, other):
        motion = _joint_motion(model, data, joint, geom)
        along, size = abs(float(motion @ way)) / gap, float(np.linalg.norm(motion))
        straight = 0.7  # cosine between the motion of a jaw and the line to the other one
        if not size or along < straight * size or not model.jnt_limited[joint]:
            return False
        reach += along * float(np.ptp(model.jnt_range[joint]))
    met_share = 0.5  # of the gap between centers, which the width of jaws and object fill
    return reach >= met_share * gap
