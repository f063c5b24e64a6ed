"""How far runs are from the closed form of their scene, and the label of those that miss it."""

import numpy as np

from contactlab.contact import Floats
from contactlab.errors import SceneError, did_you_mean
from contactlab.measure.context import Context, cached
from contactlab.measure.entries import (
    ORACLES,
    Finding,
    Findings,
    MeasuredRuns,
    OracleResult,
    label,
    metric,
    runs_where,
)


@metric(unit="any", kind="detail", heading="expected")
def oracle_expected(context: Context) -> Floats:
    """Expected value by the scene's closed form, in the unit of that oracle."""
    return _result(context).expected


@metric(unit="any", kind="detail", heading="measured")
def oracle_measured(context: Context) -> Floats:
    """Measured value of what the scene's closed form expects, in the same unit."""
    return _result(context).measured


@metric(unit="any", better="lower", resolution=1e-9, equivalence=True)
def oracle_error(context: Context) -> Floats:
    """Error against the scene's closed form.

    As a share of the expected value or in its unit, as the oracle defines. It includes the
    modelling error of soft contact, which no timestep removes, and the discretisation error.
    """
    return _result(context).error


@label(severity=16)
def oracle_miss(runs: MeasuredRuns) -> Findings:
    """The error against the scene's closed form exceeds the limit, or nothing could be measured."""
    setup, metrics = runs.context.setup, runs.metrics
    error = metrics["oracle_error"]
    unmet = np.isfinite(metrics["oracle_expected"]) & np.isnan(metrics["oracle_measured"])
    unmet &= np.isfinite(setup.oracle_tolerance)
    return {
        run: Finding(
            f"{setup.oracle}: expected {metrics['oracle_expected'][run]:.4g}, measured "
            f"{metrics['oracle_measured'][run]:.4g}, error {error[run]:.3g} "
            f"(limit {setup.oracle_tolerance:g})",
            runs.context.trace.steps - 1,
        )
        for run in runs_where(unmet | (error > setup.oracle_tolerance))
    }


@cached
def _result(context: Context) -> OracleResult:
    name = context.setup.oracle
    if name is None:
        return OracleResult(context.undefined(), context.undefined(), context.undefined())
    if name not in ORACLES:
        known = ", ".join(ORACLES)
        raise SceneError(f"no oracle '{name}'{did_you_mean(name, ORACLES)}; there are {known}")
    return ORACLES[name].of(context)
