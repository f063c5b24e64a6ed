"""Motions that restart in states of another one, and the scale of their distances.

A model restarts at the beginning of each window of a run, with the inputs of that window. Its
distance at the end is an impulse, and is compared with the real impulses of the run. So models are
compared from the same states, whatever their timesteps, and chaos does not matter.
"""

from dataclasses import replace

import mujoco
import numpy as np

from contactlab.budget.motion import Motion, forget_delays, without_delays
from contactlab.budget.windows import Run, without_sensors
from contactlab.contact.trace_arrays import Floats
from contactlab.modifications.model_changes import (
    add_several_contacts,
    converge_collision,
    converge_solver,
)
from contactlab.scene.model_edits import set_timestep

MIN_WINDOW_STEPS = 2
"""Steps per window, so that rounding a window to whole steps leaves something to compare."""
STANDING_SHARE = 1e-6
"""Share of the impulse of the body that is moved most: of a body that stands still in a model
without gravity, less than that is rounding, and no scale."""


def scale_of_impulses(real: Floats) -> Floats:
    """Return (..., B) real impulses that distances are a share of, from (..., B) impulses."""
    return np.maximum(real, STANDING_SHARE * real.max(axis=-1, keepdims=True)) + 1e-300


def refine_motion(motion: Motion, model: mujoco.MjModel, rate: int) -> Motion:
    """Return a motion of another model, with `rate` of its steps in one and inputs held as long."""
    return replace(motion, model=model, inputs=motion.inputs.repeat(rate, axis=1))


def build_reference_model(model: mujoco.MjModel, rate: int) -> mujoco.MjModel:
    """Return a model with the run's own integrator, finer steps, a converged solver and collisions.

    Faces of convex shapes meet in several contacts. Bodies do not sleep, and controls act at once:
    see `without_delays`. `rate` is how many of its steps make one of the run's.
    """
    fine = without_sensors(model)
    converge_solver(fine)
    converge_collision(fine)
    add_several_contacts(fine)
    forget_delays(fine)
    set_timestep(fine, model.opt.timestep / rate)
    fine.opt.enableflags &= ~int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))
    return fine


def run_at_once(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return the run's own settings, with inputs that have been delayed already."""
    own = without_sensors(model)
    forget_delays(own)
    return own


def reference_motion(motion: Motion, rate: int) -> Motion:
    """Return a motion of the reference model, with `rate` of its steps in one of the motion's."""
    own = without_delays(motion)
    return refine_motion(own, build_reference_model(own.model, rate), rate)


def whole_windows(run: Run) -> np.ndarray:
    """Return the windows that begin where the one before ends: the last may overlap it."""
    return np.flatnonzero(run.begins % run.steps == 0)


def held_inputs(
    motion: Motion, finer: int, seeds: np.ndarray, begins: np.ndarray, multiple: int, steps: int
) -> Floats:
    """Return (M, steps, width) inputs of seeds from fine steps (M,) on, one row per longer step.

    A step that covers several steps of the motion gets the mean of their inputs.
    """
    if not motion.inputs.shape[2]:
        return np.empty((len(seeds), steps, 0))
    fine = begins[:, None] + np.arange(steps * multiple)
    rows = motion.inputs[seeds[:, None], np.minimum(fine // finer, motion.steps - 1)]
    return rows.reshape(len(seeds), steps, multiple, rows.shape[-1]).mean(axis=2)


def motion_at_steps(motion: Motion, finer: int, seeds: np.ndarray, multiple: int) -> Motion:
    """Return seeds of a motion from start to end, with inputs for steps of `multiple` fine steps.

    The model of the motion is unchanged; another model makes the steps.
    """
    own = without_delays(motion)
    steps = max(MIN_WINDOW_STEPS, round(own.steps * finer / multiple))
    rows = held_inputs(own, finer, seeds, np.zeros(len(seeds), int), multiple, steps)
    return replace(own, starts=own.starts[seeds], inputs=rows)


def subsample_windows(windows: np.ndarray, every: int) -> tuple[np.ndarray, Floats]:
    """Return the first window and one in `every` of the others, with the number each stands for.

    In the first window constraints take up their load, which happens once.
    """
    first, others = windows[:1], windows[1:]
    chosen = others[(every - 1) // 2 :: every]
    stood_for = np.full(len(chosen), len(others) / max(len(chosen), 1))
    return np.concatenate([first, chosen]), np.concatenate([np.ones(len(first)), stood_for])
