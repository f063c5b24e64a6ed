"""The change in motion between two models, over one second of the same task.

The first model's run is cut into windows. At the start of each, the second model gets the state of
the run, part by part, and the same inputs. The difference of their velocities at the end of the
window is the impulse of the residual force that the second model needs to move as the first. The
error is the sum of these impulses over the real ones, as in `contactlab.budget`, of the worst body.
"""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.defects import defects, paths
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.windows import gyration, judged_bodies
from contactlab.contact.trace_arrays import Floats
from contactlab.errors import EngineError, SceneError
from contactlab.numerical_tolerance import ROUNDING, SUM_ROUNDING
from contactlab.scene.model_names import name_of
from contactlab.scene.scene import Scene
from contactlab.schema.diff_report import MotionChange
from contactlab.studies.diff.matching import MatchedParts
from contactlab.tasks.task_motions import task_motions

_SECONDS, _WINDOW = 1.0, 0.04
_GRAVITY = 0.1  # share of free fall that counts as real impulse of a body at rest
_BODY = int(mujoco.mjtObj.mjOBJ_BODY)


class _SharedIndices(NamedTuple):
    """Indices of the shared parts in each of two models."""

    qpos: np.ndarray  # (k, 2)
    qvel: np.ndarray
    ctrl: np.ndarray
    act: np.ndarray
    bodies: np.ndarray
    mocap: np.ndarray


def motion_change(
    scene: Scene, one: mujoco.MjModel, other: mujoco.MjModel, found: MatchedParts
) -> tuple[MotionChange | None, str]:
    """Return the change in motion between two models, or None and the reason."""
    places = _shared_indices(one, other, found)
    moving = [body for body in judged_bodies(one).tolist() if body in places.bodies[:, 0]]
    if not len(places.qvel) or not moving:
        return None, "no moving body is in both models"
    try:
        task = scene.task({}, _SECONDS, seeds=(0,))
        motions = task_motions(scene, {}, task)
    except (EngineError, SceneError) as error:
        return None, str(error).splitlines()[0]
    parts = [_phase_impulses(motion, other, places, np.array(moving)) for motion in motions]
    apart, real = (np.sum([part[row] for part in parts], axis=0) for row in (0, 1))
    shares = apart / np.maximum(real, 1e-6 * real.max() + 1e-300)
    worst = int(np.argmax(np.nan_to_num(shares, nan=np.inf)))
    share = float(shares[worst]) if np.isfinite(shares[worst]) else float(np.finfo(float).max)
    body = name_of(one, "body", moving[worst])
    return MotionChange(task=task.line, error=share, body=body, window=_WINDOW), ""


def _shared_indices(
    one: mujoco.MjModel, other: mujoco.MjModel, found: MatchedParts
) -> _SharedIndices:
    qpos, qvel = list[tuple[int, int]](), list[tuple[int, int]]()
    for joint, same in found.both["joint"]:
        if one.jnt_type[joint] == other.jnt_type[same]:
            wide, turns = {0: (7, 6), 1: (4, 3)}.get(int(one.jnt_type[joint]), (1, 1))
            qpos += _index_pairs(one.jnt_qposadr[joint], other.jnt_qposadr[same], wide)
            qvel += _index_pairs(one.jnt_dofadr[joint], other.jnt_dofadr[same], turns)
    ctrl = [pair for pair in found.both["actuator"] if max(pair) < min(one.nu, other.nu)]
    act = [
        (int(one.actuator_actadr[first]), int(other.actuator_actadr[second]))
        for first, second in ctrl
        if one.actuator_actadr[first] >= 0 and other.actuator_actadr[second] >= 0
    ]
    mocap = [
        (int(one.body_mocapid[first]), int(other.body_mocapid[second]))
        for first, second in found.both["body"]
        if one.body_mocapid[first] >= 0 and other.body_mocapid[second] >= 0
    ]
    made = (qpos, qvel, ctrl, act, list(found.both["body"]), mocap)
    return _SharedIndices(*(np.array(pairs, int).reshape(-1, 2) for pairs in made))


def _index_pairs(first: int, second: int, count: int) -> Iterator[tuple[int, int]]:
    return ((int(first) + step, int(second) + step) for step in range(count))


def _phase_impulses(
    motion: Motion, other: mujoco.MjModel, places: _SharedIndices, moving: np.ndarray
) -> tuple[Floats, Floats]:
    """Return (B,) residual and real impulses of bodies over their masses [m/s], of a phase."""
    one, step = motion.model, float(motion.model.opt.timestep)
    length = max(1, min(motion.steps, round(_WINDOW / step)))
    same = dict(map(tuple, places.bodies.tolist()))
    theirs = np.array([same[body] for body in moving.tolist()])
    data, twin = mujoco.MjData(one), mujoco.MjData(other)
    mujoco.mj_setState(one, data, motion.starts[0], INTEGRATION)
    apart, real = np.zeros(len(moving)), np.zeros(len(moving))
    gravity = float(np.linalg.norm(one.opt.gravity))
    for begin in range(0, motion.steps - length + 1, length):
        _apply_inputs(motion, begin, one, data)
        _copy_state(data, twin, places)
        own = [_velocities(one, data, moving)]
        before = np.empty(mujoco.mj_stateSize(one, INTEGRATION))
        for place in range(begin, begin + length + 1):
            if place == begin + length:
                mujoco.mj_getState(one, data, before, INTEGRATION)
            _apply_inputs(motion, place, one, data)
            mujoco.mj_step(one, data)
            own.append(_velocities(one, data, moving))
        seen = _follow_window(motion, begin, length, (other, twin), places, theirs)
        mujoco.mj_setState(one, data, before, INTEGRATION)
        path = np.stack(own)[None]
        apart += defects(path[:, -3:], seen[None])[0]
        real += paths(path[:, :-1])[0] + _GRAVITY * gravity * length * step
        if begin == 0:
            real += np.linalg.norm(own[0], axis=-1)
    return apart, real


def _follow_window(
    motion: Motion,
    begin: int,
    length: int,
    twin: tuple[mujoco.MjModel, mujoco.MjData],
    places: _SharedIndices,
    bodies: np.ndarray,
) -> Floats:
    """Return (2 r + 1, B, 6) velocities of the second model around a window's end.

    It takes its own steps, of any length, with the inputs of the run.
    """
    (model, data), step = twin, float(motion.model.opt.timestep)
    source = mujoco.MjData(motion.model)
    # Where nothing is stored of each step, the start's own controls and forces act.
    mujoco.mj_setState(motion.model, source, motion.starts[0], INTEGRATION)
    seen, times = list[Floats](), list[float]()
    elapsed, place = 0.0, -1
    own = float(model.opt.timestep)
    while elapsed < (length + 1) * step * (1 - SUM_ROUNDING):
        now = begin + int(elapsed / step * (1 + ROUNDING))
        if now != place:
            place = now
            _apply_inputs(motion, place, motion.model, source)
            _copy_inputs(source, data, places)
        # From the last step that is not past a step of the run before the end.
        if elapsed + own > (length - 1) * step * (1 + SUM_ROUNDING):
            seen.append(_velocities(model, data, bodies))
            times.append(elapsed)
        mujoco.mj_step(model, data)
        elapsed += own
    seen.append(_velocities(model, data, bodies))
    # Straight in between, with the window's end in the middle, and its own steps where they fit.
    each_side = max(1, round(step / own))
    wanted = np.linspace((length - 1) * step, (length + 1) * step, 2 * each_side + 1)
    own_times, rows = np.array([*times, elapsed]), np.stack(seen)
    before = np.clip(np.searchsorted(own_times, wanted, "right") - 1, 0, len(rows) - 2)
    # Rounded, for sums of steps are: at a step of its own it is that step's, to the bit.
    part = ((wanted - own_times[before]) / own).round(9)[:, None, None]
    return (1 - part) * rows[before] + part * rows[before + 1]


def _apply_inputs(motion: Motion, place: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    rows = motion.rows(0, [place])
    if rows is not None:
        mujoco.mj_setState(model, data, rows[0], motion.spec)


def _copy_state(data: mujoco.MjData, twin: mujoco.MjData, places: _SharedIndices) -> None:
    """Copy the state of the first model into the second."""
    mujoco.mj_resetData(twin.model, twin)
    for name in ("qpos", "qvel", "act"):
        first, second = getattr(places, name).T
        getattr(twin, name)[second] = getattr(data, name)[first]
    first, second = places.mocap.T
    twin.mocap_pos[second], twin.mocap_quat[second] = data.mocap_pos[first], data.mocap_quat[first]
    first, second = places.qvel.T
    twin.qacc_warmstart[second] = data.qacc_warmstart[first]
    _copy_inputs(data, twin, places)


def _copy_inputs(data: mujoco.MjData, twin: mujoco.MjData, places: _SharedIndices) -> None:
    """Copy the controls and applied forces of the first model to the second."""
    for name, pairs in (
        ("ctrl", places.ctrl),
        ("qfrc_applied", places.qvel),
        ("xfrc_applied", places.bodies),
    ):
        first, second = pairs.T
        getattr(twin, name)[second] = getattr(data, name)[first]


def _velocities(model: mujoco.MjModel, data: mujoco.MjData, bodies: np.ndarray) -> Floats:
    """Return (B, 6) velocities of centres of mass, and spins times radii of gyration [m/s]."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)
    found, twist = np.empty((len(bodies), 6)), np.empty(6)
    for row, body in zip(found, bodies.tolist(), strict=True):
        mujoco.mj_objectVelocity(model, data, _BODY, body, twist, 0)
        row[:3], row[3:] = twist[3:], twist[:3]
    found[:, 3:] *= gyration(model)[bodies, None]
    return found
