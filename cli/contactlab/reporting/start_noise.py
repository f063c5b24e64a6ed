"""The noise floor of a metric: its change by noise of the start alone."""

from collections.abc import Sequence

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.reporting.report_columns import SEED, Codes, GridAxis, exact_codes
from contactlab.schema.tradeoff_report import REALITY
from contactlab.store.run_columns import RunColumns

PERTURBATION = "perturbation"


def distance_to_reality(axes: Sequence[GridAxis], columns: RunColumns) -> str:
    """Return the distance of runs to recordings, and its noise floor; empty without recordings."""
    values = columns.numbers(REALITY).values if REALITY in columns.metric_columns else np.zeros(0)
    if not np.isfinite(values).any():
        return ""
    floor = start_noise(axes, values)
    noise = f"; noise of the start alone moves a run by {floor:.3g}" if floor else ""
    return f"{REALITY} is {np.nanmean(values):.3g} on average{noise}"


def start_noise(axes: Sequence[GridAxis], values: Floats) -> float | None:
    """Return the mean distance of values (n,) of runs that differ in seed or perturbation only."""
    return noise_floor(code_alike_runs(axes, len(values)), values)


def code_alike_runs(axes: Sequence[GridAxis], runs: int) -> Codes:
    """Return (runs,) one number for all runs that differ in seed or perturbation only."""
    others = [axis for axis in axes if axis.name not in (SEED, PERTURBATION)]
    codes = exact_codes(others, runs)
    return codes.astype(np.min_scalar_type(codes.max(initial=0)))


def noise_floor(alike: Codes, values: Floats) -> float | None:
    """Return the mean distance of values (n,) that have the same code, or None if no two have.

    It is that of all pairs of a code, averaged over codes.
    """
    order, floors = np.argsort(alike, kind="stable"), list[float]()
    for group in np.split(values[order], np.flatnonzero(np.diff(alike[order])) + 1):
        own = np.sort(group[np.isfinite(group)])
        if (count := len(own)) > 1:
            # The k-th of m sorted values is added k times, and subtracted m - 1 - k times.
            times = 2 * np.arange(count) - count + 1
            floors.append(float(times @ own) / (count * (count - 1) / 2))
    return float(np.mean(floors)) if floors else None
