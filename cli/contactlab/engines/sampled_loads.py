"""Loads of equalities, brakes that creep, and sleepers, from a few states of a run."""

import copy
from dataclasses import replace

import mujoco
import numpy as np

from contactlab.contact.contact_laws import stiffness_damping
from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import PreparedRuns, Rollout
from contactlab.engines.mujoco_batch import STATE
from contactlab.scene.initial_states import InitialStates, apply_inputs
from contactlab.scene.run_setup import equality_reach

_STEPS_OF_SAMPLE = 250  # Steps for each sample, which takes as long as three or four of them
_FEWEST_SAMPLES, _MOST_SAMPLES = 2, 16
_WAKING = 100  # Steps over which what was woken accelerates on average
_HELD = 0.9  # Share of its friction loss below which what brakes should stay where it is
_KIND, _EQUALITY = mujoco.mjtConstraint, mujoco.mjtEq
_BRAKES = _KIND.mjCNSTR_FRICTION_DOF, _KIND.mjCNSTR_FRICTION_TENDON
_SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))
_TORQUE_SCALE = 10  # where eq_data has the factor by which a weld weighs its rotation


def with_loads(runs: PreparedRuns, rollout: Rollout) -> Rollout:
    """Return a rollout with ranges of its controls, and what else a few states tell of it."""
    first, count = runs.prepared[0].model, len(rollout.steps)
    brakes = first.dof_frictionloss.any() or first.tendon_frictionloss.any()
    sampler = _Sampler(first) if first.neq or brakes else None
    ranges = np.zeros((count, first.nu, 2))
    loads, gaps = np.zeros((count, first.neq)), np.zeros((count, first.neq, 2))
    creep, sleeper = np.zeros((count, first.nv + first.ntendon)), np.full((count, 3), np.nan)
    for run, steps in enumerate(rollout.steps):
        model = runs.prepared[run].model
        controls = rollout.controls[run] if rollout.controls else None
        if controls is not None:
            ranges[run] = np.stack([controls.levels.min(axis=0), controls.levels.max(axis=0)], 1)
        elif first.nu:
            end = max(steps - 1, 0) * model.opt.timestep
            ranges[run] = runs.starts.control_ranges(run, end)
        if sampler is None and not model.opt.enableflags & _SLEEP:
            continue
        start = runs.starts.pick(run)
        start = start if controls is None else start.acted_on([controls])
        if model.opt.enableflags & _SLEEP:
            sleeper[run] = _sleeper(model, start, rollout.state[run, : steps + 1])
        if sampler is not None and steps:
            found = sampler.sample(model, start, rollout.state[run, : steps + 1])
            loads[run], gaps[run], speeds = found
            # What is driven may turn slowly in its bearings.
            creep[run] = speeds * (ranges[run, :, 0] == ranges[run, :, 1]).all()
    rollout = replace(rollout, control_ranges=ranges, sleeper=sleeper, creep=creep)
    return replace(rollout, equality_loads=loads, equality_gaps=gaps)


def _sleeper(model: mujoco.MjModel, start: InitialStates, states: Floats) -> Floats:
    """Return (3,) the worst sleeper of a run, as `Trace` says: what sleeps does not move at all."""
    moving = states[:, 1 + model.nq : 1 + model.nq + model.nv] != 0
    stirring = np.isin(model.dof_treeid, model.dof_treeid[moving[-1]])
    if stirring.all():
        return np.full(3, np.nan)
    awake, last = copy.copy(model), len(states) - 1
    awake.opt.enableflags &= ~_SLEEP
    data = mujoco.MjData(awake)
    mujoco.mj_setState(awake, data, states[last], int(STATE))
    apply_inputs(awake, data, start.inputs(0, model.opt.timestep, np.array([last]))[0])
    mujoco.mj_step(awake, data, nstep=_WAKING)
    seconds = _WAKING * model.opt.timestep
    acceleration = np.where(stirring, -1, np.abs(data.qvel) * model.dof_length / seconds)
    worst = int(acceleration.argmax())
    tree = model.dof_treeid == model.dof_treeid[worst]
    since = moving[:, tree].any(axis=1).cumsum().argmax()
    return np.array([acceleration[worst], model.dof_jntid[worst], since])


class _Sampler:
    """Looks at a few states of runs of one structure."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._data = mujoco.MjData(model)
        self._reach = equality_reach(model)

    def sample(
        self, model: mujoco.MjModel, start: InitialStates, states: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return largest forces of equalities (neq,), their violations, and what creeps.

        Violations (neq, 2) are the largest beyond that at the start, and the median of the last
        quarter beyond what its spring has left of that, (1 + t / T) exp(-t / T) of it. The speeds
        (nv + ntendon,) are of what friction loss could hold, medians too.
        """
        data, steps = self._data, np.append(0, sampled_steps(len(states) - 1))
        acting = start.inputs(0, model.opt.timestep, steps)
        loads, gaps = np.zeros(model.neq), np.zeros((len(steps), model.neq))
        creep = np.zeros((len(steps), model.nv + model.ntendon))
        mujoco.mj_resetData(model, data)
        for sample, (step, inputs) in enumerate(zip(steps, acting, strict=True)):
            mujoco.mj_setState(model, data, states[step], int(STATE))
            apply_inputs(model, data, inputs)
            mujoco.mj_forward(model, data)
            rows = np.flatnonzero(data.efc_type == int(_KIND.mjCNSTR_EQUALITY))
            which = data.efc_id[rows]
            if sample:
                np.maximum.at(loads, which, np.abs(data.efc_force[rows]))
            np.add.at(gaps[sample], which, self._gaps(model, rows, which) ** 2)
            for kind, first in zip(_BRAKES, (0, model.nv), strict=True):
                held = data.efc_type == int(kind)
                held &= np.abs(data.efc_force) < _HELD * data.efc_frictionloss
                creep[sample, first + data.efc_id[held]] = data.efc_vel[held]
        gaps = np.sqrt(gaps)
        late = steps >= min(0.75 * (len(states) - 1), steps[-1])
        passed = np.median(steps[late]) * model.opt.timestep
        passed = passed * np.sqrt(stiffness_damping(model.eq_solref)[0])
        rest = np.median(gaps[late], axis=0) - gaps[0] * (1 + passed) * np.exp(-passed)
        gaps = np.stack([gaps.max(axis=0) - gaps[0], np.maximum(rest, 0)], axis=1)
        return loads, gaps, np.abs(np.median(creep[late], axis=0))

    def _gaps(self, model: mujoco.MjModel, rows: np.ndarray, which: np.ndarray) -> Floats:
        """Return each row's part of an equality's violation; welds move the smaller's far end."""
        kind, gaps = model.eq_type[which], self._data.efc_pos[rows].copy()
        part = np.arange(len(rows)) - np.searchsorted(which, which)
        turned = (kind == int(_EQUALITY.mjEQ_WELD)) & (part >= 3)
        scale = model.eq_data[which[turned], _TORQUE_SCALE]
        gaps[turned] *= 2 * self._reach[which[turned]] / np.where(scale > 0, scale, np.inf)
        flex = kind == int(_EQUALITY.mjEQ_FLEX)
        gaps[flex] /= np.sqrt(np.bincount(which)[which[flex]])
        return gaps


def sampled_steps(steps: int) -> np.ndarray:
    """Return the steps of a run before which loads are taken: in the middle of equal parts."""
    samples = max(_FEWEST_SAMPLES, min(_MOST_SAMPLES, steps // _STEPS_OF_SAMPLE))
    return ((np.arange(samples) + 0.5) / samples * steps).astype(np.intp)
