"""Measures the servos of a model: stiffness, sag, frequency, and the gains that the step holds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.closed_loop.borders import find_border
from contactlab.closed_loop.linear_model import (
    LinearModel,
    ServoForce,
    linearize_model,
    list_servos,
    name_integrator,
)
from contactlab.contact.trace_arrays import Floats
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.model_names import name_of
from contactlab.schema.servo import Servo

_SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)


@dataclass(frozen=True)
class _Group:
    """Actuators along the same moment.

    Attributes:
        forces: of the actuators.
        joint: that they move most.
        way: (nv,) motion of all degrees of freedom per motion of the joint.
    """

    forces: tuple[ServoForce, ...]
    joint: int
    way: Floats

    @property
    def stiffness(self) -> float:
        """Stiffness of the feedback along the joint."""
        return sum(one.stiffness * float(one.row @ self.way) ** 2 for one in self.forces)

    @property
    def damping(self) -> float:
        """Damping of the feedback along the joint."""
        return sum(one.damping * float(one.row @ self.way) ** 2 for one in self.forces)

    def scale_gains(self, linear: LinearModel, stiffness: float, damping: float) -> LinearModel:
        """Return the model with the gains of all its actuators times two factors."""
        for force in self.forces:
            linear = linear.scale_servo(force, stiffness, damping)
        return linear


def measure_servos(
    model: mujoco.MjModel, start: mujoco.MjData, rests: Sequence[mujoco.MjData] = ()
) -> tuple[Servo, ...]:
    """Return the servos of a model in a state from `mj_forward`.

    `rests` are states of the task at rest, also from `mj_forward`.
    """
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:], data.act[:] = start.qpos, start.ctrl, start.act
    data.mocap_pos[:], data.mocap_quat[:] = start.mocap_pos, start.mocap_quat
    mujoco.mj_forward(model, data)
    linear = linearize_model(model, data)

    # Position and velocity actuators of one joint are one servo.
    single = np.isin(model.jnt_type[model.dof_jntid], _SCALAR)
    ways = dict[int, list[tuple[ServoForce, Floats]]]()
    for force in list_servos(model, data):
        moved = np.where(single, np.abs(force.row), 0.0)
        dof = int(moved.argmax())
        way = linear.free @ (linear.free.T @ (force.row / np.abs(force.row).max()))
        if not moved[dof] or abs(way[dof]) < COARSE_ROUNDING:
            continue  # a site in space, or a joint that an equality holds
        ways.setdefault(int(model.dof_jntid[dof]), []).append((force, way / way[dof]))
    groups = [
        _Group(tuple(force for force, _ in forces), joint, forces[0][1])
        for joint, forces in ways.items()
    ]

    if not groups or not linear.weighs:
        return ()
    is_stable = model.opt.integrator == getattr(mujoco.mjtIntegrator, "mjINT_DISCRETE", -1)
    is_stable = is_stable or linear.holds_step()
    growing = np.zeros(model.nv) if is_stable else linear.find_growing_dofs()
    shares = [float(growing[model.jnt_dofadr[group.joint]]) for group in groups]
    most = max(shares)
    return tuple(
        _measure_group(model, data, linear, group, rests, grows=bool(most and share >= most / 2))
        for group, share in zip(groups, shares, strict=True)
    )


def _measure_group(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    linear: LinearModel,
    group: _Group,
    rests: Sequence[mujoco.MjData],
    *,
    grows: bool,
) -> Servo:
    joint, way, own = group.joint, group.way, group.stiffness
    dof, body = int(model.jnt_dofadr[joint]), int(model.jnt_bodyid[joint])
    inertia, whole = float(way @ linear.mass @ way), float(way @ linear.stiffness @ way)
    damping = float(way @ (linear.explicit + linear.implicit) @ way)
    # Gravity is balanced by the joint's springs, or by its compensation, before the servo. Of some
    # joints, the compensation is a part of the actuator's force.
    compensated = np.asarray(model.jnt_actgravcomp)[model.dof_jntid].astype(float)
    balanced = data.qfrc_passive + data.qfrc_gravcomp * compensated
    gravity = float(way @ (data.qfrc_bias - balanced))
    task = [_find_force(group, rest) for rest in rests]
    lever = _find_lever(model, data, joint)
    hinge = model.jnt_type[joint] == _HINGE
    gain, stiffest, strongest, armature = _find_limits(model, linear, group, grows=grows)
    load = float(np.mean(task)) if task else math.nan
    held_body = next(filter(None, (_find_pressed_body(model, rest, body) for rest in rests)), 0)
    solid = np.flatnonzero((model.geom_bodyid == held_body) & (model.geom_contype > 0))
    held_size = 2 * float(model.geom_aabb[solid, 3:].min(initial=math.inf))
    return Servo(
        name=name_of(model, "joint", joint),
        actuators=tuple(name_of(model, "actuator", one.actuator) for one in group.forces),
        body=name_of(model, "body", body),
        unit="rad" if hinge else "m",
        stiffness=own,
        tip_stiffness=own / lever**2 if hinge and lever and own else None,
        damping=damping,
        inertia=inertia,
        frequency=math.sqrt(whole / inertia) / (2 * math.pi) if own else None,
        damping_ratio=damping / (2 * math.sqrt(whole * inertia)) if own else None,
        travel=_find_travel(model, group),
        gravity_load=gravity,
        gravity_sag=gravity / whole if own else None,
        task_load=load,
        task_sag=load / own if own else None,
        held_body=name_of(model, "body", held_body) if held_body else "",
        held_size=held_size if held_body else None,
        timestep=linear.timestep,
        integrator=name_integrator(linear.integrator),
        holds=not grows,
        largest_gain=gain,
        largest_stiffness=stiffest,
        largest_damping=strongest,
        armature=float(model.dof_armature[dof]),
        least_armature=armature,
    )


def _find_force(group: _Group, data: mujoco.MjData) -> float:
    # The force that the feedback applies along the joint, in the way of its own motion.
    forces = ((float(data.actuator_force[one.actuator]), one.row) for one in group.forces)
    return sum(force * float(row @ group.way) for force, row in forces)


def _find_limits(
    model: mujoco.MjModel, linear: LinearModel, group: _Group, *, grows: bool
) -> tuple[float, float, float, float]:
    # The largest factor, stiffness and damping, and the least armature; NaN without a border.
    discrete = int(getattr(mujoco.mjtIntegrator, "mjINT_DISCRETE", -1))
    if model.opt.integrator == discrete or (not grows and not linear.holds_step()):
        # The step is implicit in all of them, or no gain of this servo changes that.
        return math.nan, math.nan, math.nan, math.nan
    dof = int(model.jnt_dofadr[group.joint])
    own = float(model.dof_armature[dof])
    most_gain = 100.0  # largest factor that is tried

    def find_factor(stiffness: bool, damping: bool) -> float:
        def holds_with_gain(factor: float) -> bool:
            scaled = (factor if one else 1.0 for one in (stiffness, damping))
            return group.scale_gains(linear, *scaled).holds_step()

        outer = 0.0 if grows else most_gain
        if holds_with_gain(outer) != grows:
            return math.nan
        return find_border(holds_with_gain, outer if grows else 1.0, 1.0 if grows else outer)

    def holds_with(armature: float) -> bool:
        return linear.add_armature(dof, armature - own).holds_step()

    factor = find_factor(stiffness=True, damping=True)
    stiffest = find_factor(stiffness=True, damping=False) * (group.stiffness or math.nan)
    strongest = find_factor(stiffness=False, damping=True) * (group.damping or math.nan)
    if not grows:
        armature = 0.0 if holds_with(0.0) else find_border(holds_with, own, 0.0)
    else:
        moved = float(group.way @ linear.mass @ group.way)
        most = own + 1e3 * moved
        armature = find_border(holds_with, most, own) if holds_with(most) else math.nan
    return factor, stiffest, strongest, armature


def _find_travel(model: mujoco.MjModel, group: _Group) -> float | None:
    joint, actuator = group.joint, group.forces[0].actuator
    if model.jnt_limited[joint]:
        travel = float(np.ptp(model.jnt_range[joint]))
    elif model.actuator_ctrllimited[actuator] and group.forces[0].stiffness:
        travel = float(np.ptp(model.actuator_ctrlrange[actuator]))
        travel /= abs(float(group.forces[0].row @ group.way))
    else:
        return None
    return travel or None


def _find_lever(model: mujoco.MjModel, data: mujoco.MjData, joint: int) -> float:
    body, corners = int(model.jnt_bodyid[joint]), np.array(np.meshgrid(*[[-1, 1]] * 3))
    signs, farthest = corners.reshape(3, -1).T, 0.0
    for geom in np.flatnonzero(model.geom_bodyid == body):
        center, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        points = (center + signs * half) @ data.geom_xmat[geom].reshape(3, 3).T
        arms = data.geom_xpos[geom] + points - data.xanchor[joint]
        farthest = max(farthest, np.linalg.norm(np.cross(arms, data.xaxis[joint]), axis=1).max())
    return float(farthest)


def _find_pressed_body(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> int:
    # A moving body that touches this one, or a body that it carries; 0 for none.
    moved = np.zeros(model.nbody, bool)
    for one in range(body, model.nbody):
        moved[one] = one == body or moved[model.body_parentid[one]]
    pairs = data.contact.geom[data.contact.efc_address >= 0]
    for one, two in model.geom_bodyid[pairs[(pairs >= 0).all(axis=1)]].tolist():
        other = two if moved[one] else one
        if moved[one] != moved[two] and model.body_weldid[other] > 0:
            return other
    return 0
