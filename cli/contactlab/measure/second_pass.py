"""The second pass: is what the engine computed consistent with itself and with the geometry."""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.measure.context import Context, first_step, runs_where
from contactlab.measure.entries import Finding, Findings, MeasuredRuns, Threshold, label, metric
from contactlab.measure.solver_work import RESIDUAL, saturated, sustained_residual


@metric(unit="1", better="lower", resolution=1e-12, kind="check")
def solver_residual(context: Context) -> Floats:
    """Difference between forward and inverse dynamics over the run's largest constraint force.

    By the flag fwdinv, in constraint space; 99th percentile of the steps with contact. Not
    defined with noslip, which changes forces after the solver.
    """
    return sustained_residual(context, np.ones(context.trace.contacts.shape, dtype=np.bool_))


@metric(unit="1", better="lower", resolution=1e-12, kind="check")
def jacobian_difference(context: Context) -> Floats:
    """Largest relative difference of accelerations from a dense and a sparse constraint Jacobian.

    At sampled states, from a cold start, with and without constraints.
    """
    return context.undefined() if context.checks is None else context.checks.jacobian.max(axis=1)


@metric(unit="m", better="lower", resolution=1e-9, kind="check")
def overlap_missed(context: Context) -> Floats:
    """Deepest overlap of a monitored pair that has no contact, by mj_geomDistance.

    At sampled states.
    """
    return context.undefined() if context.checks is None else context.checks.overlap.max(axis=1)


@metric(unit="m", better="lower", resolution=1e-9, kind="check")
def distance_phantom(context: Context) -> Floats:
    """Largest distance of a monitored pair beyond what its contact reports, by mj_geomDistance.

    At sampled states. Not defined for speculative contacts.
    """
    return context.undefined() if context.checks is None else context.checks.apart.max(axis=1)


@metric(unit="1", better="higher", kind="check")
def repeats(context: Context) -> Floats:
    """1 if a second rollout gives every state again, bit for bit, else 0."""
    checks = context.checks
    return context.undefined() if checks is None else checks.repeats.astype(np.float64)


@label(
    severity=84,
    thresholds=(
        RESIDUAL,
        Threshold(
            "jacobian_difference",
            1e-6,
            "1",
            "Largest metric jacobian_difference; the two are the same mathematics, and agree to "
            "1e-7 where both converge.",
        ),
    ),
)
def solver_inconsistent(runs: MeasuredRuns) -> Findings:
    """The engine contradicts itself.

    The solver stopped early with a wrong answer, a sparse Jacobian changes the answer, or the
    same run gives another trajectory.
    """
    context, checks = runs.context, runs.context.checks
    if checks is None:
        return {}
    early = ~saturated(context)
    value, limit = sustained_residual(context, early), runs.limits["residual"]
    found = {
        run: Finding(
            f"the solver stopped early, but forces and accelerations differ by {value[run]:.2g} of "
            f"the largest force (limit {limit:g})",
            first_step(early[run] & (checks.residual[run] > limit)),
        )
        for run in runs_where(value > limit)
    }
    limit = runs.limits["jacobian_difference"]
    said = "a dense and a sparse Jacobian give accelerations that differ by {:.2g}"
    differing = _beyond(checks.jacobian, limit, said, checks.jacobian_steps, "")
    for run, finding in differing.items():
        found.setdefault(run, finding)
    for run in runs_where(~checks.repeats):
        found.setdefault(run, Finding("a second rollout gave another trajectory", 0))
    return found


@label(
    severity=68,
    thresholds=(
        Threshold(
            "missed_contact",
            1e-4,
            "m",
            "Largest metric overlap_missed; collision tolerances are a hundred times finer.",
        ),
    ),
)
def missed_contact(runs: MeasuredRuns) -> Findings:
    """A monitored pair overlaps without a contact."""
    checks = runs.context.checks
    if checks is None:
        return {}
    limit, said = runs.limits["missed_contact"], "a pair overlaps by {:.3g} m without any contact"
    return _beyond(checks.overlap, limit, said, checks.geometry_steps)


@label(
    severity=64,
    thresholds=(
        Threshold(
            "phantom_contact",
            1e-4,
            "m",
            "Largest metric distance_phantom; collision tolerances are a hundred times finer.",
        ),
    ),
)
def phantom_contact(runs: MeasuredRuns) -> Findings:
    """A contact is reported between separated bodies."""
    checks = runs.context.checks
    if checks is None:
        return {}
    limit = runs.limits["phantom_contact"]
    said = "a contact is {:.3g} m deeper than the distance of its bodies"
    return _beyond(checks.apart, limit, said, checks.geometry_steps)


def _beyond(
    depths: Floats, limit: float, said: str, steps: NDArray[np.intp], unit: str = " m"
) -> Findings:
    """Return the runs whose values (n, L), at checked steps (L,), exceed a limit."""
    return {
        run: Finding(
            f"{said.format(depths[run].max())} (limit {limit:g}{unit})",
            int(steps[first_step(depths[run] > limit)]),
        )
        for run in runs_where(depths.max(axis=1) > limit)
    }
