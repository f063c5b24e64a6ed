"""Loads of equalities, creep of brakes, and sleeping bodies, from a few states of a run."""

import copy
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.contact_laws import stiffness_damping
from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import PreparedRuns, Rollout
from contactlab.engines.mujoco_batch import STATE
from contactlab.scene.initial_states import InitialStates, apply_inputs
from contactlab.scene.run_setup import equality_reach

_WAKING_STEPS = 100  # steps that show whether a sleeping body would have stayed
_CONSTRAINT_TYPES, _EQUALITY_TYPES = mujoco.mjtConstraint, mujoco.mjtEq
_BRAKE_TYPES = _CONSTRAINT_TYPES.mjCNSTR_FRICTION_DOF, _CONSTRAINT_TYPES.mjCNSTR_FRICTION_TENDON
_SLEEP_FLAG = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))


def with_loads(runs: PreparedRuns, rollout: Rollout) -> Rollout:
    """Return a rollout with ranges of its controls, and the results of a few states."""
    first, count = runs.prepared[0].model, len(rollout.steps)
    brakes = first.dof_frictionloss.any() or first.tendon_frictionloss.any()
    sampler = LoadSampler(first) if first.neq or brakes else None
    ranges = np.zeros((count, first.nu, 2))
    loads, gaps = np.zeros((count, first.neq)), np.zeros((count, first.neq, 2))
    creep, sleeper = np.zeros((count, 2, first.nv + first.ntendon)), np.full((count, 4), np.nan)
    for run, steps in enumerate(rollout.steps):
        model = runs.prepared[run].model
        controls = rollout.controls[run] if rollout.controls else None
        if controls is not None:
            ranges[run] = np.stack([controls.levels.min(axis=0), controls.levels.max(axis=0)], 1)
        elif first.nu:
            end = max(steps - 1, 0) * model.opt.timestep
            ranges[run] = runs.starts.control_ranges(run, end)
        if sampler is None and not model.opt.enableflags & _SLEEP_FLAG:
            continue
        start = runs.starts.select_run(run)
        start = start if controls is None else start.with_recorded_inputs([controls])
        if model.opt.enableflags & _SLEEP_FLAG:
            sleeper[run] = _worst_sleeper(model, start, rollout.state[run, : steps + 1])
        if sampler is not None and steps:
            sampled = sampler.sample_loads(model, start, rollout.state[run, : steps + 1])
            loads[run], gaps[run], speeds = sampled
            # A driven joint may turn slowly in its bearings.
            creep[run] = speeds * (ranges[run, :, 0] == ranges[run, :, 1]).all()
    rollout = replace(rollout, control_ranges=ranges, sleeper=sleeper, creep=creep)
    return replace(rollout, equality_loads=loads, equality_gaps=gaps)


class _LongestSleep(NamedTuple):
    """A tree's longest sleep: its first step, and its number of steps."""

    dofs: slice
    begin: int
    steps: int


def _worst_sleeper(model: mujoco.MjModel, start: InitialStates, states: Floats) -> Floats:
    """Return (4,) the worst sleeper of a run, see `Trace`; sleeping bodies do not move at all.

    From the step before it falls asleep the model continues awake, and without the slip of
    regularized friction, because creep due to that slip may as well sleep. For most sleepers a few
    steps show that they would have stayed, if they continue at their speed by then.
    """
    awake, worst = copy.copy(model), np.full(4, np.nan)
    awake.opt.enableflags &= ~_SLEEP_FLAG
    if not model.nflex:
        # Enough noslip iterations to keep bodies held by friction from creeping.
        awake.opt.noslip_iterations = max(10, model.opt.noslip_iterations)
    step, lengths = model.opt.timestep, np.asarray(model.dof_length)
    speeds = np.abs(states[:, 1 + model.nq : 1 + model.nq + model.nv]) * lengths
    # Largest motion of a resting body in that time, as a share of its mean size.
    ways, rest = speeds.sum(axis=0) * step, 1e-3 * model.stat.meansize

    def estimated_distance(sleep: _LongestSleep) -> float:
        """Return how far it would move at its last speed [m]."""
        if not sleep.begin:
            return np.inf
        return float(speeds[sleep.begin - 1, sleep.dofs].max()) * sleep.steps * step

    # The longest sleep of each tree that stands still in more than one state.
    sleeps = list[_LongestSleep]()
    for first, count in zip(model.tree_dofadr, model.tree_dofnum, strict=True):
        dofs = slice(int(first), int(first + count))
        still: NDArray[np.bool_] = (speeds[:, dofs] == 0).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
        begins, ends = edges[::2], edges[1::2]
        lasts = ends - begins - 1
        lasts[ends == len(still)] = np.maximum(lasts[ends == len(still)], _WAKING_STEPS)
        if lasts.max(initial=0) > 0:
            longest = int(lasts.argmax())
            sleeps.append(_LongestSleep(dofs, int(begins[longest]), int(lasts[longest])))
    # Number of checked sleeps: the fastest and longest ones.
    for sleep in sorted(sleeps, key=estimated_distance)[-4:]:
        few = min(_WAKING_STEPS, sleep.steps)
        distance, last = _awake_motion(awake, start, states, (sleep.begin, few))
        distance += last * (sleep.steps - few) * step
        if distance[sleep.dofs].max() > rest:
            distance, _ = _awake_motion(awake, start, states, (sleep.begin, sleep.steps))
        most = distance[sleep.dofs].max()
        whole = most + ways[sleep.dofs].max()
        if whole > 0 and not most <= worst[0]:
            joint = model.dof_jntid[sleep.dofs.start + distance[sleep.dofs].argmax()]
            worst = np.array([most, most / whole, joint, sleep.begin])
    return worst


def _awake_motion(
    model: mujoco.MjModel, start: InitialStates, states: Floats, span: tuple[int, int]
) -> tuple[Floats, Floats]:
    """Return the largest motion of a model in some steps (nv,) [m], and its last speeds [m/s].

    `span` is the first step in the run, and the number of steps; the run's last inputs are held.
    """
    (begin, steps), data = span, mujoco.MjData(model)
    first, last = max(begin - 1, 0), len(states) - 1
    mujoco.mj_setState(model, data, states[first], int(STATE))
    at = np.minimum(first + np.arange(begin + steps - first), last)
    distance, away, here = np.zeros(model.nv), np.empty(model.nv), np.array(data.qpos)
    # Number of checks of the awake body's motion.
    looks = np.ceil(np.linspace(0, len(at), 16 + 1)[1:]).astype(int) - 1
    for place, inputs in enumerate(start.input_rows(0, model.opt.timestep, at)):
        apply_inputs(model, data, inputs)
        mujoco.mj_step(model, data)
        if place in looks:
            mujoco.mj_differentiatePos(model, away, 1, here, data.qpos)
            np.maximum(distance, np.abs(away) * model.dof_length, out=distance)
    return distance, np.abs(data.qvel) * model.dof_length


class LoadSampler:
    """Evaluates a few states of runs of one structure."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._data = mujoco.MjData(model)
        self._reach = equality_reach(model)

    def sample_loads(
        self, model: mujoco.MjModel, start: InitialStates, states: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return largest forces of equalities (neq,), their violations, and speeds of creep.

        Violations (neq, 2) are the largest beyond that at the start, and the median of the last
        quarter beyond the remainder of the initial one after relaxation, (1 + t / T) exp(-t / T) of
        it. The speeds (2, nv + ntendon) are those of degrees of freedom that friction loss could
        hold, and the steps with them; see `_creeping_rows` and `_steady_creep`.
        """
        data, steps = self._data, np.append(0, sampled_steps(len(states) - 1))
        acting = start.input_rows(0, model.opt.timestep, steps)
        loads, gaps = np.zeros(model.neq), np.zeros((len(steps), model.neq))
        creep = np.zeros((len(steps), model.nv + model.ntendon))
        mujoco.mj_resetData(model, data)
        for sample, (step, inputs) in enumerate(zip(steps, acting, strict=True)):
            mujoco.mj_setState(model, data, states[step], int(STATE))
            apply_inputs(model, data, inputs)
            mujoco.mj_forward(model, data)
            rows = np.flatnonzero(data.efc_type == int(_CONSTRAINT_TYPES.mjCNSTR_EQUALITY))
            which = data.efc_id[rows]
            if sample:
                np.maximum.at(loads, which, np.abs(data.efc_force[rows]))
            np.add.at(gaps[sample], which, self._row_violations(model, rows, which) ** 2)
            creeps = self._creeping_rows(model)
            for kind, first in zip(_BRAKE_TYPES, (0, model.nv), strict=True):
                is_held = creeps & (data.efc_type == int(kind))
                creep[sample, first + data.efc_id[is_held]] = data.efc_vel[is_held]
        gaps = np.sqrt(gaps)
        late = steps >= min(0.75 * (len(states) - 1), steps[-1])
        passed = np.median(steps[late]) * model.opt.timestep
        passed = passed * np.sqrt(stiffness_damping(model.eq_solref)[0])
        rest = np.median(gaps[late], axis=0) - gaps[0] * (1 + passed) * np.exp(-passed)
        gaps = np.stack([gaps.max(axis=0) - gaps[0], np.maximum(rest, 0)], axis=1)
        return loads, gaps, _steady_creep(creep, steps, len(states) - 1)

    def _creeping_rows(
        self, model: mujoco.MjModel, most_force: float = 0.9, most_change: float = 0.2
    ) -> NDArray[np.bool_]:
        # Return which rows of friction loss move on under a load that they could hold.
        #
        # Args:
        #     most_force: a brake should hold below this share of its friction loss.
        #     most_change: how far the speed may be below the one that balances the load, as a
        #         share of the present speed. A falling body is farther below it.
        #
        # Regularized friction with impedance d accelerates by (1 - d) a - d b v under a load that
        # alone accelerates by a, so its speed is off by the acceleration over d b. This holds at
        # each instant: it is the same in a run of any duration.
        data = self._data
        accelerations = np.zeros(data.nefc)
        mujoco.mj_mulJacVec(model, data, accelerations, data.qacc)
        impedance = data.efc_KBIP[:, 2]
        balancing = impedance * np.abs(data.efc_aref)
        most = most_force * data.efc_frictionloss
        forces = np.asarray(data.efc_force)
        # A swinging body turns back under more load than friction loss could hold.
        inverse_inertia = data.efc_R * impedance / (1 - impedance)
        holding = forces - accelerations / inverse_inertia
        is_held = (np.abs(forces) < most) & (np.abs(holding) < most)
        return is_held & (accelerations * np.sign(data.efc_vel) <= most_change * balancing)

    def _row_violations(self, model: mujoco.MjModel, rows: np.ndarray, which: np.ndarray) -> Floats:
        """Return each row's part of an equality's violation; welds move the smaller's far end."""
        kind, gaps = model.eq_type[which], self._data.efc_pos[rows].copy()
        part = np.arange(len(rows)) - np.searchsorted(which, which)
        turned = (kind == int(_EQUALITY_TYPES.mjEQ_WELD)) & (part >= 3)
        torque_scale_index = 10  # index in eq_data of a weld's weight of rotation
        scale = model.eq_data[which[turned], torque_scale_index]
        gaps[turned] *= 2 * self._reach[which[turned]] / np.where(scale > 0, scale, np.inf)
        flex = kind == int(_EQUALITY_TYPES.mjEQ_FLEX)
        gaps[flex] /= np.sqrt(np.bincount(which)[which[flex]])
        return gaps


def _steady_creep(velocities: Floats, steps: NDArray[np.intp], last: int) -> Floats:
    # Return (2, D) the fastest steady creep of each degree of freedom, and a step with it.
    #
    # Args:
    #     velocities: (L, D) at samples; 0 where it does not creep, see `_creeping_rows`.
    #     steps: (L,) the steps of the samples, ascending.
    #     last: the last step of the run.
    #
    # The first quarter does not count, because brakes take up load in it. The step is the sample of
    # the quarter with the smallest speed that is at least the median.
    quarter, creep_and_step = (
        np.minimum(4 * steps // max(last, 1), 3),
        np.zeros((2, velocities.shape[1])),
    )
    for part in {*quarter.tolist()} - {0}:
        here = np.flatnonzero(quarter == part)
        values = velocities[here]
        median = np.median(values, axis=0)
        forward = values * np.sign(median)
        reaching = np.where(forward >= np.abs(median), forward, np.inf)
        chosen, speed = np.argmin(reaching, axis=0), np.min(reaching, axis=0)
        faster = (median != 0) & (speed > creep_and_step[0])
        creep_and_step[:, faster] = speed[faster], steps[here][chosen[faster]]
    return creep_and_step


def sampled_steps(steps: int) -> np.ndarray:
    """Return the steps of a run that follow a sample of loads: in the middle of equal parts."""
    # A sample takes as long as three or four steps.
    steps_per_sample, min_samples, max_samples = 250, 2, 16
    samples = max(min_samples, min(max_samples, steps // steps_per_sample))
    return ((np.arange(samples) + 0.5) / samples * steps).astype(np.intp)
