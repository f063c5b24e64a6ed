"""Evaluates a motion's states: places of bodies, contacts, gaps and energies."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget.motion import Motion
from contactlab.budget.windows import KEPT, Run, body_name, replay_motion
from contactlab.contact.trace_arrays import Floats
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.scene.model_names import name_of

SAMPLES = 40
"""Number of sample times of bodies. A sine of 1 Hz over 2 s has 20 of them in each period."""
CONTACT_STATES = 1500
"""States of a run, over all seeds, with evaluated contacts. The peak of an impact lasts about
as long as solref's time constant of 20 ms; 500 states in each of 3 seeds of 2 s are 4 ms apart."""
_EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
_CONNECT = int(mujoco.mjtEq.mjEQ_CONNECT)
_WELD = int(mujoco.mjtEq.mjEQ_WELD)
_JOINT = int(mujoco.mjtEq.mjEQ_JOINT)
_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)
_LIMIT = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
_INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)


@dataclass(frozen=True)
class Extreme:
    """The largest value of a quantity in each seed.

    Attributes:
        values: (S,) largest value; 0 if the quantity never occurs.
        place: body, contact, joint or equality with the largest value over all seeds.
    """

    values: Floats
    place: str


EXTREME_UNITS = {
    "depth": "m",
    "equality gap": "m",
    "equality angle": "rad",
    "slide beyond its limit": "m",
    "hinge beyond its limit": "rad",
}
"""The extremes that a table has, with their units."""
LIMIT_EXCESSES = {"slide beyond its limit", "hinge beyond its limit"}
"""Extremes that depend on how a body moves, not on whether its start is possible."""


class _Samples(NamedTuple):
    positions: Floats
    lengths: Floats
    energies: Floats
    impacts: np.ndarray


class StateTable:
    """The states of one motion, which is run and evaluated when they are first needed."""

    def __init__(
        self,
        motion: Motion,
        workers: int,
        times: Floats,
        *,
        extremes_too: bool = True,
        contact_states: int = CONTACT_STATES,
        demands: mujoco.MjModel | None = None,
    ) -> None:
        """Run nothing yet.

        Args:
            motion: S seeds of N steps.
            workers: threads that simulate.
            times: (K,) sample times of bodies and actuators [s], the last at most its length.
            extremes_too: False to leave depths and gaps at 0.
            contact_states: states with evaluated contacts, over all seeds.
            demands: a model of the same layout. Its joint limits and active equalities count, so
                that a change that removes them does not look better; those of the motion by
                default.
        """
        self.times = times
        self._motion, self._workers, self._extremes_too = motion, workers, extremes_too
        self._contact_states = contact_states
        self._demands = motion.model if demands is None else demands

    @cached_property
    def _run(self) -> Run:
        length = self._motion.steps * float(self._motion.model.opt.timestep)
        return replay_motion(self._motion, length, self._workers)

    @property
    def _states(self) -> Floats:
        # (S, N + 1, kept), from the start to the end.
        return self._run.velocity_states[:, : self._motion.steps + 1]

    @property
    def bits(self) -> bytes:
        """The bits of all states, to distinguish equal motions from similar ones."""
        return self._states.tobytes()

    @cached_property
    def failures(self) -> np.ndarray:
        """(S,) whether the engine gave up or warned."""
        finite = np.isfinite(self._states).reshape(self._motion.seeds, -1).all(axis=1)
        return np.logical_not(np.logical_and(self._run.valid.all(axis=1), finite))

    @property
    def positions(self) -> Floats:
        """(S, K, nbody, 3) centers of mass [m], interpolated to the sample times."""
        return self._samples.positions

    @property
    def lengths(self) -> Floats:
        """(S, K, nu) lengths of actuators [rad or m]."""
        return self._samples.lengths

    @property
    def energies(self) -> Floats:
        """(S, K) potential and kinetic energy [J]."""
        return self._samples.energies

    @property
    def impacts(self) -> np.ndarray:
        """(S, K) whether a contact or a stop has occurred that the start does not have."""
        return self._samples.impacts

    @property
    def extremes(self) -> dict[str, Extreme]:
        """Largest depth [m], gaps [m, rad] and excess over limits [m, rad], by name."""
        return self._contacts[0]

    @property
    def resting_depth(self) -> Floats:
        """(S,) mean of the largest depth over the last fifth [m]."""
        return self._contacts[1]

    @cached_property
    def _sampler(self) -> "_StateSampler":
        return _StateSampler(self._motion, self._run.velocity_states, self._demands)

    @cached_property
    def _samples(self) -> _Samples:
        model, shape = self._motion.model, (self._motion.seeds, len(self.times))
        samples = _Samples(
            np.full((*shape, model.nbody, 3), np.nan),
            np.full((*shape, model.nu), np.nan),
            np.full(shape, np.nan),
            np.zeros(shape, bool),
        )
        for seed in np.flatnonzero(~self.failures).tolist():
            sampled = samples.positions[seed], samples.lengths[seed], samples.energies[seed]
            samples.impacts[seed] = self._sampler.sample_states(seed, self.times, *sampled)
        return samples

    @cached_property
    def _contacts(self) -> tuple[dict[str, Extreme], Floats]:
        seeds, steps = self._motion.seeds, self._motion.steps
        extremes = {name: Extreme(np.zeros(seeds), "") for name in EXTREME_UNITS}
        resting = np.zeros(seeds)
        if not self._extremes_too:
            return extremes, resting
        _measure_joints(self._motion, self._demands, self._run.velocity_states, extremes)
        stride = max(1, -(-seeds * steps // self._contact_states))
        shown, sampler = range(0, steps + 1, stride), self._sampler
        rest = 0.8 * shown[-1]
        for seed in np.flatnonzero(~self.failures).tolist():
            depths = list[float]()
            for step in shown:
                data = sampler.enter_state(seed, step)
                depth = 0.0
                if data.ncon:
                    distances = data.contact.dist
                    worst = int(distances.argmin())
                    depth = max(0.0, -float(distances[worst]))
                    if depth > extremes["depth"].values[seed]:
                        place = " - ".join(_geom_words(sampler.model, data.contact.geom[worst]))
                        _enter_extreme(extremes, "depth", seed, depth, place)
                if sampler.model.neq:
                    for name, value, place in _equality_gaps(sampler.model, data):
                        _enter_extreme(extremes, name, seed, value, place)
                if step >= rest:
                    depths.append(depth)
            resting[seed] = float(np.mean(depths))
        return extremes, resting


class _StateSampler:
    """Evaluates single states of a motion that has run."""

    def __init__(self, motion: Motion, states: Floats, demands: mujoco.MjModel) -> None:
        self.model = motion.model
        same = demands.neq == self.model.neq
        self._demanded = np.flatnonzero(demands.eq_active0 if same else [])
        self._lacks_demanded = not self.model.eq_active0[self._demanded].all()
        self.data = mujoco.MjData(self.model)
        self._motion, self._kept = motion, states

    def enter_state(self, seed: int, step: int) -> mujoco.MjData:
        """Return data at a state, with positions, contacts and gaps."""
        model, data = self.model, self.data
        mujoco.mj_setState(model, data, self._motion.starts[seed], _INTEGRATION)
        mujoco.mj_setState(model, data, np.ascontiguousarray(self._kept[seed, step]), KEPT)
        if self._lacks_demanded:
            data.eq_active[self._demanded] = True
        mujoco.mj_fwdPosition(model, data)
        return data

    def sample_states(
        self, seed: int, times: Floats, positions: Floats, lengths: Floats, energies: Floats
    ) -> np.ndarray:
        """Fill in places, lengths and energies at times; places and lengths by cubic interpolation.

        Hermite's cubic has an error of fourth order in the step, below that of any integrator.

        Returns:
            (K,) whether a contact or a stop occurred up to a time that the start lacks.
        """
        step = float(self.model.opt.timestep)
        own = _list_touching(self.enter_state(seed, 0))
        new = np.zeros(len(times), bool)
        for place, time in enumerate(times):
            first = min(int(time / step + SUM_ROUNDING), self._motion.steps)
            low = self._locate_with_rates(seed, first)
            new[place] = not _list_touching(self.data) <= own
            mujoco.mj_energyPos(self.model, self.data)
            mujoco.mj_energyVel(self.model, self.data)
            energies[place] = self.data.energy.sum()
            high, share = self._locate_with_rates(seed, first + 1), time / step - first
            if not np.isfinite(high[0]).all():
                high, share = low, 0.0
            whole = _interpolate_cubic(low, high, share, step)
            positions[place] = whole[: positions[place].size].reshape(-1, 3)
            lengths[place] = whole[positions[place].size :]
        return np.logical_or.accumulate(new)

    def _locate_with_rates(self, seed: int, step: int) -> tuple[Floats, Floats]:
        # The values are places of bodies and lengths of actuators at a step.
        model, data = self.model, self.enter_state(seed, step)
        mujoco.mj_fwdVelocity(model, data)
        spin, along = data.cvel[:, :3], data.cvel[:, 3:]
        arm = data.xipos - data.subtree_com[model.body_rootid]
        # np.cross takes longer than the kinematics of a few bodies.
        (x, y, z), (a, b, c) = spin.T, arm.T
        speeds = along + np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=1)
        values = np.concatenate([data.xipos.ravel(), data.actuator_length])
        return values, np.concatenate([speeds.ravel(), data.actuator_velocity])


def _list_touching(data: mujoco.MjData) -> set[tuple[int, ...]]:
    # The pairs of geoms that touch, and the joints at their stops.
    pairs = data.contact.geom[np.asarray(data.contact.efc_address) >= 0]
    stops = data.efc_id[data.efc_type == _LIMIT]
    return {tuple(pair) for pair in pairs.tolist()} | {(joint,) for joint in stops.tolist()}


def _interpolate_cubic(
    begin: tuple[Floats, Floats], end: tuple[Floats, Floats], share: float, step: float
) -> Floats:
    (low, low_rate), (high, high_rate) = begin, end
    square, cube = share**2, share**3
    return (
        (2 * cube - 3 * square + 1) * low
        + (cube - 2 * square + share) * step * low_rate
        + (3 * square - 2 * cube) * high
        + (cube - square) * step * high_rate
    )


def _enter_extreme(
    extremes: dict[str, Extreme], name: str, seed: int, value: float, place: str
) -> None:
    extreme = extremes[name]
    if value > extreme.values[seed]:
        if value > extreme.values.max():
            extremes[name] = Extreme(extreme.values, place)
        extreme.values[seed] = value


def _measure_joints(
    motion: Motion, demands: mujoco.MjModel, states: Floats, extremes: dict[str, Extreme]
) -> None:
    # The excess over limits needs only coordinates, so all states are evaluated at once.
    model = motion.model
    limits = demands if demands.njnt == model.njnt else model
    for joint in np.flatnonzero(limits.jnt_limited):
        if model.jnt_type[joint] not in (_HINGE, _SLIDE):
            continue
        kind = "hinge" if model.jnt_type[joint] == _HINGE else "slide"
        values = states[:, : motion.steps + 1, model.jnt_qposadr[joint]]
        low, high = limits.jnt_range[joint]
        beyond = np.maximum(low - values, values - high).max(axis=1)
        for seed in np.flatnonzero(beyond > 0):
            place = name_of(model, "joint", int(joint))
            _enter_extreme(
                extremes, f"{kind} beyond its limit", int(seed), float(beyond[seed]), place
            )


def _geom_words(model: mujoco.MjModel, geoms: np.ndarray) -> Iterator[str]:
    for geom in map(int, geoms):
        if geom < 0:
            yield "flex"
        else:
            yield model.geom(geom).name or body_name(model, int(model.geom_bodyid[geom]))


def _equality_gaps(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[tuple[str, float, str]]:
    rows = np.flatnonzero(data.efc_type == _EQUALITY)
    for number in np.unique(data.efc_id[rows]):
        gaps = data.efc_pos[rows[data.efc_id[rows] == number]]
        place, kind = name_of(model, "equality", int(number)), model.eq_type[number]
        if kind == _WELD:
            # MuJoCo scales the rotational rows of a weld by its torque scale.
            scale = float(model.eq_data[number, 10]) or 1.0
            yield "equality gap", float(np.linalg.norm(gaps[:3])), place
            yield "equality angle", float(np.linalg.norm(gaps[3:])) / scale, place
        elif kind == _JOINT and model.jnt_type[model.eq_obj1id[number]] == _HINGE:
            yield "equality angle", float(np.abs(gaps).max()), place
        elif kind == _CONNECT:
            yield "equality gap", float(np.linalg.norm(gaps)), place
        else:
            yield "equality gap", float(np.abs(gaps).max()), place
