"""Turns the motors of a PD into position servos that have its gains.

A servo is a part of the model, so it acts in each step, and an implicit integrator holds its
damping. Only a PD that states its gains is turned, and only if its derivatives confirm them.
"""

import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np

from contactlab.closed_loop.control_loop import ControlLoop, LoopRows
from contactlab.closed_loop.linear_model import name_integrator
from contactlab.engines.pd_controller import find_motors, send_targets
from contactlab.errors import SceneError
from contactlab.scene.model_names import find_id, name_of
from contactlab.schema.servo import PositionServo

IMPLICIT = ("implicit", "implicitfast")


def list_stated_servos(loop: ControlLoop) -> tuple[PositionServo, ...]:
    """Return the servos of a PD that states its gains; none if it does not.

    A policy states them as `kp` and `kd`: numbers, or one for each actuator, per control or per
    torque of the joint. Its derivatives at the start have to be these gains, and nothing else.
    """
    if not isinstance(loop.policy, type | partial):
        return ()
    model, rows = loop.model, LoopRows(loop)
    try:
        motors = find_motors(model)
        stated_gains = [
            np.broadcast_to(np.asarray(getattr(rows.policy, name), float), model.nu)
            for name in ("kp", "kd")
        ]
    except (SceneError, ValueError, TypeError, AttributeError):
        return ()
    if not np.isfinite(stated_gains).all():
        return ()
    driven = motors.controls != 0
    if np.any(model.actuator_gainprm[driven, 0] != 1) or np.any(model.actuator_dyntype[driven]):
        return ()
    gears, each = np.where(driven, model.actuator_gear[:, 0], 1.0), np.arange(model.nu)
    slopes = -rows.linearize_policy()
    for per_joint in (1.0, 1 / gears):
        kp, kd = (np.where(driven, gains * per_joint, 0.0) for gains in stated_gains)
        stated_slopes = np.zeros_like(slopes)
        stated_slopes[each, motors.dofs], stated_slopes[each, model.nv + motors.dofs] = kp, kd
        if np.allclose(slopes, stated_slopes, rtol=1e-3, atol=1e-3 * np.abs(stated_slopes).max()):
            turned = np.flatnonzero(kp * gears > 0).tolist()
            return tuple(_make_servo(model, one, kp[one], kd[one]) for one in turned)
    return ()


def _make_servo(model: mujoco.MjModel, actuator: int, kp: float, kd: float) -> PositionServo:
    # The clamp of a motor's control is one of its force.
    joint, gear = int(model.actuator_trnid[actuator, 0]), float(model.actuator_gear[actuator, 0])
    limits = [
        getattr(model, f"actuator_{kind}range")[actuator]
        for kind in ("ctrl", "force")
        if getattr(model, f"actuator_{kind}limited")[actuator]
    ]
    reach = np.sort(gear * model.jnt_range[joint]) if model.jnt_limited[joint] else np.zeros(2)
    return PositionServo(
        actuator=name_of(model, "actuator", actuator),
        kp=float(kp / gear),
        kv=float(kd / gear),
        forces=(
            (max(float(low) for low, _ in limits), min(float(high) for _, high in limits))
            if limits
            else None
        ),
        targets=(float(reach[0]), float(reach[1])),
    )


def list_steered_keys(
    model: mujoco.MjModel, servos: Sequence[PositionServo]
) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """Return the keyframes with the targets that hold their own configuration."""
    ids = [find_id(model, "actuator", servo.actuator) for servo in servos]
    joints, gears = model.actuator_trnid[ids, 0], model.actuator_gear[ids, 0]
    controls = model.key_ctrl.copy()
    controls[:, ids] = gears * model.key_qpos[:, model.jnt_qposadr[joints]]
    names = [name_of(model, "key", key) for key in range(model.nkey)]
    return tuple((name, tuple(row)) for name, row in zip(names, controls.tolist(), strict=True))


def move_inside(loop: ControlLoop, servos: Sequence[PositionServo]) -> ControlLoop:
    """Return the loop with servos in place of motors; its policy sends targets to them."""
    model = copy.copy(loop.model)
    ids = [find_id(model, "actuator", servo.actuator) for servo in servos]
    model.actuator_biastype[ids] = int(mujoco.mjtBias.mjBIAS_AFFINE)
    model.actuator_gainprm[ids] = model.actuator_biasprm[ids] = 0.0
    for one, servo in zip(ids, servos, strict=True):
        model.actuator_gainprm[one, 0] = servo.kp
        model.actuator_biasprm[one, 1:3] = -servo.kp, -servo.kv
        model.actuator_forcelimited[one] = servo.forces is not None
        model.actuator_forcerange[one] = servo.forces or (0.0, 0.0)
    model.actuator_ctrllimited[ids] = 0
    if name_integrator(model.opt.integrator) not in IMPLICIT:
        model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    return replace(loop, model=model, policy=send_targets(loop.policy))
