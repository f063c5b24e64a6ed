"""Estimates the time of a verification from counted work, so that it is planned, not timed."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mujoco

from contactlab.budget.measuring import WINDOW
from contactlab.schema.task import Task
from contactlab.studies.verification.runs import (
    REFERENCE_RATE,
    REST_SECONDS,
    TRACKING_SECONDS,
)
from contactlab.studies.verification.state_tables import CONTACT_STATES, SAMPLES

MAX_TRACKED_ACTUATORS = 24
"""Actuators that are moved alone, evenly spread. It covers an arm, a hand or a humanoid; a body of
a hundred muscles would cost minutes, and its muscles are alike."""


@dataclass(frozen=True)
class VerificationWork:
    """The work of the parts of a verification.

    Attributes:
        state_seconds: of Python for the evaluation of one state [s], measured for robots of 5 to 30
            joints.
        state_steps: share of a step that the positions and contacts of a state take.
        sample_states: states that are evaluated for one sample of bodies and energies.
        load_runs: runs at rest under loads.
        error_rate: steps of the reference of numerical errors, and of its windows, in one step of
            the original.
        verdict_rate: steps of the original that a verdict takes for each step of the task.
        verdict_seconds: of a verdict besides its steps [s].
        recorded_step_seconds: of one step with labels [s].
    """

    state_seconds: float = 5e-5
    state_steps: float = 0.5
    sample_states: int = 3
    load_runs: int = 4
    error_rate: int = 12
    verdict_rate: int = 12
    verdict_seconds: float = 1.0
    recorded_step_seconds: float = 5e-5


_WORK = VerificationWork()


@dataclass(frozen=True)
class PanelCost:
    """Estimated time of verifications on one core [s].

    Attributes:
        first: of the first change of a model.
        next: of each further change, since the runs of the original are kept.
    """

    first: float
    next: float


def estimate_panel(
    model: mujoco.MjModel, task: Task, seeds: int, share: float, step_seconds: float
) -> PanelCost:
    """Estimate the time of a verification with its verdict.

    Args:
        model: the original.
        task: its task.
        seeds: number of seeds.
        share: share of the length of each run.
        step_seconds: time of one step of the original [s].
    """
    step = float(model.opt.timestep)
    first = later = 0.0
    for seconds, rows in _list_runs(model, task, seeds):
        steps = rows * share * seconds / step
        states = min(CONTACT_STATES, steps) + _WORK.sample_states * (SAMPLES + 1) * rows
        evaluation = states * (_WORK.state_seconds + _WORK.state_steps * step_seconds)
        later += steps * step_seconds + evaluation
        first += (REFERENCE_RATE + 3) * steps * step_seconds + 4 * evaluation
    steps = seeds * share * task.duration / step
    errors = 2 * steps * step_seconds
    labels = 2 * steps * (step_seconds + _WORK.recorded_step_seconds)
    verdict = _WORK.verdict_rate * steps * step_seconds + _WORK.verdict_seconds
    later += 2 * errors + labels + verdict
    first += (_WORK.error_rate + 2) * errors + 2 * labels + 2 * verdict
    return PanelCost(first, later)


def fit_panel(
    estimate: Callable[[int, float], float], seeds: int, allowed: float
) -> tuple[int, float]:
    """Return the seeds of a verification, and the share of the length of its runs.

    Seeds are reduced first, to one; the share may be negative, or larger than 1.

    Args:
        estimate: returns the time for seeds and a share [s].
        seeds: most seeds.
        allowed: time of the verification [s].
    """
    while seeds > 1 and estimate(seeds, 1.0) > allowed:
        seeds -= 1
    whole, rest = estimate(seeds, 1.0), estimate(seeds, 0.0)
    return seeds, (allowed - rest) / (whole - rest)


def fewest_windows_share(task: Task) -> float:
    """Return the share of a task's length that leaves three windows in its shortest phase."""
    shortest = min(phase.end - phase.begin for phase in task.phases)
    fewest_windows = 3
    return min(1.0, fewest_windows * WINDOW / shortest)


def _list_runs(model: mujoco.MjModel, task: Task, seeds: int) -> Iterator[tuple[float, int]]:
    # Yields the length [s] and the compared rows of states of each run.
    for _ in range(_WORK.load_runs):
        yield REST_SECONDS, seeds
    for phase in task.phases:
        yield phase.end - phase.begin, seeds
        yield phase.end - phase.begin, seeds
    yield task.phases[-1].end - task.phases[-1].begin, seeds
    if model.nu:
        actuators = min(int(model.nu), MAX_TRACKED_ACTUATORS)
        yield TRACKING_SECONDS, actuators
        yield TRACKING_SECONDS, actuators
