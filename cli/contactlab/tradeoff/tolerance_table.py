"""What the feasibility of every configuration follows from, under any tolerances."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats
from contactlab.schema import TradeoffReport
from contactlab.store import Store
from contactlab.tradeoff.configurations import (
    ResolvedCriteria,
    evaluate,
    magnitudes,
    read_runs,
)


@dataclass(frozen=True)
class ToleranceTable:
    """The c configurations of n runs without their tolerances.

    Attributes:
        configuration: (n,) the configuration of each run.
        worst: metric to (c,) what tolerances are compared with: its largest magnitude over a
            configuration's runs; NaN if a run has no value.
        otherwise_feasible: (c,) whether a configuration is feasible but for tolerances.
    """

    configuration: NDArray[np.int64]
    worst: Mapping[str, Floats]
    otherwise_feasible: NDArray[np.bool_]


def tolerance_table(store: Store, report: TradeoffReport, names: Sequence[str]) -> ToleranceTable:
    """Return the table from which other tolerances of a trade-off can be evaluated.

    Args:
        store: the store.
        report: its trade-off.
        names: metrics that may be tolerated.
    """
    runs = read_runs(store, (report.error.name, report.time.name, *names))
    evaluated = evaluate(runs, ResolvedCriteria(report.error, report.time, {}))
    order = np.concatenate([each.group.rows for each in evaluated])
    counts = np.array([len(each.group.rows) for each in evaluated])
    configuration = np.empty(len(order), dtype=np.int64)
    configuration[order] = np.repeat(np.arange(len(evaluated)), counts)
    starts = np.cumsum(counts) - counts
    return ToleranceTable(
        configuration=configuration,
        worst={name: np.maximum.reduceat(magnitudes(runs, order, name), starts) for name in names},
        otherwise_feasible=np.array([each.summary.feasible for each in evaluated]),
    )
