"""The order of the runs of a label: the worst first, by the metrics that the label is judged on."""

import numpy as np
from numpy.typing import NDArray

from contactlab.measure import LABELS, THRESHOLDS
from contactlab.measure.run_integrity import STABLE
from contactlab.store.finished_store import Store

_DEPTH = "penetration_max"
Rows = NDArray[np.integer]


def order_worst_first(store: Store, label: str, rows: Rows) -> Rows:
    """Return the order of some rows of a label's runs: the worst first, equal ones unchanged.

    The runs farthest beyond a known limit, relative to it, come first. Those below all known
    limits follow, by a metric with a limit that depends on the scene. The stable run with
    the deepest contact comes first.
    """
    if label == STABLE.name:
        if _DEPTH not in store.columns.metric_columns:
            return np.arange(len(rows))
        # Runs without a contact have NaN, which sorts last.
        return np.argsort(-store.columns.numbers(_DEPTH).values[rows], kind="stable")
    beyond, other, below = np.full((3, len(rows)), -np.inf)
    stated = store.manifest.sweep.resolved.get("thresholds") or {}
    for name, limit_name in LABELS[label].measures if label in LABELS else ():
        column = store.columns.metric_columns.get(name)
        if column is None:
            continue
        values = store.columns.numbers(name).at(rows).values
        usual = THRESHOLDS[limit_name].default if limit_name in THRESHOLDS else None
        limit = stated.get(limit_name, usual)
        is_least = column.better == "higher"
        if not limit:
            other = np.fmax(other, -values if is_least else values)
            continue
        with np.errstate(divide="ignore"):
            parts = limit / values if is_least else values / limit
        below = np.fmax(below, parts)
        beyond = np.fmax(beyond, np.where(parts > 1, parts, -np.inf))
    return np.lexsort((-below, -other, -beyond))


def worst_first(store: Store, rows: Rows) -> Rows:
    """Return rows in the order of their runs' worst labels, and of each label the worst first."""
    codes, names = store.columns.read_codes("label")
    order = {name: rank for rank, name in enumerate(LABELS)}
    sorted_rows = list[Rows]()
    for name in sorted(names, key=lambda name: order.get(str(name), -1)):
        own = rows[codes[rows] == names.index(name)]
        sorted_rows.append(own[order_worst_first(store, str(name), own)])
    return np.concatenate([rows[:0], *sorted_rows])
