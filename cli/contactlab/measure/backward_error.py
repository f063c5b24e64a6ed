"""The backward error of runs that had a second pass: phantom forces over real ones."""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.measure.amounts import part_of
from contactlab.measure.context import Context, runs_where
from contactlab.measure.entries import (
    Found,
    MeasuredRuns,
    Onset,
    Threshold,
    label,
    limits,
    metric,
)

TOLERANCE = Threshold(
    "backward_error",
    0.1,
    "1",
    "The share within which a run is the motion of its model, and its energy the model's.",
)


@metric("1", "lower", 1e-9, kind="check")
def backward_error(context: Context) -> Floats:
    """Phantom forces under which the run would be its model's motion, over the real ones.

    On the worst body, in windows of 40 ms, against references at a quarter of the step with a
    solver that goes on: docs/budget.md. Not defined where the engine warned.
    """
    share = _of(context, "share")
    return np.where(np.isinf(share), np.nan, share)


@metric("s", kind="check")
def backward_error_time(context: Context) -> Floats:
    """When the window begins in which backward_error is largest."""
    return _of(context, "time")


@metric("1", version=3, kind="check")
def backward_error_energy(context: Context) -> Floats:
    """Share of energy that the run gains, if positive, and its model does not: docs/budget.md."""
    return _of(context, "energy")


def _of(context: Context, name: str) -> Floats:
    if context.checks is None or not context.checks.backward:
        return context.undefined()
    return np.array([getattr(error, name) for error in context.checks.backward], np.float64)


def resolved_runs(context: Context) -> NDArray[np.bool_] | None:
    """Return (n,) whether runs are the motion of their model; None where nobody asked."""
    if context.checks is None or not context.checks.backward:
        return None
    within = limits(context.setup.thresholds)[TOLERANCE.name]
    return ~((_of(context, "share") > within) | (np.abs(_of(context, "energy")) > within))


def unresolved_runs(context: Context) -> list[int]:
    """Return the runs that are not the motion of their model; none where nobody asked."""
    resolved = resolved_runs(context)
    return [] if resolved is None else runs_where(~resolved)


def phantom_forces(context: Context, run: int) -> str:
    """Say how large phantom forces on a run are, and on which body."""
    assert context.checks is not None
    error = context.checks.backward[run]
    if np.isinf(error.share):
        return "the engine warned"
    return f"phantom forces of {part_of(error.share)} the real ones on {error.body}"


def energy_drifts(runs: MeasuredRuns, sign: int) -> Found:
    """Yield the runs whose energy drifts up (1) or down (-1), as that of their model does not."""
    within, drifts = runs.limits[TOLERANCE.name], _of(runs.context, "energy")
    verb = "gains" if sign > 0 else "loses"
    for run in runs_where(sign * drifts > within):
        part = part_of(abs(drifts[run]))
        reason = f"the run {verb} {part} the energy of its motion, which its model does not"
        where, step = most_in(runs.context, run)
        yield run, Onset(f"{reason}{where} (limit {within:g})", step)


def most_in(context: Context, run: int) -> tuple[str, int]:
    """Say in which body a run changes energy most, and return the step at which it does.

    An energy is of the whole run, whatever is watched: the body is named, and filters nothing.
    """
    backward = context.checks.backward if context.checks else ()
    if not backward or not backward[run].energy_body:
        return "", 0
    step = round(backward[run].energy_time / context.trace.timestep[run])
    return f", most in {backward[run].energy_body}", step


@label(
    "poor",
    rank=4,
    thresholds=(TOLERANCE,),
    letter="J",
    colour="#a2130b",
    advice="the change that its budget names: contactlab examine MODEL",
)
def step_dependent(runs: MeasuredRuns) -> Found:
    """The run is not the motion of its model: phantom forces are large beside the real ones.

    They are measured within windows of 40 ms, so chaos is none of it.
    """
    context, within = runs.context, runs.limits[TOLERANCE.name]
    for run in runs_where(_of(context, "share") > within):
        assert context.checks is not None
        error = context.checks.backward[run]
        step = round(error.time / context.trace.timestep[run])
        reason = f"{phantom_forces(context, run)}, most at {error.time:.3g} s"
        bodies = (error.body,) if np.isfinite(error.share) else ()
        yield run, Onset(reason, step, bodies)
