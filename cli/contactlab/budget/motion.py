"""The motions that a budget is of: a model, its starts, and stored inputs of each step."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.mujoco_batch import driven_inputs, start_batch
from contactlab.errors import EngineError
from contactlab.scene.initial_states import InitialStates

INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)
_BODY_FORCES = int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)
_JOINT_FORCES = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)


GRAVITY_AS_REAL = 0.1
"""Share of the impulse of free fall that counts as a real impulse of a standing body."""


@dataclass(frozen=True)
class Motion:
    """One phase of a task: a model moved from S starts, each by inputs of its own.

    The stored inputs are replayed at the run's own rate. For a policy, these are its actions;
    whether its loop would be stable at another step is not judged.

    Attributes:
        model: as its author wrote it; its timestep, solver and integrator are judged.
        starts: (S, nstate) states before the first step, as `mj_getState` gives them for
            mjSTATE_INTEGRATION, one row for each seed.
        inputs: (S, N, width) set before each of N steps; a width of 0 leaves the starts' own.
        spec: the bits of mjtState that a row of inputs holds, in `mj_setState`'s order.
        name: of the phase.
        observed: bodies whose shares count; all if empty.
        usual: (nbody,) how fast velocities of bodies change in the whole task, on the mean
            [m/s^2]. It is the measure of a phase without weight and motion; None takes the mean of
            this phase.
    """

    model: mujoco.MjModel
    starts: Floats
    inputs: Floats
    spec: int = _CONTROL
    name: str = ""
    observed: tuple[str, ...] = ()
    usual: Floats | None = None

    def __post_init__(self) -> None:
        state, width = mujoco.mj_stateSize(self.model, INTEGRATION), self.inputs.shape[-1]
        if self.starts.ndim != 2 or self.starts.shape[1] != state:
            raise EngineError(
                f"starts have shape {self.starts.shape}; give (seeds, {state}) rows of "
                "mjSTATE_INTEGRATION"
            )
        if self.inputs.ndim != 3 or len(self.inputs) != len(self.starts):
            raise EngineError(
                f"inputs have shape {self.inputs.shape}; give ({len(self.starts)}, steps, width)"
            )
        if width and width != mujoco.mj_stateSize(self.model, self.spec):
            raise EngineError(
                f"a row of inputs has {width} numbers, and spec {self.spec} of this model "
                f"{mujoco.mj_stateSize(self.model, self.spec)}"
            )
        if not self.inputs.shape[1]:
            raise EngineError("a motion of 0 steps has no budget; give inputs of at least one")

    @property
    def seeds(self) -> int:
        """How often the phase was started, S."""
        return len(self.starts)

    @property
    def steps(self) -> int:
        """How many steps each seed makes, N."""
        return self.inputs.shape[1]

    def rows(self, seed: int, steps: Sequence[int] | np.ndarray) -> Floats | None:
        """Return (K, width) inputs of some steps; those beyond the last hold its inputs."""
        if not self.inputs.shape[2]:
            return None
        return self.inputs[seed, np.minimum(steps, self.steps - 1)]

    def state_part(self, bit: int) -> Floats:
        """Return (S, N, width) the inputs of each step to a part of the state, such as forces."""
        width = mujoco.mj_stateSize(self.model, bit)
        rows, spec = self.inputs, self.spec
        if not (self.inputs.shape[2] and spec & bit):
            rows, spec = self.starts[:, None], INTEGRATION
        begin = mujoco.mj_stateSize(self.model, (bit - 1) & spec)
        part = rows[..., begin : begin + width]
        return np.broadcast_to(part, (self.seeds, self.steps, width))


def measure_pulls(motion: Motion, gravity: Floats) -> Floats:
    """Return (S, N, nbody) how fast gravity and applied forces would make each tree fall [m/s^2].

    A weight may be written as gravity (3,) [m/s^2], or as forces on bodies or free joints.
    """
    model, shape = motion.model, (motion.seeds, motion.steps)
    forces = motion.state_part(_BODY_FORCES).reshape(*shape, model.nbody, 6)[..., :3].copy()
    of_joints = motion.state_part(_JOINT_FORCES)
    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        dof = model.jnt_dofadr[joint]
        forces[..., model.jnt_bodyid[joint], :] += of_joints[..., dof : dof + 3]
    roots, places = np.unique(model.body_rootid, return_inverse=True)
    moving = model.body_mass * (model.body_weldid > 0)
    whole = np.zeros((*shape, len(roots), 3))
    for body in np.flatnonzero(moving):
        whole[..., places[body], :] += forces[..., body, :]
    masses = np.bincount(places, moving)
    fall = gravity + whole / np.where(masses > 0, masses, np.inf)[:, None]
    return np.linalg.norm(fall, axis=-1)[..., places]


def without_delays(motion: Motion) -> Motion:
    """Return a motion whose inputs are the controls that its actuators saw in each step.

    A delay is a buffer of as many samples as there are steps in it, so at finer steps the same
    buffer would hold less time, and the model would be another one. `forget_delays` is for models
    that are given such inputs.
    """
    model, delays = motion.model, getattr(motion.model, "actuator_delay", np.empty(0))
    delayed = np.flatnonzero(delays)
    if not delayed.size:
        return motion
    data, acting_controls = mujoco.MjData(model), np.empty((motion.seeds, motion.steps, model.nu))
    for seed in range(motion.seeds):
        mujoco.mj_setState(model, data, motion.starts[seed], INTEGRATION)
        rows = motion.rows(seed, np.arange(motion.steps))
        for step in range(motion.steps):
            if rows is not None:
                mujoco.mj_setState(model, data, rows[step], motion.spec)
            acting_controls[seed, step] = data.ctrl
            for actuator in map(int, delayed):
                first, count = model.actuator_ctrladr[actuator], model.actuator_ctrlnum[actuator]
                own = np.zeros((count, 1))
                own = mujoco.mj_readCtrl(model, data, actuator, data.time, own, -1)
                acting_controls[seed, step, first : first + count] = own.ravel()
            mujoco.mj_step(model, data)
    others = motion.inputs
    if others.shape[2] and motion.spec & _CONTROL:
        others = others[:, :, model.nu :]
    spec = (motion.spec if motion.inputs.shape[2] else 0) | _CONTROL
    return replace(motion, inputs=np.concatenate([acting_controls, others], axis=2), spec=spec)


def forget_delays(model: mujoco.MjModel) -> None:
    """Have a model's actuators see their controls at once."""
    if hasattr(model, "actuator_delay"):
        model.actuator_delay[:] = 0


def motion_of_run(
    model: mujoco.MjModel, starts: InitialStates, run: int, steps: int, name: str = ""
) -> Motion:
    """Return the motion of a scene's run: one seed, with the controls and forces that drive it."""
    batch = start_batch([model], starts.select_run(run))
    drive_inputs = driven_inputs(model, starts, run, steps)
    inputs = drive_inputs.get("control", np.empty((1, steps, 0)))
    return Motion(
        model, batch.state.copy(), inputs, int(drive_inputs.get("control_spec", _CONTROL)), name
    )
