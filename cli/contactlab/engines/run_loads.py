"""What controls and equality constraints did in a rollout, which no sensor measures."""

from dataclasses import replace

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import PreparedRuns, Rollout
from contactlab.engines.mujoco_batch import STATE
from contactlab.scene.initial_states import InitialStates, apply_inputs

_STEPS_OF_SAMPLE = 250
"""Steps for each sample, which takes as long as three or four of them."""
_MOST_SAMPLES = 16
_EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)


def with_loads(runs: PreparedRuns, rollout: Rollout) -> Rollout:
    """Return a rollout with the ranges of its controls and the loads of its equalities."""
    first = runs.prepared[0].model
    data = mujoco.MjData(first) if first.neq else None
    ranges = np.zeros((len(rollout.steps), first.nu, 2))
    loads = np.zeros((len(rollout.steps), first.neq))
    for run, steps in enumerate(rollout.steps):
        model, start = runs.prepared[run].model, runs.starts.pick(run)
        if rollout.controls and (controls := rollout.controls[run]) is not None:
            start = start.acted_on([controls])
        ranges[run] = start.control_ranges(max(steps - 1, 0) * model.opt.timestep)
        if data is not None and steps:
            loads[run] = _loads(model, data, start, rollout.state[run, : steps + 1])
    return replace(rollout, control_ranges=ranges, equality_loads=loads)


def sampled_steps(steps: int) -> np.ndarray:
    """Return the steps of a run before which loads are taken: in the middle of equal parts."""
    samples = max(1, min(_MOST_SAMPLES, steps // _STEPS_OF_SAMPLE))
    return ((np.arange(samples) + 0.5) / samples * steps).astype(np.intp)


def _loads(
    model: mujoco.MjModel, data: mujoco.MjData, start: InitialStates, states: Floats
) -> Floats:
    """Return (neq,) the largest force of each equality constraint at sampled steps [N or N m]."""
    steps = sampled_steps(len(states) - 1)
    acting = start.inputs(0, model.opt.timestep, steps)
    loads = np.zeros(model.neq)
    mujoco.mj_resetData(model, data)
    for step, inputs in zip(steps, acting, strict=True):
        mujoco.mj_setState(model, data, states[step], int(STATE))
        apply_inputs(model, data, inputs)
        mujoco.mj_forward(model, data)
        rows = data.efc_type == _EQUALITY
        np.maximum.at(loads, data.efc_id[rows], np.abs(data.efc_force[rows]))
    return loads
