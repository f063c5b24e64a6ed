"""Windows of a run, rolled out from the run's own states, and the motion of bodies in them."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.budget.defects import measure_paths
from contactlab.budget.motion import INTEGRATION, Motion
from contactlab.contact.trace_arrays import Floats
from contactlab.engines.mujoco_batch import PERSISTENT
from contactlab.engines.older_mujoco import SimulationError
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.scene.mujoco_versions import has_batch

if TYPE_CHECKING or has_batch():
    from mujoco.batch import Batch
else:
    from contactlab.engines.older_mujoco import StepLoop as Batch

KEPT = sum(
    int(getattr(mujoco.mjtState, f"mjSTATE_{name}", 0))
    for name in ("QPOS", "QVEL", "MOCAP_POS", "MOCAP_QUAT", "PLASTIC")
)
"""The parts of a state that its velocities and energies depend on."""
_SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))
_UNUSED = sum(int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{n}")) for n in ("SENSOR", "AUTORESET"))
_OBSERVED = ("cvel", "xipos", "subtree_com", "energy")
_CHUNK = 512  # states that are looked at together


@dataclass(frozen=True)
class EngineWarning:
    """A warning that the engine raised in the run.

    Attributes:
        kind: in MuJoCo's word, such as "badqacc".
        place: the joint, actuator or body that it is about, or "": the first that was bad.
        cause: where forces had parted most from the reference's by then, or "".
        seed: the seed in which it was raised first.
        window: the number of the window in which that was.
        time: when that begins [s since the start].
    """

    kind: str
    place: str
    seed: int
    window: int
    time: float
    cause: str = ""


_simulated_steps = 0.0


def add_simulated_steps(model: mujoco.MjModel, steps: int) -> None:
    """Count steps of a model that this process simulates or waits for; one of RK4 is four."""
    global _simulated_steps  # noqa: PLW0603 - counts as a clock does
    _simulated_steps += float(count_stages(model) * steps)


def count_stages(model: mujoco.MjModel) -> int:
    """Return how often a step evaluates the forces."""
    return 4 if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 else 1


def count_simulated_steps() -> float:
    """Return how many steps were counted since this process began."""
    return _simulated_steps


def without_sensors(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a model that measures nothing as it steps, and never resets itself."""
    alone = copy.copy(model)
    alone.opt.disableflags |= _UNUSED
    return alone


def start_rows(model: mujoco.MjModel, rows: Floats, workers: int) -> Batch:
    """Return a batch whose simulations are at (n, nstate) states of mjSTATE_INTEGRATION."""
    persistent = bool(model.opt.enableflags & PERSISTENT)
    batch = Batch(model, len(rows), workers if has_batch() else 1, persistent=persistent)
    batch.state[:] = rows
    return batch


def _roll_out(
    batch: Batch, size: int, steps: int, inputs: Floats | None, spec: int
) -> tuple[Floats, np.ndarray]:
    """Return (n, steps, size) states after each step, and (n) whether a simulation failed."""
    states = np.full((len(batch.state), steps, size), np.nan)
    return states, _make_steps(batch, steps, inputs, spec, {KEPT: states})


def _make_steps(
    batch: Batch, steps: int, inputs: Floats | None, spec: int, out: dict[Any, Floats]
) -> np.ndarray:
    """Make steps that record such parts of states, and return (n) whether a simulation failed."""
    add_simulated_steps(batch.model, len(batch.state) * steps)
    before = batch.warning[:, :, 1].copy()
    input_options: dict[str, Any] = (
        {} if inputs is None else {"control": inputs, "control_spec": spec}
    )
    failed = np.zeros(len(before), bool)
    try:
        batch.rollout(steps, record=[*out], out=out, **input_options)
    except SimulationError:
        failed = np.array([bool(batch.error(row)) for row in range(len(failed))])
    return failed | (batch.warning[:, :, 1] != before).any(axis=1)


@dataclass(frozen=True)
class Run:
    """The motion with its own settings, and the beginnings of its windows.

    Attributes:
        steps: n, of a window; all windows are equally long.
        begins: (W,) step at which each begins. They are contiguous, except the last, which begins
            earlier if the number of steps is not a multiple of n.
        starts: (S, W, nstate) states of mjSTATE_INTEGRATION there.
        velocity_states: (S, N + 2, kept) the parts of states that velocities depend on, before each
            step, after the last, and after one more.
        valid: (S, W) whether the engine came through a window, and through all before it.
        warnings: of the engine.
    """

    steps: int
    begins: np.ndarray
    starts: Floats
    velocity_states: Floats
    valid: np.ndarray
    warnings: tuple[EngineWarning, ...]


def replay_motion(
    motion: Motion, window: float, workers: int, known_states: Floats | None = None
) -> Run:
    """Repeat a motion, bit for bit, and cut it into windows of about that length [s].

    `known_states` (S, K + 1, nstate) are mjSTATE_INTEGRATION before each of the first K steps, and
    after the last of them. Those steps are not repeated.
    """
    model, steps = without_sensors(motion.model), motion.steps
    length, begins = cut_windows(motion, window)
    count = len(begins)
    known_states = motion.starts[:, None] if known_states is None else known_states
    known_steps = known_states.shape[1] - 1
    batch = start_rows(model, known_states[:, -1], workers)
    size = mujoco.mj_stateSize(model, KEPT)
    states = np.full((motion.seeds, steps + 2, size), np.nan)
    states[:, : known_steps + 1] = select_parts(model, known_states)
    starts = np.full((motion.seeds, count, motion.starts.shape[1]), np.nan)
    starts[:, begins <= known_steps] = known_states[:, begins[begins <= known_steps]]
    valid, failed = np.ones((motion.seeds, count), bool), np.zeros(motion.seeds, bool)
    warnings = list[EngineWarning]()
    for place, (begin, end) in enumerate(zip(begins, [*begins[1:], steps + 1], strict=True)):
        if end <= known_steps:
            continue
        if begin > known_steps:
            starts[:, place] = batch.state
        first = max(begin, known_steps)
        span = np.arange(first, end)
        held_inputs = [motion.rows(seed, span) for seed in range(motion.seeds)]
        inputs = (
            None
            if held_inputs[0] is None
            else np.stack([row for row in held_inputs if row is not None])
        )
        states[:, first + 1 : end + 1], fails = _roll_out(
            batch, size, end - first, inputs, motion.spec
        )
        for seed in np.flatnonzero(fails & ~failed):
            when = place, float(begin * model.opt.timestep)
            kinds = [
                EngineWarning(kind, _name_subject(model, kind, int(subject)), int(seed), *when)
                for kind, (subject, number) in zip(_KINDS, batch.warning[seed], strict=True)
                if number
            ]
            warnings += kinds or [EngineWarning(batch.error(int(seed)), "", int(seed), *when)]
        failed |= fails
        # A window that the run began before the failure may end after it.
        valid[failed, np.searchsorted(begins, begin - length, side="right") :] = False
    return Run(length, begins, starts, states, valid, tuple(warnings))


def cut_windows(motion: Motion, window: float) -> tuple[int, NDArray[np.intp]]:
    """Return the steps of windows of about that length [s], and the first step of each."""
    steps = motion.steps
    length = min(steps, max(1, round(window / motion.model.opt.timestep)))
    return length, np.minimum(np.arange(-(-steps // length)) * length, steps - length)


def select_parts(model: mujoco.MjModel, rows: Floats) -> Floats:
    """Return (..., kept) the parts of (..., nstate) states that velocities depend on."""
    return np.concatenate([rows[..., place] for place in _find_places(model)], axis=-1)


def _find_places(model: mujoco.MjModel, spec: int = KEPT) -> list[slice]:
    """Return where the parts of a state lie that the bits of a spec name."""
    places = list[slice]()
    bit = 1
    while bit <= spec:
        if bit & spec:
            begin = mujoco.mj_stateSize(model, (bit - 1) & INTEGRATION)
            places.append(slice(begin, begin + mujoco.mj_stateSize(model, bit)))
        bit <<= 1
    return places


def _write_rows(states: Floats, rows: Floats, places: Sequence[slice]) -> None:
    """Write (..., width) rows into the parts of (..., nstate) states that they are of."""
    begin = 0
    for place in places:
        end = begin + place.stop - place.start
        states[..., place] = rows[..., begin:end]
        begin = end


_KINDS = [
    name.removeprefix("mjWARN_").lower()
    for name in mujoco.mjtWarning.__members__
    if name != "mjNWARNING"
]


def _name_subject(model: mujoco.MjModel, kind: str, place: int) -> str:
    """Return the subject of a warning: MuJoCo gives a degree of freedom, or an actuator."""
    if kind == "badctrl" and 0 <= place < model.nu:
        return f"actuator {model.actuator(place).name or place}"
    if kind == "badqpos" and 0 <= place < model.nq:
        return joint_name(model, int(np.searchsorted(model.jnt_qposadr, place, "right")) - 1)
    if kind in ("badqvel", "badqacc", "inertia") and 0 <= place < model.nv:
        return joint_name(model, int(model.dof_jntid[place]))
    return ""


def joint_name(model: mujoco.MjModel, joint: int) -> str:
    """Return how a joint is spoken of: by its body, if it is free or has no name."""
    name = model.joint(joint).name
    if name and model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
        return f"joint {name}"
    return f"body {body_name(model, int(model.jnt_bodyid[joint]))}"


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Return a body's name, or its number."""
    return model.body(body).name or f"body[{body}]"


class Windows:
    """M windows of a run's seeds, which any model of the same layout can be rolled out through."""

    def __init__(self, motion: Motion, run: Run, workers: int, which: np.ndarray) -> None:
        """Take (M, 2) windows, each a seed and the number of one of its windows."""
        self.steps, self._spec, self._workers = run.steps, motion.spec, workers
        seed, window = which.T
        self.starts = run.starts[seed, window]
        self._given, self._places = (
            _find_places(motion.model, motion.spec),
            _find_places(motion.model),
        )
        self.own = np.stack(
            [
                run.velocity_states[s, b : b + run.steps + 2]
                for s, b in zip(seed, run.begins[window], strict=True)
            ]
        )
        spans = run.begins[window][:, None] + np.arange(run.steps + 1)
        rows = [motion.rows(s, span) for s, span in zip(seed, spans, strict=True)]
        self._inputs = (
            None if rows[0] is None else np.stack([row for row in rows if row is not None])
        )

    def roll_out(
        self, model: mujoco.MjModel, rate: int, *, whole: bool = False
    ) -> tuple[Floats, np.ndarray]:
        """Roll a model out, `rate` steps to one of the run, inputs held at the run's rate.

        Returns:
            (M, K, kept) states from one step of the run before the end of the window to one after,
            K = 2 rate + 1; if whole, from its start, K = (n + 1) rate + 1.
            (M) whether the engine warned or raised an error.
        """
        first = 0 if whole else self.steps - 1
        batch = start_rows(model, self.starts, self._workers)
        failed = np.zeros(len(self.starts), bool)
        if first:
            held_inputs = self._hold_inputs(0, first, rate)
            failed = _make_steps(batch, first * rate, held_inputs, self._spec, {})
        begin = select_parts(model, batch.state)
        held_inputs = self._hold_inputs(first, self.steps + 1, rate)
        steps = (self.steps + 1 - first) * rate
        states, fails = _roll_out(batch, begin.shape[1], steps, held_inputs, self._spec)
        return np.concatenate([begin[:, None], states], axis=1), failed | fails

    def restore_states(self, kept_parts: Floats) -> Floats:
        """Return (M, K, nstate) states of mjSTATE_INTEGRATION, from (M, K, kept) parts of them.

        The rest is as at the begin of each window, except inputs, which are those of its last step.
        """
        states = self.starts[:, None].repeat(kept_parts.shape[1], axis=1)
        if self._inputs is not None:
            _write_rows(states, self._inputs[:, self.steps - 1, None], self._given)
        _write_rows(states, kept_parts, self._places)
        return states

    def _hold_inputs(self, first: int, last: int, rate: int) -> Floats | None:
        return None if self._inputs is None else self._inputs[:, first:last].repeat(rate, axis=1)


def split_windows(model: mujoco.MjModel, which: np.ndarray, steps: int) -> list[np.ndarray]:
    """Cut (M, 2) windows into blocks whose recorded states need little memory."""
    most_numbers, persistent_windows = 1 << 23, 64  # of a block
    most = max(1, most_numbers // (steps * max(1, mujoco.mj_stateSize(model, KEPT))))
    if model.opt.enableflags & PERSISTENT & ~_SLEEP:
        most = min(most, persistent_windows)
    return [which[begin : begin + most] for begin in range(0, len(which), most)]


class Observer:
    """Computes velocities of bodies and energies from states, natively.

    It evaluates positions and velocities of a copy of the model without forces and contacts: the
    states may come from any integrator, whose own fields describe the stages of a step.
    """

    def __init__(
        self, model: mujoco.MjModel, start: Floats, bodies: np.ndarray, workers: int
    ) -> None:
        """Look at B bodies; `start` (nstate,) is a state whose other parts are as good as any."""
        idle = without_sensors(model)
        for name in ("CONTACT", "CONSTRAINT", "ACTUATION"):
            idle.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}"))
        idle.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
        idle.opt.enableflags &= ~PERSISTENT
        idle.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        self._places, self._bodies = _find_places(model), bodies
        self._roots, self._radius = model.body_rootid[bodies], gyration_radii(model)[bodies]
        self._batch = start_rows(idle, np.tile(start, (_CHUNK, 1)), workers)

    def __call__(self, states: Floats) -> tuple[Floats, Floats]:
        """Look at states (..., kept).

        Returns:
            (..., B, 6) velocity of the center of mass, and spin times radius of gyration [m/s], in
            the world's frame.
            (..., 2) potential and kinetic energy [J].
        """
        rows = states.reshape(-1, states.shape[-1])
        velocities, energies = np.empty((len(rows), len(self._bodies), 6)), np.empty((len(rows), 2))
        for begin in range(0, len(rows), _CHUNK):
            some = slice(begin, begin + _CHUNK)
            self._observe_states(rows[some], velocities[some], energies[some])
        return velocities.reshape(*states.shape[:-1], -1, 6), energies.reshape(
            *states.shape[:-1], 2
        )

    def _observe_states(self, rows: Floats, velocities: Floats, energies: Floats) -> None:
        count = len(rows)
        _write_rows(self._batch.state[:count], rows, self._places)
        self._batch.bind("time")[:] = 0
        sensor_rows = self._batch.rollout(1, record=list(_OBSERVED), ids=list(range(count)))
        twist = sensor_rows["cvel"][:, 0, self._bodies]
        spin, middles = twist[..., :3], sensor_rows["xipos"][:, 0, self._bodies]
        with np.errstate(invalid="ignore", over="ignore"):  # a diverged run has infinite states
            arm = middles - sensor_rows["subtree_com"][:, 0, self._roots]
            velocities[..., :3] = twist[..., 3:] + np.cross(spin, arm)
            velocities[..., 3:] = spin * self._radius[:, None]
        energies[:] = sensor_rows["energy"][:, 0]


def gyration_radii(model: mujoco.MjModel) -> Floats:
    """Return (nbody,) the largest radius of gyration of each body [m], 0 without mass."""
    mass = model.body_mass
    share = model.body_inertia.max(axis=1) / np.where(mass > 0, mass, 1)
    return np.sqrt(np.where(mass > 0, np.maximum(share, 0), 0))


def judged_bodies(model: mujoco.MjModel) -> np.ndarray:
    """Return (B,) bodies that can move and have mass: more than rounding of the model's."""
    heavy = model.body_mass > SUM_ROUNDING * model.body_mass[1:].max(initial=0)
    return np.flatnonzero((model.body_weldid > 0) & heavy)


def usual_changes(motions: Sequence[Motion]) -> Floats:
    """Return (nbody,) how fast velocities of bodies change in all of a run's phases [m/s^2].

    On the mean over time and seeds, as far as the engine comes.
    """
    model = motions[0].model
    bodies = judged_bodies(model)
    observer = Observer(model, motions[0].starts[0], bodies, 1)
    runs = [replay_motion(motion, motion.steps * model.opt.timestep, 1) for motion in motions]
    changes = np.zeros(model.nbody)
    changes[bodies] = changes_of(runs, observer) / float(model.opt.timestep)
    return changes


def changes_of(runs: Sequence[Run], observer: Observer) -> Floats:
    """Return (B,) by how much velocities change in a step [m/s], on the mean, until all end."""
    whole = [
        states[np.isfinite(states).all(axis=1)]
        for run in runs
        for states in run.velocity_states[:, :-1]
    ]
    lengths = [measure_paths(observer(states)[0][None])[0] for states in whole]
    return np.sum(lengths, axis=0) / max(1, sum(len(states) - 1 for states in whole))
