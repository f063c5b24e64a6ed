"""One run by MuJoCo and by another engine, from its states to its end."""

from collections.abc import Set as AbstractSet
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.ndimage import maximum_filter1d

from contactlab.contact.trace_arrays import Floats
from contactlab.engines import ENGINES
from contactlab.engines.engine import PreparedRuns, Rollout, SimulationEngine
from contactlab.mjcf import MODEL_ENGINE
from contactlab.numerical_tolerance import COARSE_ROUNDING, SUM_ROUNDING
from contactlab.studies.parity.forward import (
    FLOOR_FACTOR,
    LIMITS,
    ForwardStates,
    forward_quantities,
)
from contactlab.studies.parity.panel import roll_out, runs_from_states
from contactlab.studies.parity.parity_report import Divergence, Verdict
from contactlab.studies.parity.rounding import (
    round_starts,
    rounded_at_each_step,
    with_converged_solver,
    without_warmstart,
)

_BUFFERS = ("contactfull", "cnstrfull")


@dataclass(frozen=True)
class Comparison:
    """Runs of one structure by MuJoCo, and by another engine.

    The rollouts are MuJoCo's, MuJoCo's with rounded states, and two of the engine.
    """

    engine: SimulationEngine
    reference: SimulationEngine
    both: tuple[PreparedRuns, PreparedRuns]
    rollouts: tuple[Rollout, Rollout, Rollout, Rollout]

    @classmethod
    def of(cls, engine: SimulationEngine, ours: PreparedRuns, theirs: PreparedRuns) -> "Comparison":
        """Simulate runs by both; `theirs` has the changes for the engine alone."""
        reference = ENGINES[MODEL_ENGINE]
        by_mujoco = (
            roll_out(reference, ours),
            roll_out(reference, without_warmstart(round_starts(ours))),
        )
        twice = roll_out(engine, theirs), roll_out(engine, theirs)
        return cls(engine, reference, (ours, theirs), (*by_mujoco, *twice))

    def count_contacts(self, run: int) -> np.ndarray:
        """Return (N,) the number of contacts of MuJoCo in each step of a run."""
        return contact_counts(self.both[0], self.rollouts[0])[run]


def contact_counts(runs: PreparedRuns, rollout: Rollout) -> np.ndarray:
    """Return (n, N) the number of contacts in each step of each run."""
    layout = runs.base.layout if rollout.slots is None else runs.base.layout.from_contacts()
    return rollout.sensors[:, :, layout.contacts]


@dataclass(frozen=True)
class SteppedStates:
    """One step from K states of MuJoCo's run: velocities by both, and from rounded states."""

    places: np.ndarray  # (K,) steps
    error: Floats  # (K,) largest difference of a velocity
    floors: Floats  # (K, nv) difference of each velocity from rounded states
    plain: Floats  # (K,) tolerance without noise floors
    allowed_errors: Floats  # (K,)
    worst: np.ndarray  # (K,) index of the velocity that differs most
    velocities: tuple[Floats, Floats]  # (K, nv) by MuJoCo, by the engine

    @property
    def floor(self) -> Floats:
        """(K,) the largest difference of a velocity from rounded states."""
        return self.floors.max(axis=1, initial=0)

    def sensitive_before(self, step: int, dofs: np.ndarray) -> bool:
        """Return whether rounding a state before some step changes some velocities."""
        moved = self.floors[:, dofs].max(axis=1, initial=0) > self.plain
        return bool(moved[self.places < step].any())


def single_step_places(steps: int) -> np.ndarray:
    """Return the single steps (K,) of a run: all, or 1,000 of them."""
    most_steps = 1_000
    return np.unique(np.linspace(0, steps - 1, min(steps, most_steps)).round().astype(int))


def step_once(comparison: Comparison, run: int, states: Floats) -> SteppedStates:
    """Make one step from each of the states (N + 1, nstate) of a run, or from 1,000 of them."""
    engine, reference, (ours, theirs) = comparison.engine, comparison.reference, comparison.both
    last = len(states) - 1
    places = single_step_places(last)
    starts = runs_from_states(ours, run, states[places], places)
    model = ours.models[run]
    speeds = slice(1 + model.nq, 1 + model.nq + model.nv)
    sides = (
        (reference, starts),
        (reference, round_starts(starts)),
        (engine, runs_from_states(theirs, run, states[places], places)),
        (reference, with_converged_solver(starts)),
    )
    by_mujoco, by_rounded, by_engine, by_converged = (
        roll_out(by, runs).state[:, 1, speeds] for by, runs in sides
    )
    before, after = states[places][:, speeds], states[places + 1][:, speeds]
    change = np.abs(by_mujoco - before).max(axis=1, initial=0)
    error, floors = np.abs(by_mujoco - by_engine), np.abs(by_mujoco - by_rounded)
    # In the run the solver was warm-started, so it ended elsewhere within its tolerance.
    ends = np.maximum(np.abs(by_mujoco - after), np.abs(by_mujoco - by_converged))
    noise = np.maximum(floors, ends).max(axis=1, initial=0)
    step = model.opt.timestep  # tolerance of an acceleration, over a step
    plain = step * LIMITS["qacc"].allow_change(change / step)
    neighbors = 33  # neighboring states with similar convergence of the solver
    allowed = plain + FLOOR_FACTOR * maximum_filter1d(noise, neighbors)
    error = np.where(np.isfinite(error), error, np.inf)
    worst, velocities = error.argmax(axis=1), (by_mujoco, by_engine)
    return SteppedStates(places, error.max(axis=1), floors, plain, allowed, worst, velocities)


def select_states(steps: SteppedStates, contacts: np.ndarray) -> np.ndarray:
    """Return the steps (K,) with compared states, from (N,) contacts before each step.

    These are the steps with the largest differences, the start, the first with contacts, that with
    most contacts, and some along the run.
    """
    most_states = 24
    excess = steps.error / steps.allowed_errors
    worst = steps.places[np.argsort(-excess, kind="stable")[: most_states // 3]]
    touching = np.flatnonzero(contacts)[:1]
    along = np.linspace(0, len(contacts) - 1, most_states // 2).astype(int)
    return np.unique(np.concatenate([worst, touching, [int(contacts.argmax())], along]))


def compute_states(
    comparison: Comparison, run: int, states: Floats, places: np.ndarray
) -> ForwardStates:
    """Return the quantities that both engines compute for states of a run."""
    engine, reference = comparison.engine, comparison.reference
    ours, theirs = (runs_from_states(side, run, states[places], places) for side in comparison.both)
    sides = ((reference, ours), (engine, theirs), (reference, round_starts(ours)))
    quantities_of_sides = [forward_quantities(by, runs) or {} for by, runs in sides]
    return ForwardStates(ours.models[0], places.tolist(), *quantities_of_sides)


@dataclass(frozen=True)
class WholeRun:
    """A run by MuJoCo, by MuJoCo with rounded states, and twice by the engine: (N + 1, nq) each."""

    ours: Floats
    single: Floats  # every state is rounded
    rounded: Floats  # rounded start, without warm starts
    theirs: Floats
    again: Floats

    def measure_differences(self) -> tuple[Floats, Floats, Floats]:
        """Return (N + 1,) differences of the engine, of rounded states, and of the repetition."""
        error = max_difference(self.ours, self.theirs)
        floor = np.maximum(
            max_difference(self.ours, self.rounded), max_difference(self.ours, self.single)
        )
        return error, floor, max_difference(self.theirs, self.again)

    def find_divergence(self) -> Divergence | None:
        """Return the first difference from MuJoCo that the noise floors do not explain."""
        error, floor, repeat = self.measure_differences()
        floors = np.maximum.accumulate(np.maximum(floor, repeat))
        run_factor = 10.0  # allowed multiple of the largest noise floor so far
        beyond = np.flatnonzero(~(error <= COARSE_ROUNDING + run_factor * floors))
        if not len(beyond):
            return None
        step = int(beyond[0])
        place = int(np.abs(self.ours[step] - self.theirs[step]).argmax())
        return Divergence(
            stage="whole run",
            quantity=f"qpos[{place}]",
            step=step,
            mujoco=float(self.ours[step, place]),
            engine=float(self.theirs[step, place]),
        )


def max_difference(first: Floats, second: Floats) -> Floats:
    """Return (K,) the largest difference in each of K rows."""
    return np.abs(first - second).max(axis=1, initial=0)


def buffers_divergence(rollout: Rollout, run: int) -> Divergence | None:
    """Return the divergence of a run with too little memory for contacts or constraints."""
    full = next((buffer for buffer in _BUFFERS if buffer in rollout.warnings[run]), None)
    return Divergence(stage="buffers", quantity=full, step=0) if full else None


def step_divergence(steps: SteppedStates, ambiguous: AbstractSet[int]) -> Divergence | None:
    """Return the single step that differs most, of those above the tolerance.

    Steps from ambiguous states are ignored.
    """
    excess = np.where(np.isin(steps.places, list(ambiguous)), 0, steps.error / steps.allowed_errors)
    place = int(excess.argmax())
    if not excess[place] > 1:
        return None
    index = int(steps.worst[place])
    ours, theirs = (float(velocity[place, index]) for velocity in steps.velocities)
    return Divergence(
        stage="one step",
        quantity=f"qvel[{index}]",
        step=int(steps.places[place]),
        mujoco=ours,
        engine=theirs,
    )


def _dofs_beside(model: mujoco.MjModel, divergence: Divergence) -> np.ndarray:
    """Return the degrees of freedom of a coordinate's kinematic tree."""
    place = int(divergence.quantity.removeprefix("qpos[").removesuffix("]"))
    joint = int(np.searchsorted(model.jnt_qposadr, place, side="right")) - 1
    return np.flatnonzero(model.dof_treeid == model.dof_treeid[model.jnt_dofadr[joint]])


def judge_run(
    comparison: Comparison, run: int
) -> tuple[Verdict, Divergence | None, dict[str, float | int]]:
    """Return the verdict on a run, the first stage that differs, and the measures."""
    rollouts = comparison.rollouts
    steps = min(rollout.steps[run] for rollout in rollouts)
    if not steps:
        return "ambiguous", None, {}  # no step was completed
    states = rollouts[0].state[run, : steps + 1]
    model = comparison.both[0].models[run]
    ours, *others = (
        rollout.state[run, : steps + 1, 1 : 1 + model.nq] for rollout in comparison.rollouts
    )
    whole = WholeRun(ours, rounded_at_each_step(comparison.both[0], run, steps), *others)
    error, floor, repeat = (float(difference.max()) for difference in whole.measure_differences())
    numbers: dict[str, float | int] = {
        "position": error,
        "noise_floor": floor,
        "repeat_difference": repeat,
    }
    if full := buffers_divergence(rollouts[2], run):
        return "different", full, numbers
    singles = step_once(comparison, run, states)
    numbers |= {"step": float(singles.error.max()), "step_noise_floor": float(singles.floor.max())}
    places = select_states(singles, comparison.count_contacts(run)[:steps])
    looked = compute_states(comparison, run, states, places)
    ambiguous = looked.ambiguous_steps()
    numbers["ambiguous_states"] = len(ambiguous)
    divergence = looked.first_divergence() or step_divergence(singles, ambiguous)
    if divergence:
        return "different", divergence, numbers
    whole_divergence = whole.find_divergence()
    if (singles.error > singles.allowed_errors).any() or (
        whole_divergence
        and singles.sensitive_before(whole_divergence.step, _dofs_beside(model, whole_divergence))
    ):
        return "ambiguous", None, numbers
    if whole_divergence:
        return "different", whole_divergence, numbers
    return ("same" if error <= SUM_ROUNDING else "within noise floor"), None, numbers
