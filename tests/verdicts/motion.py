"""What a plain loop over `mj_step` sees of a model, and of the same with finer steps or awake."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

_SEEN = ("qpos", "qvel", "xpos", "site_xpos", "ten_length", "flexvert_xpos")


@dataclass(frozen=True)
class Motion:
    """What a plain loop over `mj_step` saw; row k is the state before step k.

    Attributes:
        model: what was stepped.
        time: (N + 1) [s].
        qpos: (N + 1, nq).
        qvel: (N + 1, nv).
        xpos: (N + 1, nbody, 3) [m].
        site: (N + 1, nsite, 3) [m].
        length: (N + 1, ntendon) [m].
        vertex: (N + 1, nflexvert, 3) [m].
        energy: (N + 1) potential and kinetic [J].
        pressed: (N + 1) the largest normal force of any contact [N].
    """

    model: mujoco.MjModel
    time: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    xpos: np.ndarray
    site: np.ndarray
    length: np.ndarray
    vertex: np.ndarray
    energy: np.ndarray
    pressed: np.ndarray

    def joint(self, name: str) -> np.ndarray:
        """Return (N + 1) the first coordinate of a joint."""
        return self.qpos[:, int(self.model.joint(name).qposadr[0])]

    def speed(self, name: str) -> np.ndarray:
        """Return (N + 1) the first speed of a joint."""
        return self.qvel[:, int(self.model.joint(name).dofadr[0])]

    def body(self, name: str) -> np.ndarray:
        """Return (N + 1, 3) the place of a body's frame [m]."""
        return self.xpos[:, self.model.body(name).id]

    def gap(self, first: str, second: str) -> np.ndarray:
        """Return (N + 1) the distance of two sites [m]."""
        sites = (self.site[:, self.model.site(name).id] for name in (first, second))
        return np.linalg.norm(np.subtract(*sites), axis=1)


def watch(text: str, duration: float, *, nudge: float = 0.0, factor: int = 1) -> Motion:
    """Step a model with plain MuJoCo, from a start that is off by a nudge [m, rad] at random.

    Its steps are so many times shorter than it says, and the rows of the motion as many more.
    """
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep /= factor
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = _started(model)
    off = np.random.default_rng(0).normal(0, nudge, model.nv)
    mujoco.mj_integratePos(model, data.qpos, off, 1)
    return _film(model, data, round(duration / model.opt.timestep))


def finer(motion: Motion, factor: int = 16) -> Motion:
    """Step the same from the same start by so many times shorter steps; its rows are as many."""
    model = copy.copy(motion.model)
    model.opt.timestep /= factor
    data = _started(model)
    data.qpos[:] = motion.qpos[0]
    return _film(model, data, len(motion.time) - 1, every=factor)


def awake(motion: Motion) -> Motion:
    """Step the same from the same state with sleep switched off; its rows are as many."""
    model = copy.copy(motion.model)
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = motion.qpos[0], motion.qvel[0]
    return _film(model, data, len(motion.time) - 1)


def _started(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    return data


def _film(model: mujoco.MjModel, data: mujoco.MjData, steps: int, *, every: int = 1) -> Motion:
    rows: list[tuple[object, ...]] = []
    for _ in range(steps + 1):
        mujoco.mj_forward(model, data)
        seen = [getattr(data, name).copy() for name in _SEEN]
        rows.append((data.time, *seen, float(data.energy.sum()), _pressed(model, data)))
        mujoco.mj_step(model, data, nstep=every)
    return Motion(model, *(np.array(column) for column in zip(*rows, strict=True)))


def _pressed(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    force, largest = np.zeros(6), 0.0
    for contact in range(data.ncon):
        mujoco.mj_contactForce(model, data, contact, force)
        largest = max(largest, float(force[0]))
    return largest
