"""The noise floor of a metric: what noise of the start alone does to it."""

from collections.abc import Sequence

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.reporting.report_columns import SEED, Codes, GridAxis
from contactlab.schema.tradeoff_report import REALITY
from contactlab.store.run_columns import RunColumns

PERTURBATION = "perturbation"


def distance_to_reality(axes: Sequence[GridAxis], columns: RunColumns) -> str:
    """Return how far runs are from recordings, and their noise floor; empty if none has one."""
    values = columns.numbers(REALITY).values if REALITY in columns.measured else np.zeros(0)
    if not np.isfinite(values).any():
        return ""
    floor = start_noise(axes, values)
    noise = f"; noise of the start alone moves a run by {floor:.3g}" if floor else ""
    return f"{REALITY} is {np.nanmean(values):.3g} on average{noise}"


def start_noise(axes: Sequence[GridAxis], values: Floats) -> float | None:
    """Return how far values (n,) of runs are apart that differ in seed or perturbation only."""
    alike = np.zeros(len(values), np.int64)
    for axis in axes:
        if axis.name not in (SEED, PERTURBATION):
            places = axis.codes if axis.numbers is None else axis.numbers
            _, codes = np.unique(places, return_inverse=True)
            _, alike = np.unique(alike * len(codes) + codes, return_inverse=True)
    return noise_floor(alike, values)


def noise_floor(alike: Codes, values: Floats) -> float | None:
    """Return the mean distance of values (n,) that have the same code, or None if no two have.

    It is that of all pairs of a code, averaged over codes.
    """
    known = np.isfinite(values)
    alike, values = alike[known], values[known]
    order = np.lexsort((values, alike))
    _, first, counts = np.unique(alike[order], return_index=True, return_counts=True)
    # The k-th of m sorted values is added k times and subtracted m - 1 - k times.
    times = 2 * (np.arange(len(order)) - np.repeat(first, counts)) + 1 - np.repeat(counts, counts)
    apart = np.bincount(alike[order], times * values[order])[alike[order][first]]
    several = counts > 1
    pairs = counts[several] * (counts[several] - 1) / 2
    return float(np.mean(apart[several] / pairs)) if several.any() else None
