"""How far runs are from their closed form, and the label of a miss."""

import numpy as np

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
    """Error against the scene's closed form, as a share or in its unit as the oracle defines.

    It is the modelling error of soft contact, which no timestep removes, and discretisation.
    """
    return _result(context).error


@label(16)
def oracle_miss(runs: MeasuredRuns) -> Found:
    """The error against the scene's closed form exceeds the limit, or nothing could be measured."""
    setup, last = runs.context.setup, runs.context.trace.steps - 1
    names = "oracle_expected", "oracle_measured", "oracle_error"
    expected, measured, error = (runs.metrics[name] for name in names)
    unmet = np.isfinite(expected) & np.isnan(measured) & np.isfinite(setup.oracle_tolerance)
    for run in runs_where(unmet | (error > setup.oracle_tolerance)):
        found = f"{setup.oracle}: expected {expected[run]:.4g}, measured {measured[run]:.4g}"
        reason = f"{found}, error {error[run]:.3g} (limit {setup.oracle_tolerance:g})"
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
