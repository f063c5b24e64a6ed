"""A PD controller that holds the start of a run by torques."""

from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats

_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)


class PdGains(NamedTuple):
    """Gains of a PD as the actuators of a model have them."""

    places: np.ndarray  # of the joints in qpos
    dofs: np.ndarray
    controls: Floats  # per force of the joint


class PdController:
    """A PD of every joint that a motor moves; other controls are zero."""

    def __init__(self, model: mujoco.MjModel, kp: float, kd: float) -> None:
        """Find the motors. Raises a ValueError for a model without one."""
        self.gains, self._kp, self._kd = find_motors(model), kp, kd
        self._starts, self._target = np.array([model.qpos0, *model.key_qpos]), np.empty(0)

    def __call__(self, time: Floats, qpos: Floats, qvel: Floats, sensordata: Floats) -> Floats:
        """Return (n, nu) controls; the target is the start nearest to the first observation."""
        del time, sensordata
        places, dofs, controls = self.gains
        if not self._target.size:
            nearest = int(np.linalg.norm(self._starts - qpos[0], axis=1).argmin())
            self._target = self._starts[nearest]
        error = self._target[places] - qpos[:, places]
        return (self._kp * error - self._kd * qvel[:, dofs]) * controls


def find_motors(model: mujoco.MjModel) -> PdGains:
    """Return the motors of slides and hinges.

    Raises:
        ValueError: an actuator has feedback of its own, or no motor moves a joint.
    """
    joints = np.asarray(model.actuator_trnid)[:, 0]
    single = (model.actuator_trntype == _JOINT) & (model.jnt_type[joints] >= _SLIDE)
    if np.any(model.actuator_biasprm[single, 1:3]):
        raise ValueError("a PD by gains drives motors, but actuators have feedback of their own")
    if not single.any():
        raise ValueError("a PD by gains drives motors of joints, but there are none")
    used = np.where(single, joints, 0)
    scale = model.actuator_gear[:, 0] * model.actuator_gainprm[:, 0]
    controls = np.where(single & (scale != 0), 1 / np.where(scale, scale, 1.0), 0.0)
    return PdGains(model.jnt_qposadr[used], model.jnt_dofadr[used], controls)
