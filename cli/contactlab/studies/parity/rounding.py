"""Noise floors: the effect of rounding and of the solver's start on MuJoCo itself."""

import copy
from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import PreparedRuns
from contactlab.scene.initial_states import apply_inputs
from contactlab.scene.model_names import STATE_PARTS

_WARMSTART = int(mujoco.mjtDisableBit.mjDSBL_WARMSTART)


def round_starts(runs: PreparedRuns) -> PreparedRuns:
    """Return runs that start from states, and with inputs, rounded to single precision."""
    arrays = {name: getattr(runs.starts, name) for name in STATE_PARTS}
    single = {name: array.astype(np.float32).astype(np.float64) for name, array in arrays.items()}
    return replace(runs, starts=runs.starts._replace(**single))


def without_warmstart(runs: PreparedRuns) -> PreparedRuns:
    """Return runs without warm starts of the solver.

    Within its tolerance it ends at another solution, as the solver of another engine does.
    """

    def set_cold(model: mujoco.MjModel) -> None:
        model.opt.disableflags |= _WARMSTART

    return _change_models(runs, set_cold)


def with_converged_solver(runs: PreparedRuns) -> PreparedRuns:
    """Return runs with a solver that converges far below its tolerance."""

    def set_exact(model: mujoco.MjModel) -> None:
        model.opt.tolerance *= 1e-4
        model.opt.iterations *= 10

    return _change_models(runs, set_exact)


def _change_models(runs: PreparedRuns, change: Callable[[mujoco.MjModel], None]) -> PreparedRuns:
    models = [copy.copy(model) for model in runs.models]
    for model in models:
        change(model)
    pairs = zip(runs.prepared, models, strict=True)
    return replace(runs, prepared=[replace(prepared, model=model) for prepared, model in pairs])


def rounded_at_each_step(runs: PreparedRuns, run: int, steps: int) -> Floats:
    """Return (N + 1, nq) coordinates of a run of MuJoCo with all states rounded."""
    model, starts = runs.models[run], round_starts(runs).starts
    data, positions = mujoco.MjData(model), [starts.qpos[run]]
    data.qpos[:], data.qvel[:], data.act[:] = (
        array[run] for array in (starts.qpos, starts.qvel, starts.act)
    )
    for inputs in starts.input_rows(run, model.opt.timestep, np.arange(steps)):
        apply_inputs(model, data, inputs)
        mujoco.mj_step(model, data)
        for state in (data.qpos, data.qvel, data.act):
            state[:] = state.astype(np.float32)
        positions.append(data.qpos.copy())
    return np.array(positions)
