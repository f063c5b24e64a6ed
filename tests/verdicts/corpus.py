"""Models that fail in silence, each with a healthy twin, and the truth about both.

A case is one MJCF text with a few numbers left open: the failing model has one set of them, its
twin another. What is true of either is found by stepping it with plain MuJoCo from its first
keyframe (or its reference configuration) and measuring one quantity, whose limit was fixed from the
physics of the scene, not from what any label says.
"""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np


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

    @property
    def end(self) -> slice:
        """The last quarter."""
        return slice(3 * len(self.time) // 4, None)

    def joint(self, name: str) -> np.ndarray:
        return self.qpos[:, int(self.model.joint(name).qposadr[0])]

    def speed(self, name: str) -> np.ndarray:
        return self.qvel[:, int(self.model.joint(name).dofadr[0])]

    def body(self, name: str) -> np.ndarray:
        return self.xpos[:, self.model.body(name).id]

    def gap(self, first: str, second: str) -> np.ndarray:
        """Return (N + 1) the distance of two sites [m]."""
        sites = (self.site[:, self.model.site(name).id] for name in (first, second))
        return np.linalg.norm(np.subtract(*sites), axis=1)


Truth = Callable[[Motion], float]


@dataclass(frozen=True)
class Case:
    """One failing model and its twin.

    Attributes:
        kind: what fails: actuator, contact, constraint, passing, loss or support.
        name: of the case.
        xml: the MJCF, open numbers in `<<NAME>>`.
        failing: the numbers of the failing model; empty where only a sound model is told.
        healthy: those of its twin.
        truth: what is measured of either.
        limit: above it a model has failed; twins stay below half of it.
        duration: how long it is watched [s].
    """

    kind: str
    name: str
    xml: str
    failing: Mapping[str, object]
    healthy: Mapping[str, object]
    truth: Truth
    limit: float
    duration: float = field(default=2.0)

    def text(self, *, healthy: bool) -> str:
        """Return the MJCF of the failing model or its twin."""
        text = self.xml
        for name, value in (self.healthy if healthy else self.failing).items():
            text = text.replace(f"<<{name}>>", str(value))
        return f"<mujoco>{text}</mujoco>"


def case(  # noqa: PLR0917 They stand in a fixed order in a hundred calls.
    kind: str,
    name: str,
    xml: str,
    open_numbers: Mapping[str, Sequence[object]],
    truth: Truth,
    limit: float,
    duration: float = 2.0,
) -> Case:
    """Return a case; its open numbers as (failing, healthy), or (healthy,) where none fails."""
    failing = {key: values[0] for key, values in open_numbers.items() if len(values) > 1}
    healthy = {key: values[-1] for key, values in open_numbers.items()}
    return Case(kind, name, xml, failing, healthy, truth, limit, duration)


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
        rows.append(
            (
                data.time,
                data.qpos.copy(),
                data.qvel.copy(),
                data.xpos.copy(),
                data.site_xpos.copy(),
                data.ten_length.copy(),
                data.flexvert_xpos.copy(),
                float(data.energy.sum()),
                _pressed(model, data),
            )
        )
        mujoco.mj_step(model, data, nstep=every)
    return Motion(model, *(np.array(column) for column in zip(*rows, strict=True)))


def _pressed(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    force, largest = np.zeros(6), 0.0
    for contact in range(data.ncon):
        mujoco.mj_contactForce(model, data, contact, force)
        largest = max(largest, float(force[0]))
    return largest


def restless(motion: Motion) -> float:
    """Return the rms of all joint speeds over the last quarter [m/s, rad/s]."""
    return float(np.sqrt(np.mean(np.square(motion.qvel[motion.end]))))


def opened(first: str, second: str) -> Truth:
    """Return what measures how far two sites part [m], after the start has settled."""
    return lambda motion: float(motion.gap(first, second)[motion.end].max())


def beyond(joint: str, low: float, high: float) -> Truth:
    """Return what measures how far a joint leaves a range, relative to its width."""

    def measure(motion: Motion) -> float:
        place = motion.joint(joint)
        return float(max((place - high).max(), (low - place).max(), 0) / (high - low))

    return measure


def below(body: str, level: float, axis: int = 2) -> Truth:
    """Return what measures how far a body gets below a level along an axis [m]."""
    return lambda motion: float(max((level - motion.body(body)[:, axis]).max(), 0.0))


def past(body: str, level: float, size: float, axis: int = 2) -> Truth:
    """Return what measures how far a body gets above a level along an axis, relative to a size."""
    return lambda motion: float(max((motion.body(body)[:, axis] - level).max(), 0.0) / size)


def under(body: str, level: float, size: float, axis: int = 2) -> Truth:
    """Return what measures how far a body gets below a level along an axis, relative to a size."""
    return lambda motion: float(max((level - motion.body(body)[:, axis]).max(), 0.0) / size)


def rests_off(body: str, level: float) -> Truth:
    """Return what measures how far from a height a body is at the end [m]."""
    return lambda motion: float(abs(motion.body(body)[motion.end, 2] - level).max())


def departs(place: Callable[[Motion], np.ndarray], law: Callable[[np.ndarray], object]) -> Truth:
    """Return what measures how far a motion leaves a law of time."""
    return lambda motion: float(np.abs(place(motion) - law(motion.time)).max())


def ends_off(place: Callable[[Motion], np.ndarray], end: object, size: float) -> Truth:
    """Return what measures how far from a place a motion ends, relative to a size."""
    return lambda motion: float(np.abs(place(motion)[motion.end] - end).max() / size)


def slipped(ratio: float, driver: str, driven: str) -> Truth:
    """Return what measures how far two geared joints part [m, rad], as driven - ratio driver."""
    return lambda motion: float(
        np.abs(motion.joint(driven) - ratio * motion.joint(driver))[motion.end].max()
    )


def strays(place: Callable[[Motion], np.ndarray], size: float, factor: int = 16) -> Truth:
    """Return what measures how far a motion is from that of finer steps, relative to a size."""
    return lambda motion: float(np.abs(place(motion) - place(finer(motion, factor))).max() / size)


def trembles(speed: float, *joints: str) -> Truth:
    """Return what measures by how much joint speeds alternate from step to step at the end.

    That is the rms amplitude of the worst joint's alternation, relative to a speed of the scene.
    """
    return lambda motion: max(
        float(np.sqrt(np.mean(np.square(np.diff(motion.speed(joint)[motion.end], 2))))) / 4 / speed
        for joint in joints
    )


def unbalanced(scale: float) -> Truth:
    """Return what measures how far the energy leaves its first value, relative to a scale [J]."""
    return lambda motion: float(np.abs(motion.energy - motion.energy[0]).max() / scale)


def gained(scale: float) -> Truth:
    """Return what measures by how much the energy tops its first value, relative to a scale [J]."""
    return lambda motion: float((motion.energy.max() - motion.energy[0]) / scale)
