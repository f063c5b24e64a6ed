"""How far runs are from their closed form, the label of a miss, and what several oracles read."""

import numpy as np
from numpy.typing import ArrayLike

from contactlab.contact.contact_laws import damping_ratio, restitution_of
from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError, did_you_mean
from contactlab.measure.context import Context, cached, runs_where
from contactlab.measure.entries import (
    ORACLES,
    Finding,
    Found,
    MeasuredRuns,
    OracleResult,
    label,
    metric,
)


def distance_from_rest(context: Context, steps: ArrayLike) -> Floats:
    """Return (n, ...) the distance [m] that 1 m/s^2 moves a body from rest in this many steps.

    A semi-implicit step adds h a to the velocity and then h v to the position, so that N steps
    move by ``a h^2 N (N + 1) / 2``; RK4 by ``a (h N)^2 / 2``.
    """
    count = np.asarray(steps, dtype=np.float64)
    one = (slice(None),) + (None,) * count.ndim
    step = context.trace.timestep[one]
    return step**2 * count * (count + semi_implicit(context)[one]) / 2


def semi_implicit(context: Context) -> Floats:
    """Return (n,) 1 where positions move with the velocity after a step, 0 for RK4."""
    return np.array([name != "RK4" for name in context.setup.settings["integrator"]], np.float64)


def friction(context: Context, place: int = 0) -> Floats:
    """Return (n,) a friction coefficient: sliding [1], or at place 2 torsional, 3 rolling [m]."""
    return context.setting("friction").reshape(context.trace.runs, -1)[:, place]


def gravity(context: Context) -> Floats:
    """Return (n,) the magnitude of gravity [m/s^2]."""
    return np.linalg.norm(context.setup.gravity, axis=1)


def restitution_of_solref(context: Context) -> Floats:
    """Return (n,) the restitution that follows from the damping ratio of solref."""
    return restitution_of(damping_ratio(context.setting("solref")))


@metric("any", kind="detail", heading="expected")
def oracle_expected(context: Context) -> Floats:
    """Expected value by the scene's closed form, in the unit of that oracle."""
    return _result(context).expected


@metric("any", kind="detail", heading="measured")
def oracle_measured(context: Context) -> Floats:
    """Measured value of what the scene's closed form expects, in the same unit."""
    return _result(context).measured


@metric("any", "lower", 1e-9, equivalence=True)
def oracle_error(context: Context) -> Floats:
    """Error against the scene's closed form.

    As a share of the expected value or in its unit, as the oracle defines. It includes the
    modelling error of soft contact, which no timestep removes, and the discretisation error.
    """
    return _result(context).error


@label(16)
def oracle_miss(runs: MeasuredRuns) -> Found:
    """The error against the scene's closed form exceeds the limit, or nothing could be measured."""
    setup, last = runs.context.setup, runs.context.trace.steps - 1
    expected, measured, error = (
        runs.metrics[f"oracle_{each}"] for each in ("expected", "measured", "error")
    )
    unmet = np.isfinite(expected) & np.isnan(measured) & np.isfinite(setup.oracle_tolerance)
    for run in runs_where(unmet | (error > setup.oracle_tolerance)):
        found = (
            f"expected {expected[run]:.4g}, measured {measured[run]:.4g}, error {error[run]:.3g}"
        )
        reason = f"{setup.oracle}: {found} (limit {setup.oracle_tolerance:g})"
        yield run, Finding(reason, last)


@cached
def _result(context: Context) -> OracleResult:
    name = context.setup.oracle
    if name is None:
        return OracleResult(context.undefined(), context.undefined(), context.undefined())
    if name not in ORACLES:
        known = ", ".join(ORACLES)
        raise SceneError(f"no oracle '{name}'{did_you_mean(name, ORACLES)}; there are {known}")
    return ORACLES[name].of(context)
