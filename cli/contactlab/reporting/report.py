"""A store's page and figures: the request, and the data that is read from the store."""

from dataclasses import dataclass
from pathlib import Path

from contactlab.errors import StoreError
from contactlab.pareto.analysis import ToleranceTable, analyze_tradeoff, tolerance_table
from contactlab.pareto.criteria import Criteria
from contactlab.reporting.boundaries import Boundaries, find_boundaries
from contactlab.reporting.map_axes import MapAxes, axes_named, most_informative_axes
from contactlab.reporting.report_columns import (
    GridAxis,
    Quantities,
    Quantity,
    RunLabels,
    read_axes,
    read_run_labels,
)
from contactlab.schema.examination import Examination
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.finished_store import Store

DEFAULT_CRITERIA = Criteria()


@dataclass(frozen=True)
class PageRequest:
    """Options of a page: the time series of some runs, and a comparison with any baseline.

    The criteria say which error stands for accuracy, and replace tolerances of the sweep. A page
    that would be larger than `most_bytes` has aggregated cells in place of runs. `parity` is a file
    that `contactlab parity --format json` wrote. With an `examination`, it is the page of a model,
    and the store has its runs. `grip` is a film of the examined grip, .gif.
    """

    criteria: Criteria = DEFAULT_CRITERIA
    traces: int = 60
    most_bytes: int = 25_000_000
    baseline: Store | None = None
    parity: Path | None = None
    examination: Examination | None = None
    grip: Path | None = None


@dataclass(frozen=True)
class ReportData:
    """Data that a report draws of a store, over its two most informative axes if it has any.

    Without an error there is no trade-off of accuracy and time, and `no_tradeoff` says why.
    """

    store: Store
    axes: tuple[GridAxis, ...]
    labels: RunLabels
    quantities: Quantities
    map_axes: MapAxes | None
    tradeoff: TradeoffReport | None
    no_tradeoff: str
    boundaries: Boundaries | None = None

    def quantities_named(self, *names: str) -> list[Quantity]:
        """Return the quantities of these names, as far as the store has them."""
        return [*self.quantities.select_named(names)]

    def tolerance_table(self) -> ToleranceTable | None:
        """Return the table for other tolerances on the page; None without a trade-off."""
        if self.tradeoff is None:
            return None
        names = dict.fromkeys(
            (*(column.name for column in self.quantities.columns), *self.tradeoff.tolerances)
        )
        return tolerance_table(self.store, self.tradeoff, tuple(names))


def read_report_data(store: Store, criteria: Criteria = DEFAULT_CRITERIA) -> ReportData:
    """Read the data that a report draws from a store.

    A SweepFileError says that the criteria name a column that the store lacks, a StoreError that
    the store has no value of the requested error.
    """
    axes, labels = read_axes(store), read_run_labels(store)
    report, reason = None, ""
    try:
        report = analyze_tradeoff(store, criteria)
    except StoreError as error:
        if criteria.metric is not None:
            raise
        reason = str(error)
    map_axes, quantities = most_informative_axes(axes, labels), Quantities.of(store.columns)
    boundaries = find_boundaries(store)
    if boundaries is not None:
        map_axes = axes_named(axes, tuple(boundaries.grid.axes)[:2]) or map_axes
    return ReportData(store, axes, labels, quantities, map_axes, report, reason, boundaries)
