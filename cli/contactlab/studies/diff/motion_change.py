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
from contactlab.budget.defects import measure_defects, measure_paths, slack_share
from contactlab.budget.measuring import WINDOW
from contactlab.budget.motion import GRAVITY_AS_REAL, INTEGRATION
from contactlab.budget.restarts import scale_of_impulses, whole_windows
from contactlab.budget.windows import Observer, judged_bodies, replay_motion
from contactlab.contact.trace_arrays import Floats
from contactlab.errors import EngineError, SceneError
from contactlab.numerical_tolerance import ROUNDING, SUM_ROUNDING
from contactlab.scene.model_names import name_of
from contactlab.scene.scene import Scene
from contactlab.schema.diff_report import MotionChange
from contactlab.studies.diff.matching import MatchedParts
from contactlab.tasks.task_motions import task_motions

_INPUTS = sum(
    int(getattr(mujoco.mjtState, f"mjSTATE_{name}"))
    for name in ("CTRL", "QFRC_APPLIED", "XFRC_APPLIED")
)


class _SharedIndices(NamedTuple):
    """Indices of the shared parts in each of two models."""

    qpos: np.ndarray  # (k, 2)
    qvel: np.ndarray
    ctrl: np.ndarray
    act: np.ndarray
    bodies: np.ndarray
    mocap: np.ndarray


def motion_change(
    scene: Scene, one: mujoco.MjModel, other: mujoco.MjModel, matched_parts: MatchedParts
) -> tuple[MotionChange | None, str]:
    """Return the change in motion between two models, or None and the reason."""
    qpos, qvel = list[tuple[int, int]](), list[tuple[int, int]]()
    for joint, same in matched_parts.both["joint"]:
        if one.jnt_type[joint] == other.jnt_type[same]:
            wide, turns = {0: (7, 6), 1: (4, 3)}.get(int(one.jnt_type[joint]), (1, 1))
            qpos += _index_pairs(one.jnt_qposadr[joint], other.jnt_qposadr[same], wide)
            qvel += _index_pairs(one.jnt_dofadr[joint], other.jnt_dofadr[same], turns)
    ctrl = [pair for pair in matched_parts.both["actuator"] if max(pair) < min(one.nu, other.nu)]
    act = [
        (int(one.actuator_actadr[first]), int(other.actuator_actadr[second]))
        for first, second in ctrl
        if one.actuator_actadr[first] >= 0 and other.actuator_actadr[second] >= 0
    ]
    mocap = [
        (int(one.body_mocapid[first]), int(other.body_mocapid[second]))
        for first, second in matched_parts.both["body"]
        if one.body_mocapid[first] >= 0 and other.body_mocapid[second] >= 0
    ]
    index_pairs = (qpos, qvel, ctrl, act, list(matched_parts.both["body"]), mocap)
    places = _SharedIndices(*(np.array(pairs, int).reshape(-1, 2) for pairs in index_pairs))
    moving = [body for body in judged_bodies(one).tolist() if body in places.bodies[:, 0]]
    if not len(places.qvel) or not moving:
        return None, "no moving body is in both models"
    try:
        seconds = 1.0  # of the task
        task = scene.task({}, seconds, seeds=(0,))
        motions = task_motions(scene, {}, task)
        parts = [_phase_impulses(motion, other, places, np.array(moving)) for motion in motions]
    except (EngineError, SceneError) as error:
        return None, str(error).splitlines()[0]
    apart, real = (np.sum([part[row] for part in parts], axis=0) for row in (0, 1))
    shares = apart / scale_of_impulses(real)
    worst = int(np.argmax(np.nan_to_num(shares, nan=np.inf)))
    share = float(shares[worst]) if np.isfinite(shares[worst]) else float(np.finfo(float).max)
    body = name_of(one, "body", moving[worst])
    return MotionChange(task=task.line, error=share, body=body, window=WINDOW), ""


def _index_pairs(first: int, second: int, count: int) -> Iterator[tuple[int, int]]:
    return ((int(first) + step, int(second) + step) for step in range(count))


def _phase_impulses(
    motion: Motion, other: mujoco.MjModel, places: _SharedIndices, moving: np.ndarray
) -> tuple[Floats, Floats]:
    """Return (B,) residual and real impulses of bodies over their masses [m/s], of a phase."""
    model, step = motion.model, float(motion.model.opt.timestep)
    run = replay_motion(motion, WINDOW, 1)
    windows = [window for window in whole_windows(run) if run.valid[0, window]]
    if not windows:
        raise EngineError(f"MuJoCo gave up in the first window of {motion.name}")
    begins = run.begins[windows]
    states = np.stack([run.velocity_states[0, begin : begin + run.steps + 2] for begin in begins])
    path = Observer(model, motion.starts[0], moving, 1)(states)[0]
    velocities = _follow_windows(
        motion, begins, run.starts[0, windows], run.steps, other, places, moving
    )
    gravity = float(np.linalg.norm(model.opt.gravity))
    weight = GRAVITY_AS_REAL * gravity * run.steps * step
    real = (measure_paths(path[:, :-1]) + weight).sum(axis=0)
    if windows[0] == 0:
        real += np.linalg.norm(path[0, 0], axis=-1)
    apart = measure_defects(path[:, -3:], velocities, slack_share(run.steps))
    return apart.sum(axis=0), real


def _follow_windows(
    motion: Motion,
    begins: np.ndarray,
    states: Floats,
    length: int,
    other: mujoco.MjModel,
    places: _SharedIndices,
    moving: np.ndarray,
) -> Floats:
    """Return (M, 2 r + 1, B, 6) velocities of the second model around the ends of windows.

    It takes its own steps, of any length, with the inputs of the run.
    """
    step, own = float(motion.model.opt.timestep), float(other.opt.timestep)
    times = list[float]()
    elapsed = 0.0
    while elapsed < (length + 1) * step * (1 - SUM_ROUNDING):
        times.append(elapsed)
        elapsed += own
    starts, inputs = _restart_second_model(motion, begins, states, np.array(times), other, places)
    restarted = Motion(other, starts, inputs, _INPUTS, motion.name)
    own_states = replay_motion(restarted, len(times) * own, 1).velocity_states
    # From the last step that is not past a step of the run before the end.
    first = sum(time + own <= (length - 1) * step * (1 + SUM_ROUNDING) for time in times)
    same = dict(map(tuple, places.bodies.tolist()))
    bodies = np.array([same[body] for body in moving.tolist()])
    rows = Observer(other, starts[0], bodies, 1)(own_states[:, first : len(times) + 1])[0]
    # Straight in between, with the window's end in the middle, and its own steps where they fit.
    each_side = max(1, round(step / own))
    instants = np.linspace((length - 1) * step, (length + 1) * step, 2 * each_side + 1)
    own_times = np.array([*times[first:], elapsed])
    before = np.clip(np.searchsorted(own_times, instants, "right") - 1, 0, len(own_times) - 2)
    # Rounded, for sums of steps are: at a step of its own it is that step's, to the bit.
    part = ((instants - own_times[before]) / own).round(9)[:, None, None]
    return (1 - part) * rows[:, before] + part * rows[:, before + 1]


def _restart_second_model(
    motion: Motion,
    begins: np.ndarray,
    states: Floats,
    times: Floats,
    other: mujoco.MjModel,
    places: _SharedIndices,
) -> tuple[Floats, Floats]:
    """Return the second model's states (M, nstate) at windows, and its inputs (M, N, width).

    Its steps begin at (N,) times since the beginning of a window [s].
    """
    data, twin = mujoco.MjData(motion.model), mujoco.MjData(other)
    starts = np.empty((len(begins), mujoco.mj_stateSize(other, INTEGRATION)))
    inputs = np.empty((len(begins), len(times), mujoco.mj_stateSize(other, _INPUTS)))
    ahead = (times / motion.model.opt.timestep * (1 + ROUNDING)).astype(int)
    for start, input_rows, begin, state in zip(starts, inputs, begins, states, strict=True):
        mujoco.mj_setState(motion.model, data, state, INTEGRATION)
        # Copy the state of the first model into the second.
        mujoco.mj_resetData(twin.model, twin)
        for name in ("qpos", "qvel", "act"):
            first, second = getattr(places, name).T
            getattr(twin, name)[second] = getattr(data, name)[first]
        first, second = places.mocap.T
        twin.mocap_pos[second], twin.mocap_quat[second] = (
            data.mocap_pos[first],
            data.mocap_quat[first],
        )
        first, second = places.qvel.T
        twin.qacc_warmstart[second] = data.qacc_warmstart[first]
        _copy_inputs(data, twin, places)
        mujoco.mj_getState(other, twin, start, INTEGRATION)
        # Where nothing is stored of each step, the start's own controls and forces act.
        mujoco.mj_setState(motion.model, data, motion.starts[0], INTEGRATION)
        rows = motion.rows(0, begin + ahead)
        for place, row in enumerate(input_rows):
            if rows is not None:
                mujoco.mj_setState(motion.model, data, rows[place], motion.spec)
            _copy_inputs(data, twin, places)
            mujoco.mj_getState(other, twin, row, _INPUTS)
    return starts, inputs


def _copy_inputs(data: mujoco.MjData, twin: mujoco.MjData, places: _SharedIndices) -> None:
    """Copy the controls and applied forces of the first model to the second."""
    for name, pairs in (
        ("ctrl", places.ctrl),
        ("qfrc_applied", places.qvel),
        ("xfrc_applied", places.bodies),
    ):
        first, second = pairs.T
        getattr(twin, name)[second] = getattr(data, name)[first]
