"""Metrics and rules of the second pass: is what the engine computed consistent with itself."""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats, SelfChecks
from contactlab.measure.context import Context
from contactlab.measure.label import Case, Finding, Findings, first, rows
from contactlab.measure.metric import Metric
from contactlab.measure.solver import saturated

_SUSTAINED = 0.99
"""Quantile of the residual over the steps with contact: a single hard step is no failure."""


def _residual(context: Context) -> Floats:
    return _quantile(context, np.ones(context.trace.contacts.shape, dtype=np.bool_))


def _jacobian(context: Context) -> Floats:
    return context.nothing() if context.checks is None else context.checks.jacobian.max(axis=1)


def _overlap(context: Context) -> Floats:
    return context.nothing() if context.checks is None else context.checks.overlap.max(axis=1)


def _apart(context: Context) -> Floats:
    return context.nothing() if context.checks is None else context.checks.apart.max(axis=1)


def _repeats(context: Context) -> Floats:
    checks = context.checks
    return context.nothing() if checks is None else checks.repeats.astype(np.float64)


def _quantile(context: Context, where: NDArray[np.bool_]) -> Floats:
    """Return (n,) the sustained residual over the given steps with contact, 0 without any."""
    if context.checks is None:
        return context.nothing()
    picked = where & (context.trace.contacts > 0)
    return np.array(
        [
            np.quantile(residual[mask], _SUSTAINED) if mask.any() else 0.0
            for residual, mask in zip(context.checks.residual, picked, strict=True)
        ]
    )


def solver_inconsistent(case: Case) -> Findings:
    """Find runs whose solver stopped content with a wrong answer, or repeats differ."""
    context, checks = case.context, case.context.checks
    if checks is None:
        return {}
    found: Findings = {}
    for run in rows(_wrong(case, ~saturated(context))):
        value = _quantile(context, ~saturated(context))[run]
        step = first(~saturated(context)[run] & (checks.residual[run] > case.limits["residual"]))
        found[run] = Finding(
            f"the solver stopped early, but forces and accelerations differ by {value:.2g} of the "
            f"largest force (limit {case.limits['residual']:g})",
            step,
        )
    for run in rows(checks.jacobian.max(axis=1) > case.limits["jacobian_difference"]):
        found.setdefault(run, _jacobian_finding(checks, run, case.limits["jacobian_difference"]))
    for run in rows(~checks.repeats):
        found.setdefault(run, Finding("a second rollout gave another trajectory", 0))
    return found


def unconverged(case: Case) -> Findings:
    """Find runs whose solver used all its iterations, and was not done."""
    context = case.context
    value = _quantile(context, saturated(context))
    return {
        run: Finding(
            f"the solver used all its {context.setup.iterations[run]} iterations in "
            f"{saturated(context)[run].mean():.0%} of the steps, and forces and accelerations "
            f"still differ by {value[run]:.2g} of the largest force",
            first(saturated(context)[run]),
        )
        for run in rows(_wrong(case, saturated(context)))
    }


def missed_contact(case: Case) -> Findings:
    """Find runs in which a graded pair overlaps, by geometry, and has no contact."""
    checks, limit = case.context.checks, case.limits["missed_contact"]
    if checks is None:
        return {}
    return {
        run: Finding(
            f"a pair overlaps by {checks.overlap[run].max():.3g} m without any contact "
            f"(limit {limit:g} m)",
            int(checks.geometry_steps[first(checks.overlap[run] > limit)]),
        )
        for run in rows(checks.overlap.max(axis=1) > limit)
    }


def phantom_contact(case: Case) -> Findings:
    """Find runs in which a contact says that bodies touch which are apart, by geometry."""
    checks, limit = case.context.checks, case.limits["phantom_contact"]
    if checks is None:
        return {}
    return {
        run: Finding(
            f"a contact is {checks.apart[run].max():.3g} m deeper than the distance of its bodies "
            f"(limit {limit:g} m)",
            int(checks.geometry_steps[first(checks.apart[run] > limit)]),
        )
        for run in rows(checks.apart.max(axis=1) > limit)
    }


def _wrong(case: Case, where: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return _quantile(case.context, where) > case.limits["residual"]


def _jacobian_finding(checks: SelfChecks, run: int, limit: float) -> Finding:
    differs = checks.jacobian[run]
    return Finding(
        f"a dense and a sparse Jacobian give accelerations that differ by {differs.max():.2g} "
        f"(limit {limit:g})",
        int(checks.jacobian_steps[first(differs > limit)]),
    )


CHECKS = (
    Metric(
        "solver_residual",
        "1",
        "lower",
        1e-12,
        1,
        "Difference between forward and inverse dynamics (flag fwdinv, in constraint space) over "
        "the run's largest constraint force; 99th percentile of the steps with contact. Not "
        "defined with noslip, which changes forces after the solver.",
        _residual,
    ),
    Metric(
        "jacobian_difference",
        "1",
        "lower",
        1e-12,
        1,
        "Largest difference of the accelerations from a dense and a sparse constraint Jacobian at "
        "sampled states, from a cold start, over the acceleration, with and without constraints.",
        _jacobian,
    ),
    Metric(
        "overlap_missed",
        "m",
        "lower",
        1e-9,
        1,
        "Deepest overlap of a graded pair that has no contact, by mj_geomDistance at sampled "
        "states.",
        _overlap,
    ),
    Metric(
        "distance_phantom",
        "m",
        "lower",
        1e-9,
        1,
        "Largest distance, by mj_geomDistance at sampled states, of a graded pair beyond what its "
        "contact says. Not defined for speculative contacts.",
        _apart,
    ),
    Metric(
        "repeats",
        "1",
        "higher",
        0,
        1,
        "1 if a second rollout gives every state again, bit for bit, else 0.",
        _repeats,
    ),
)
