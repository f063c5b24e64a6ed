"""A PD controller that holds the start of a run, by torques or by targets of position servos."""

import copy
from functools import partial
from typing import Any, NamedTuple, cast

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import PolicyClass
from contactlab.errors import SceneError

_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)


class PdGains(NamedTuple):
    """Gains of a PD as the actuators of a model have them."""

    places: np.ndarray  # of the joints in qpos
    dofs: np.ndarray
    controls: Floats  # per force of the joint


class PdController:
    """A PD of every joint that a motor moves; other controls are zero.

    Attributes:
        kp, kd: gains of the joints, as a policy states them.
    """

    def __init__(self, model: mujoco.MjModel, kp: float, kd: float) -> None:
        """Find the motors. Raises a SceneError for a model without one."""
        self.gains, self.kp, self.kd = find_motors(model), kp, kd
        self._starts, self._target = np.array([model.qpos0, *model.key_qpos]), np.empty(0)

    def __call__(self, time: Floats, qpos: Floats, qvel: Floats, sensordata: Floats) -> Floats:
        """Return (n, nu) controls; the target is the start nearest to the first observation."""
        del time, sensordata
        places, dofs, controls = self.gains
        if not self._target.size:
            nearest = int(np.linalg.norm(self._starts - qpos[0], axis=1).argmin())
            self._target = self._starts[nearest]
        error = self._target[places] - qpos[:, places]
        return (self.kp * error - self.kd * qvel[:, dofs]) * controls


def find_motors(model: mujoco.MjModel) -> PdGains:
    """Return the motors of slides and hinges.

    Raises:
        SceneError: an actuator has feedback of its own, or no motor moves a joint.
    """
    joints = np.asarray(model.actuator_trnid)[:, 0]
    single = (model.actuator_trntype == _JOINT) & (model.jnt_type[joints] >= _SLIDE)
    if np.any(model.actuator_biasprm[single, 1:3]):
        raise SceneError("a PD by gains drives motors, but actuators have feedback of their own")
    if not single.any():
        raise SceneError("a PD by gains drives motors of joints, but no motor moves a joint")
    used_joints = np.where(single, joints, 0)
    scale = model.actuator_gear[:, 0] * model.actuator_gainprm[:, 0]
    controls = np.where(single & (scale != 0), 1 / np.where(scale, scale, 1.0), 0.0)
    return PdGains(model.jnt_qposadr[used_joints], model.jnt_dofadr[used_joints], controls)


def send_targets(policy: PolicyClass) -> PolicyClass:
    """Return a policy that sends targets to the position servos of a model.

    The policy itself sees motors in their place. A target is where a servo makes the torque that
    the policy wants, so a PD with the gains of the servos sends the target of its own.

    Raises:
        SceneError: the policy is not a class.
    """
    if isinstance(policy, partial):
        return partial(send_targets(policy.func), **policy.keywords)
    if not isinstance(policy, type):
        raise SceneError("send=targets: the policy is a function; write a class, or leave it out")
    kind: Any = policy

    def make_policy(self: Any, model: mujoco.MjModel, **gains: float) -> None:  # noqa: ANN401
        motors, servos = copy.copy(model), find_servos(model)
        motors.actuator_biastype[servos] = int(mujoco.mjtBias.mjBIAS_NONE)
        motors.actuator_gainprm[servos] = motors.actuator_biasprm[servos] = 0.0
        motors.actuator_gainprm[servos, 0] = 1.0
        motors.actuator_ctrllimited[servos] = model.actuator_forcelimited[servos]
        motors.actuator_ctrlrange[servos] = model.actuator_forcerange[servos]
        kind.__init__(self, motors, **gains)
        self.position_servos = model, servos

    def find_targets(self: Any, *observed: Floats) -> Floats:  # noqa: ANN401
        model, servos = self.position_servos
        controls = np.array(kind.__call__(self, *observed), np.float64)
        if controls.shape == (len(observed[1]), model.nu):
            joints, gears = model.actuator_trnid[servos, 0], model.actuator_gear[servos, 0]
            length = gears * observed[1][:, model.jnt_qposadr[joints]]
            speed = gears * observed[2][:, model.jnt_dofadr[joints]]
            kp, kv = model.actuator_gainprm[servos, 0], -model.actuator_biasprm[servos, 2]
            controls[:, servos] = length + (controls[:, servos] + kv * speed) / kp
        return controls

    members = {"__init__": make_policy, "__call__": find_targets, "__module__": kind.__module__}
    return cast("PolicyClass", type(kind.__name__, (kind,), members))


def find_servos(model: mujoco.MjModel) -> np.ndarray:
    """Return the ids of the position servos of slides and hinges.

    Raises:
        SceneError: no servo moves a slide or a hinge.
    """
    joints = np.asarray(model.actuator_trnid)[:, 0]
    gains, biases = model.actuator_gainprm, model.actuator_biasprm
    single = (model.actuator_trntype == _JOINT) & (model.jnt_type[joints] >= _SLIDE)
    is_servo = single & (gains[:, 0] > 0) & (biases[:, 1] == -gains[:, 0]) & (biases[:, 0] == 0)
    if not is_servo.any():
        raise SceneError("send=targets: the model lacks position servos; leave it out")
    return np.flatnonzero(is_servo)
