"""Builds the runs of a verification: the same experiment on the original and the changed model.

Each run is a motion of the original, one of the changed model, and a reference, which is the
original at a finer step. A fourth motion, the twin, is the original from a start that is nudged by
about a solver's usual residual. Two quantities that differ as much between original and twin are
equal.
"""

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from contactlab.budget.motion import INTEGRATION, Motion
from contactlab.budget.restarts import reference_motion
from contactlab.contact.trace_arrays import Floats
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.scene.drive.signals import control_ranges
from contactlab.tasks.stress_motions import TILT_DEGREES, double_inputs, tilt_gravity

REFERENCE_RATE = 4
"""Steps of the reference in one step of the original. A first-order error shrinks to a quarter."""
REST_SECONDS = 2.0
"""Long enough for a creep of .1 mm/s to move a body by .2 mm, far above rounding."""
TRACKING_SECONDS = 1.0
"""One period of a sine of 1 Hz, and as long for a step. Each begins at the start of the task, so
that the drift after a step does not hide the delay of a sine."""
TRACKING_SHARE = 0.1
"""Share of a control's range that the step and the sine go through. A tenth stays within the limits
of nearly every joint, and is large against friction and backlash."""
NUDGE = 1e-6
"""Nudge of a twin's velocities [rad/s or m/s]: about a solver's residual at its usual tolerance,
so that a motion which amplifies it is not repeatable by any equal computation. Without
amplification it moves a body by 2 micrometers in 2 s, far below all tolerances."""
_CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)
_PUSHES = int(mujoco.mjtState.mjSTATE_XFRC_APPLIED), int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)


@dataclass(frozen=True)
class PairedRun:
    """One experiment on both models.

    Attributes:
        name: the run, in words of a user.
        original: its motion with the original model.
        changed: the same experiment with the changed model.
        reference: the original at a finer step.
        twin: the original from a nudged start.
        in_loop: True if a policy acted in each of its motions.
        passive: True if actuators do nothing, so that energy can only fall.
        at_rest: True if inputs are constant, so that a body that rests should not move.
        unconstrained: True if no constraint acts, so that only the equations of motion count.
        actuators: names of the actuators that its rows excite, one row each; empty otherwise.
    """

    name: str
    original: Motion
    changed: Motion
    reference: Motion
    twin: Motion
    in_loop: bool = False
    passive: bool = False
    at_rest: bool = False
    unconstrained: bool = False
    actuators: tuple[str, ...] = ()


def pair_motions(
    name: str, original: Motion, changed: Motion, *, at_rest: bool = False
) -> PairedRun:
    """Return the run of two motions of the same experiment."""
    return PairedRun(
        name=name,
        original=original,
        changed=changed,
        reference=reference_motion(original, choose_reference_rate(original, changed)),
        twin=nudge_start(original),
        at_rest=at_rest,
    )


def choose_reference_rate(original: Motion, changed: Motion) -> int:
    """Return the steps of the reference in one step of the original.

    A reference is never coarser than the changed model: a finer motion of the same model would
    differ from it by the error of the reference.
    """
    ratio = float(original.model.opt.timestep) / float(changed.model.opt.timestep)
    return max(REFERENCE_RATE, math.ceil(ratio - SUM_ROUNDING))


def nudge_start(motion: Motion) -> Motion:
    """Return a motion with start velocities slightly off, by the same amount for each seed.

    Signs are random, since equal nudges of all free bodies shift a heap as a whole, and its impacts
    stay.
    """
    model, starts = motion.model, motion.starts.copy()
    signs = np.random.default_rng(0).choice([-1.0, 1.0], model.nv)
    starts[:, velocity_slice(model)] += NUDGE * signs
    return replace(motion, starts=starts)


def velocity_slice(model: mujoco.MjModel) -> slice:
    """Return where starts have their velocities."""
    return _state_slice(model, int(mujoco.mjtState.mjSTATE_QVEL))


def build_load_runs(original: Motion, changed: Motion, share: float = 1.0) -> list[PairedRun]:
    """Return the runs that load a model otherwise than its task does, from the task's start.

    They are: rest under constant controls, rest with gravity tilted two ways, and the passive
    model. `original` and `changed` are the first phase of the task; `share` shortens the runs.
    """
    paired_runs = list[PairedRun]()
    length = share * REST_SECONDS
    rests = [hold_inputs(motion, length, lambda own: own) for motion in (original, changed)]
    paired_runs.append(pair_motions("at rest", *rests, at_rest=True))
    # At 20 degrees friction carries tan(20 degrees) = .36 of the weight, which most pads hold.
    for name, sign in (
        (f"tilted by {TILT_DEGREES:g} degrees", 1.0),
        ("tilted the other way", -1.0),
    ):
        pair = (tilt_gravity(motion, sign) for motion in rests)
        paired_runs.append(pair_motions(name, *pair, at_rest=True))
    passive = (hold_inputs(motion, length, without_actuation) for motion in (original, changed))
    paired_runs.append(replace(pair_motions("passive", *passive), passive=True))
    return paired_runs


def build_doubled_run(original: Motion, changed: Motion) -> PairedRun:
    """Return the run with twice the controls and pushes; actuators clamp them as they do."""
    pair = (double_inputs(motion) for motion in (original, changed))
    return pair_motions(f"{original.name}, inputs doubled", *pair)


def hold_inputs(
    motion: Motion, seconds: float, change: Callable[[mujoco.MjModel], mujoco.MjModel]
) -> Motion:
    """Return a motion from the same starts, with a changed model and the start's own inputs.

    Controls stay those of the first step. Forces that push bodies are left out.
    """
    model = change(copy.copy(motion.model))
    steps = max(5, round(seconds / float(model.opt.timestep)))
    starts = motion.starts.copy()
    if motion.inputs.shape[2]:
        controls = motion.state_part(_CONTROL)[:, :1]
    else:
        controls = starts[:, None, _state_slice(model, _CONTROL)]
    for bit in _PUSHES:
        starts[:, _state_slice(model, bit)] = 0.0
    inputs = np.repeat(controls, steps, axis=1)
    return replace(motion, model=model, starts=starts, inputs=inputs, spec=_CONTROL)


def _state_slice(model: mujoco.MjModel, bit: int) -> slice:
    begin = mujoco.mj_stateSize(model, (bit - 1) & INTEGRATION)
    return slice(begin, begin + mujoco.mj_stateSize(model, bit))


def without_actuation(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return the model with its actuators switched off."""
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    return model


def build_unconstrained_runs(
    original: Motion, changed: Motion, actuators: Sequence[int], share: float = 1.0
) -> list[PairedRun]:
    """Return the runs without contacts, limits, equalities and dry friction.

    They are: constant controls, and a step of each actuator alone. Whatever a fix changes of
    constraints, these motions stay.
    """
    pair = [
        replace(motion, model=without_constraints(copy.copy(motion.model)))
        for motion in (original, changed)
    ]
    held_motions = (hold_inputs(motion, share * REST_SECONDS, lambda own: own) for motion in pair)
    steps = build_tracking_runs(pair[0], pair[1], actuators, share)[:1]
    free_motions = (replace(step, name=f"free motion, {step.name}") for step in steps)
    runs = (pair_motions("free motion", *held_motions), *free_motions)
    return [replace(run, unconstrained=True) for run in runs]


def without_constraints(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return the model with all its constraints switched off."""
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    return model


def build_tracking_runs(
    original: Motion, changed: Motion, actuators: Sequence[int], share: float = 1.0
) -> list[PairedRun]:
    """Return a run of steps and one of sines, with one row for each actuator, which moves alone.

    Its control makes a step of `TRACKING_SHARE` of its range, or a sine of 1 Hz of the same size
    about the control that the start has. `share` shortens the runs.
    """
    if not len(actuators):
        return []
    model = original.model
    begin = hold_inputs(original, share * TRACKING_SECONDS, lambda own: own)
    length = begin.steps * float(model.opt.timestep)
    # The waves of the reference are not those that the original's steps hold: a shorter step
    # follows a sine more closely.
    fine = reference_motion(original, choose_reference_rate(original, changed))
    ranges = control_ranges(model)
    # Away from the nearer end of the range, so that a step never meets it.
    rest = begin.inputs[0, 0]
    room = np.where(rest < ranges.mean(axis=1), 1.0, -1.0)
    sizes = TRACKING_SHARE * (ranges[:, 1] - ranges[:, 0]) * room

    def excite_actuators(motion: Motion, wave: Callable[[Floats], Floats]) -> Motion:
        held_motion = hold_inputs(motion, length, lambda own: own)
        times: Floats = np.float64(held_motion.model.opt.timestep) * np.arange(held_motion.steps)
        inputs = np.repeat(held_motion.inputs[:1], len(actuators), axis=0)
        for row, actuator in enumerate(actuators):
            inputs[row, :, actuator] += sizes[actuator] * wave(times)
        starts = np.repeat(held_motion.starts[:1], len(actuators), axis=0)
        return replace(held_motion, starts=starts, inputs=inputs)

    def make_sine(times: Floats) -> Floats:
        return np.asarray(np.sin(2 * np.pi * times), np.float64)

    waves: dict[str, Callable[[Floats], Floats]] = {"step": np.ones_like, "sine of 1 Hz": make_sine}
    names = tuple(model.actuator(each).name or f"actuator[{each}]" for each in actuators)
    runs = list[PairedRun]()
    for name, wave in waves.items():
        pair = (excite_actuators(motion, wave) for motion in (original, changed))
        run = replace(pair_motions(name, *pair), reference=excite_actuators(fine, wave))
        runs.append(replace(run, actuators=names))
    return runs
