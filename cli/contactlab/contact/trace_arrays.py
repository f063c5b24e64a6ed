"""Arrays of a group of runs that share structure and step count; NumPy only.

Time alignment: state row k is the state before step k, and sensor row k holds the forces that act
during step k. So with N steps there are N + 1 state rows and N sensor rows, and
``qvel[:, k + 1] - qvel[:, k]`` is the work of the forces in row k.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]
Kind = TypeVar("Kind", bound=np.generic)

# The numbers of a contact slot: fields of MuJoCo's contact sensor in its order, with their sizes.
_SLOT_FIELDS = {
    "found": 1,
    "force": 3,
    "torque": 3,
    "distance": 1,
    "position": 3,
    "normal": 3,
    "tangent": 3,
    "linear_velocity": 3,
    "angular_velocity": 3,
}
SLOT_WIDTH = sum(_SLOT_FIELDS.values())


def _slot_columns(field: str) -> slice:
    names = list(_SLOT_FIELDS)
    start = sum(_SLOT_FIELDS[name] for name in names[: names.index(field)])
    return slice(start, start + _SLOT_FIELDS[field])


FOUND: int = _slot_columns("found").start
DISTANCE: int = _slot_columns("distance").start
FORCE, TORQUE = _slot_columns("force"), _slot_columns("torque")
POSITION, NORMAL, TANGENT = map(_slot_columns, ("position", "normal", "tangent"))
LINEAR_VELOCITY = _slot_columns("linear_velocity")
ANGULAR_VELOCITY = _slot_columns("angular_velocity")
POINT_FIELDS = {
    "position": POSITION,
    "normal": NORMAL,
    "tangent": TANGENT,
    "distance": DISTANCE,
    "force": FORCE,
    "torque": TORQUE,
    "linear_velocity": LINEAR_VELOCITY,
    "angular_velocity": ANGULAR_VELOCITY,
}
"""The parts of a slot that describe its contact point, by name."""

ACTUATORS, CONSTRAINTS, OTHERS = 0, 1, 2  # the last axis of `Trace.work`


def hash_of_states(rows: Floats) -> str:
    """Return the trajectory hash of a run: 32 hex digits of the SHA-256 of its state rows' bytes.

    Rows (N + 1, 1 + nq + nv + na) are time, qpos, qvel and act of each state.
    """
    return hashlib.sha256(np.ascontiguousarray(rows).data).hexdigest()[:32]


def read_only(array: NDArray[Kind]) -> NDArray[Kind]:
    """Return a view of an array that cannot be written."""
    view = array.view()
    view.setflags(write=False)
    return view


def squared_lengths(vectors: Floats) -> Floats:
    """Return (...) squared lengths of vectors (..., k); sums along short axes are far slower."""
    first, *others = (vectors[..., k] for k in range(vectors.shape[-1]))
    square = first * first
    for other in others:
        square += other * other
    return square


def fast_median(values: Floats) -> Floats:
    """Return (...) medians of values (..., T) like `np.median`, in a third of its time."""
    count = values.shape[-1]
    if not count:
        return np.full(values.shape[:-1], np.nan)
    middle = slice((count - 1) // 2, count // 2 + 1)
    ranked = np.partition(values, sorted({middle.start, middle.stop - 1, count - 1}), axis=-1)
    # NaN comes last.
    return np.where(np.isnan(ranked[..., -1]), np.nan, ranked[..., middle].mean(axis=-1))


def sum_of_slots(values: Floats, axis: int) -> Floats:
    """Return sums along slots, one after the other, so that empty ones do not change any bit."""
    return values.cumsum(axis=axis).take(-1, axis=axis)


@dataclass(frozen=True)
class PairTrace:
    """Contacts of one monitored pair, for n runs of N steps with S contact slots."""

    name: str
    slots: Floats
    """(n, N, S, 23) contact slots in the layout of MuJoCo's contact sensor: slots with a contact
    come first, the others are zero. Force and velocity are in the contact frame, normal first; the
    normal points from the pair's first side to its second and is in the world frame, like the
    position.
    """
    friction: Floats  # (n, 5) effective coefficients (slide, slide, torsion, roll, roll)

    @cached_property
    def found(self) -> Integers:
        """(n, N) contacts of this pair that matched, which may exceed the slots."""
        return self.slots[:, :, 0, FOUND].astype(np.int32, order="C")

    @cached_property
    def touched(self) -> NDArray[np.bool_]:
        """(n,) whether the pair had a contact at any time."""
        return np.asarray(self.found.any(axis=1))

    @property
    def touching(self) -> NDArray[np.bool_]:
        """(n, N, S) whether a slot contains a contact."""
        return self.slots[..., FOUND] > 0


class Passage(NamedTuple):
    """A passage of one geom through another, completed after a step."""

    mover: str
    wall: str
    step: int
    bodies: tuple[str, ...] = ()  # the movable ones of both bodies


@dataclass(frozen=True)
class HeldPose:
    """Pose of a scene's subject relative to the body that holds it, for n runs of N steps."""

    position: Floats  # (n, N, 3) origin of the subject's frame [m], in the holder's frame
    rotation: Floats
    """(n, N, 4) rotation of the holder's frame in the world, unit quaternion w x y z."""


_STATE_ARRAYS = ("time", "qpos", "qvel")
_ENERGY_ARRAYS = ("kinetic", "potential", "momentum", "angular_momentum")
_COUNT_ARRAYS = ("contacts", "least_distance", "iterations", "iterations_most")
_STEP_ARRAYS = (*_ENERGY_ARRAYS, *_COUNT_ARRAYS, "forces", "lengths", "work")
_RUN_ARRAYS = (
    "control_ranges",
    "equality_loads",
    "equality_gaps",
    "creep",
    "constraint_gain",
    "sleeper",
)


@dataclass(frozen=True, kw_only=True)
class EngineOutputs:
    """Outputs of an engine for n runs of N steps, besides their states; None if unknown."""

    control_ranges: Floats | None = None  # (n, nu, 2) least and greatest control of each actuator
    equality_loads: Floats | None = None
    """(n, neq) largest force of each equality at sampled steps [N or N m]."""
    equality_gaps: Floats | None = None
    """(n, neq, 2) violation of each equality at sampled steps [m or rad]: the largest beyond that
    at the start, and the median in the last quarter."""
    creep: Floats | None = None
    """(n, 2, nv + ntendon) steady speed of degrees of freedom and tendons that friction loss brakes
    with less than it could, under constant controls [m/s or rad/s], and the step with it."""
    work: Floats | None = None
    """(n, N, 3) work in each step [J] of actuators, of constraints, and of all other forces except
    gravity and springs; NaN if unknown."""
    constraint_gain: Floats | None = None
    """(n, 4) the stretch of steps when constraints gave most energy: the first, the last, their
    stored energy before it [J], and that of all except contacts at the start [J]."""
    sleeper: Floats | None = None
    """(n, 4) the sleeping body that would have moved farthest if it had been awake: the distance
    [m], the same as a share of its path, its joint, and its first step asleep; NaN if nothing
    sleeps."""
    passages: tuple[tuple[Passage, ...], ...] = ()
    """For each run, the passages of geoms through others; empty if they were not searched."""


@dataclass(frozen=True)
class Trace(EngineOutputs):
    """Trace of n runs over N steps."""

    timestep: Floats  # (n,) step length [s]
    steps_asked: int  # steps requested; N is smaller if the engine stopped a run
    time: Floats  # (n, N + 1) simulated time [s]
    qpos: Floats  # (n, N + 1, nq) configuration
    qvel: Floats  # (n, N + 1, nv) velocity
    kinetic: Floats  # (n, N) kinetic energy [J]; NaN, like the next, if it was not recorded
    potential: Floats  # (n, N) potential energy [J] of gravity and springs
    contacts: Integers  # (n, N) contacts in the whole model, monitored or not
    least_distance: Floats  # (n, N) smallest signed distance of any contact [m]; 0 without contact
    iterations: Integers  # (n, N) solver iterations, summed over contact islands
    iterations_most: Integers  # (n, N) solver iterations of the busiest island
    momentum: Floats | None
    """(n, N, 3) linear momentum [kg m/s], or None if the system is not free."""
    angular_momentum: Floats | None
    """(n, N, 3) about the center of mass [kg m^2/s], or None likewise."""
    pairs: tuple[PairTrace, ...]  # the monitored contact pairs
    warnings: tuple[dict[str, int], ...]  # for each run, engine warnings by name with their counts
    held_pose: HeldPose | None = None
    """Pose of the subject relative to its holder, or None if nothing should be held."""
    forces: Floats | None = None
    """(n, N, nu) force of each actuator, or None if not recorded, like the next."""
    lengths: Floats | None = None  # (n, N, ntendon) length of each tendon

    @property
    def runs(self) -> int:
        """Number of runs n."""
        return len(self.timestep)

    @property
    def steps(self) -> int:
        """Number of recorded steps N."""
        return self.contacts.shape[1]

    @property
    def has_energy(self) -> bool:
        """Whether energies were recorded."""
        return not np.isnan(self.kinetic[:, :1]).all()

    def forbid_writes(self) -> "Trace":
        """Return it with arrays that no metric can write."""
        arrays = {
            name: read_only(value)
            for name, value in vars(self).items()
            if isinstance(value, np.ndarray)
        }
        # Pairs that never touch keep sharing one array.
        slots = {id(pair.slots): read_only(pair.slots) for pair in self.pairs}
        pairs = tuple(
            PairTrace(pair.name, slots[id(pair.slots)], read_only(pair.friction))
            for pair in self.pairs
        )
        held_pose = self.held_pose and HeldPose(*map(read_only, vars(self.held_pose).values()))
        return replace(self, pairs=pairs, held_pose=held_pose, **arrays)

    def select(self, runs: Sequence[int], steps: int | None = None) -> "Trace":
        """Return the given runs, cut to their first `steps` steps; views where NumPy allows."""
        if [*runs] == [*range(self.runs)] and steps in {None, self.steps}:
            return self
        contiguous = range(runs[0], runs[-1] + 1)
        index = slice(runs[0], runs[-1] + 1) if list(runs) == list(contiguous) else list(runs)
        steps = self.steps if steps is None else steps
        ends: dict[str, int | None] = dict.fromkeys(_RUN_ARRAYS)
        ends |= dict.fromkeys(_STATE_ARRAYS, steps + 1) | dict.fromkeys(_STEP_ARRAYS, steps)
        arrays = {name: getattr(self, name) for name in ends}
        held_pose = self.held_pose
        return replace(
            self,
            timestep=self.timestep[index],
            pairs=tuple(
                replace(pair, slots=pair.slots[index, :steps], friction=pair.friction[index])
                for pair in self.pairs
            ),
            warnings=tuple(self.warnings[run] for run in runs),
            passages=tuple(self.passages[run] for run in runs if self.passages),
            held_pose=held_pose
            and HeldPose(held_pose.position[index, :steps], held_pose.rotation[index, :steps]),
            **{
                name: None if array is None else array[index, : ends[name]]
                for name, array in arrays.items()
            },
        )


NO_CONTACT = 0
STICK = 1
SLIDE = 2


@dataclass(frozen=True)
class PairSeries:
    """Net quantities of one monitored pair, for n runs of N steps."""

    name: str
    contacts: NDArray[np.int32]  # (n, N) contacts recorded, at most the slots
    normal: Floats  # (n, N) net normal force [N]
    tangential: Floats  # (n, N) magnitude of the net tangential force [N]
    usage: Floats
    """(n, N) share of the friction bound in use, in the cone's own norm; 1 means sliding."""
    slip: Floats  # (n, N) magnitude of the force-weighted tangential velocity [m/s]
    distance: Floats  # (n, N) least signed distance [m]; 0 without contact
    mode: NDArray[np.int8]  # (n, N) NO_CONTACT, STICK or SLIDE, with hysteresis (see `measure`)


BY_RUN = ("residual", "jacobian_steps", "jacobian", "overlap", "apart", "squeeze", "repeats")


class ChoiceEffect(NamedTuple):
    """How much the motion of a run changes with another modeling choice."""

    name: str  # of the row of an error budget, such as "cone"
    error: float  # its effect, as a share of the real forces
    body: str  # the body with the largest change of its motion
    time: float  # start of the window with its largest effect [s]


class BackwardError(NamedTuple):
    """The numerical error of a run, as an error budget defines it."""

    share: float  # residual forces over real ones, on the worst body; infinite if the engine warned
    body: str  # the worst body
    time: float  # start of the window with its largest error [s]
    energy: float  # the share of energy that the run gains, or loses, and its model does not
    energy_body: str  # the body with the largest error of kinetic energy
    energy_time: float  # start of the window with that error [s]
    effects: tuple[ChoiceEffect, ...] | None = None  # of modeling choices; None if not measured
    errors: tuple[tuple[str, float], ...] = ()  # each body and its own share


@dataclass(frozen=True)
class SelfChecks:
    """Self-checks of n runs of N steps; checks that do not apply to a run are NaN."""

    residual: Floats
    """(n, N) disagreement of forces and accelerations, over the largest constraint force of the run
    [1]; 0 to rounding for a solver that converged."""
    jacobian_steps: NDArray[np.intp]  # (n, K) steps with the largest residuals
    jacobian: Floats
    """(n, K) share of the constraint forces of these steps that is wrong because of the form of the
    constraint Jacobian, dense or sparse, that the run uses [1]."""
    overlap: Floats  # (n, L) deepest geometric overlap of a monitored pair without a contact [m]
    apart: Floats
    """(n, L) largest excess of a pair's geometric distance over that of its contact [m]."""
    geometry_steps: NDArray[np.intp]  # (L,) the steps of these states
    squeeze: Floats
    """(n, P) normal force of each pair after only contacts have acted for a while after the end: it
    is due to overlap between walls [N]."""
    repeats: NDArray[np.bool_]  # (n,) whether a second rollout gave every state again, bit for bit
    backward: tuple[BackwardError, ...] = ()  # of each run; empty if none was measured

    @property
    def runs(self) -> int:
        """Number of runs that were checked."""
        return len(self.repeats)

    def first(self, runs: int) -> "SelfChecks":
        """Return the checks of the first of the runs."""
        return self._select_runs(slice(runs))

    def only(self, run: int) -> "SelfChecks":
        """Return the checks of one of the runs."""
        return self._select_runs(slice(run, run + 1))

    def _select_runs(self, runs: slice) -> "SelfChecks":
        arrays = {name: getattr(self, name)[runs] for name in BY_RUN}
        return replace(self, backward=self.backward[runs], **arrays)


class Invariants(NamedTuple):
    """Energy and momenta at T states."""

    energy: Floats  # (T,) mechanical energy [J]
    kinetic: Floats  # (T,) the kinetic part of it [J]
    momentum: Floats | None  # (T, 3) linear momentum [kg m/s], or None if the system is not free
    angular_momentum: Floats | None  # (T, 3) about the center of mass [kg m^2/s], or None likewise
    mass: float  # total mass [kg]
    lift: float  # energy that lifts everything by `arm` [J]
    arm: float  # 1 % of the mean size of a body [m]


@dataclass(frozen=True)
class RecordedControls:
    """The controls of one run, and forces on bodies, each held until the next."""

    times: Floats  # (K,) start times [s], increasing from 0; the last is the run's end
    levels: Floats  # (K, nu) the controls, or (K, P) the controls and forces
    # Their P indices among the inputs of `InitialStates`; empty for all controls and nothing else.
    places: tuple[int, ...] = ()

    @property
    def sha256(self) -> str:
        """Hash of times and levels as float64 bytes; equal controls have the same hash."""
        digest = hashlib.sha256(f"{self.levels.shape}{self.places or ''}".encode())
        for part in (self.times, self.levels):
            digest.update(np.ascontiguousarray(part, np.float64).data)
        return digest.hexdigest()

    @property
    def knots(self) -> tuple[Floats, Floats]:
        """(2 K - 1,) times and (nu, 2 K - 1) levels that are linear in between, with jumps."""
        return np.repeat(self.times, 2)[1:], np.repeat(self.levels, 2, axis=0)[:-1].T
