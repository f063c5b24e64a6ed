"""The numerical error (backward error) of runs that had a second pass."""

import math
from collections.abc import Collection
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.measure.amounts import readable_fraction
from contactlab.measure.context import Context, runs_where
from contactlab.measure.entries import (
    MeasuredRuns,
    Onset,
    OnsetIterator,
    Threshold,
    label,
    metric,
    threshold_values,
)
from contactlab.rendering.amounts import format_amount, format_percent
from contactlab.schema.comparison import MetricRule

TOLERANCE = Threshold(
    "backward_error",
    0.1,
    "1",
    "Largest numerical error, and energy drift, of a run that is the motion of its model.",
)


_FRICTION_ROWS = ("cone", "impratio", "noslip")  # of an error budget
_SOFTNESS_ROWS = (
    "contact softness",
    "limit softness",
    "friction loss softness",
    "equality softness",
)


@metric("1", "lower", 1e-9, kind="check")
def backward_error(context: Context) -> Floats:
    """Numerical error: residual force as a share of the real forces.

    On the worst body, in windows of 40 ms, against references at a quarter of the step with a
    converged solver. Not defined if the engine warned.
    """
    share = _error_field(context, "share")
    return np.where(np.isinf(share), np.nan, share)


# If two windows have almost equal errors, any change may move the largest to the other.
@metric("s", kind="check", rule=MetricRule(level="note"))
def backward_error_time(context: Context) -> Floats:
    """Start time of the window in which backward_error is largest."""
    return _error_field(context, "time")


@metric("1", version=3, kind="check")
def backward_error_energy(context: Context) -> Floats:
    """Share of energy that the run gains, and its model does not.

    It is negative for a loss.
    """
    return _error_field(context, "energy")


@metric("1", "lower", 1e-9, kind="check")
def friction_effect(context: Context) -> Floats:
    """Largest change of motion by another cone, impratio or noslip, as a share.

    It is that of the worst body, over the real forces. With `checks: verdict` only.
    """
    return _largest_effects(context, _FRICTION_ROWS)


@metric("1", "lower", 1e-9, kind="check")
def softness_effect(context: Context) -> Floats:
    """Largest change of motion by half the solref of contacts, limits or equalities, as a share.

    It is that of the worst body, over the real forces. With `checks: verdict` only.
    """
    return _largest_effects(context, _SOFTNESS_ROWS)


def _largest_effects(context: Context, rows: Collection[str]) -> Floats:
    # 0 if the run exercises none of the rows; NaN if they were not measured.
    if context.checks is None or not context.checks.backward:
        return context.undefined()
    return np.array(
        [
            math.nan
            if error.effects is None
            else max((one.error for one in error.effects if one.name in rows), default=0.0)
            for error in context.checks.backward
        ]
    )


def _error_field(context: Context, name: str) -> Floats:
    if context.checks is None or not context.checks.backward:
        return context.undefined()
    return np.array([getattr(error, name) for error in context.checks.backward], np.float64)


def resolved_runs(context: Context) -> NDArray[np.bool_] | None:
    """Return (n,) whether runs are the motion of their model; None if not measured."""
    if context.checks is None or not context.checks.backward:
        return None
    within = threshold_values(context.setup.thresholds)[TOLERANCE.name]
    return ~(
        (_error_field(context, "share") > within)
        | (np.abs(_error_field(context, "energy")) > within)
    )


def unresolved_runs(context: Context) -> list[int]:
    """Return the runs that are not the motion of their model; none if not measured."""
    resolved = resolved_runs(context)
    return [] if resolved is None else runs_where(~resolved)


def is_resolved(context: Context, run: int, bodies: Collection[str]) -> bool:
    """Return whether some bodies of a measured run move as in its model; without bodies, all."""
    resolved = resolved_runs(context)
    assert resolved is not None
    assert context.checks is not None
    error, own = context.checks.backward[run], _find_worst(context, run, bodies)
    if resolved[run] or own is None:
        return bool(resolved[run])
    within = threshold_values(context.setup.thresholds)[TOLERANCE.name]
    drifts = abs(error.energy) > within and error.energy_body in bodies
    return own[1] <= within and not drifts


def numerical_error_text(context: Context, run: int, bodies: Collection[str] = ()) -> str:
    """Return the numerical error of the worst of some bodies of a run as text; by default of all.

    It is that of all, too, if these bodies lack one, such as bodies without mass.
    """
    assert context.checks is not None
    error = context.checks.backward[run]
    if np.isinf(error.share):
        return "the engine warned"
    body, share = _find_worst(context, run, bodies) or (error.body, error.share)
    return f"numerical error {format_amount(share, '%', digits=3)} in {body}"


def _find_worst(context: Context, run: int, bodies: Collection[str]) -> tuple[str, float] | None:
    assert context.checks is not None
    errors = context.checks.backward[run].errors
    own = [error for error in errors if error[0] in bodies and not np.isnan(error[1])]
    return max(own, key=itemgetter(1), default=None)


def energy_drifts(runs: MeasuredRuns, sign: int) -> OnsetIterator:
    """Yield runs with an energy drift up (1) or down (-1) that their model does not have."""
    within, drifts = runs.limits[TOLERANCE.name], _error_field(runs.context, "energy")
    verb = "gains" if sign > 0 else "loses"
    for run in runs_where(sign * drifts > within):
        part = readable_fraction(abs(drifts[run]))
        reason = f"the run {verb} {part} the energy of its motion, but its model does not"
        where, step = largest_energy_change(runs.context, run)
        yield run, Onset(f"{reason}{where} (limit {format_percent(within)})", step)


def largest_energy_change(context: Context, run: int) -> tuple[str, int]:
    """Return text about the body with the largest energy change, and its step.

    Energy belongs to the whole run, whatever is observed: the body is named but filters nothing.
    """
    backward = context.checks.backward if context.checks else ()
    if not backward or not backward[run].energy_body:
        return "", 0
    step = round(backward[run].energy_time / context.trace.timestep[run])
    return f", most in {backward[run].energy_body}", step


@label(
    "noted",
    rank=0.5,
    thresholds=(TOLERANCE,),
    judged_on=(("friction_effect", TOLERANCE.name), ("softness_effect", TOLERANCE.name)),
    letter="8",
    colour="#e8ffff",
    advice="none if intended; otherwise an elliptic cone with impratio 10, or a shorter solref",
    traits=("note",),
)
def choice_dependent(runs: MeasuredRuns) -> OnsetIterator:
    """Another cone, impratio, noslip or softness changes the motion beyond the tolerance."""
    context, limit = runs.context, runs.limits[TOLERANCE.name]
    for run, error in enumerate(context.checks.backward if context.checks else ()):
        effect = max(error.effects or (), key=lambda effect: effect.error, default=None)
        if effect is not None and effect.error > limit:
            size = format_amount(effect.error, "%", digits=3)
            reason = f"{effect.name} decides: another one changes {effect.body}'s motion by {size}"
            step = round(effect.time / context.trace.timestep[run])
            yield run, Onset(f"{reason} (limit {format_percent(limit)})", step, (effect.body,))


@label(
    "poor",
    rank=4,
    thresholds=(TOLERANCE,),
    letter="J",
    colour="#a2130b",
    advice="the fix of its error budget: contactlab MODEL",
)
def step_dependent(runs: MeasuredRuns) -> OnsetIterator:
    """The run is not the motion of its model: its numerical error is above the tolerance.

    It is measured within windows of 40 ms, so that chaos does not count.
    """
    context, within = runs.context, runs.limits[TOLERANCE.name]
    for run in runs_where(_error_field(context, "share") > within):
        assert context.checks is not None
        error = context.checks.backward[run]
        step = round(error.time / context.trace.timestep[run])
        reason = f"{numerical_error_text(context, run)}, most at {error.time:.3g} s"
        bodies = (error.body,) if np.isfinite(error.share) else ()
        yield run, Onset(reason, step, bodies)
