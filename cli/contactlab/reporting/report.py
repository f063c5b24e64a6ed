"""A store's page and figures: what is asked for, what is read of the store, and the files."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from contactlab.errors import OutputError, StoreError, optional
from contactlab.pareto.analysis import ToleranceTable, analyse, tolerance_table
from contactlab.pareto.criteria import Criteria
from contactlab.plugins import extensions
from contactlab.reporting.map_axes import MapAxes, most_informative_axes
from contactlab.reporting.report_columns import (
    GridAxis,
    Quantity,
    RunLabels,
    read_axes,
    read_quantities,
    read_run_labels,
)
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.atomic_files import atomic_write
from contactlab.store.finished_store import Store

FORMATS = ("png", "svg", "pdf")
_DEFAULT_CRITERIA = Criteria()


@dataclass(frozen=True)
class PageRequest:
    """What a page holds: the time series of some runs, and a comparison with any baseline.

    The criteria say which error stands for accuracy, and replace tolerances of the sweep. A page
    that would be larger than `most_bytes` has aggregated cells in place of runs. `parity` is a file
    that `contactlab parity --format json` wrote.
    """

    criteria: Criteria = _DEFAULT_CRITERIA
    traces: int = 60
    most_bytes: int = 25_000_000
    baseline: Store | None = None
    parity: Path | None = None


@dataclass(frozen=True)
class ReportData:
    """What a report draws of a store: over its two most informative axes, if it has any.

    Without an error there is no trade-off of accuracy and time, and `no_tradeoff` says why.
    """

    store: Store
    axes: tuple[GridAxis, ...]
    labels: RunLabels
    quantities: tuple[Quantity, ...]
    map_axes: MapAxes | None
    tradeoff: TradeoffReport | None
    no_tradeoff: str

    def quantities_named(self, *names: str) -> list[Quantity]:
        """Return the quantities of these names, as far as the store has them."""
        return [each for each in self.quantities if each.name in names]

    def tolerance_table(self) -> ToleranceTable | None:
        """Return what the page evaluates other tolerances from; None without a trade-off."""
        if self.tradeoff is None:
            return None
        names = dict.fromkeys((*(each.name for each in self.quantities), *self.tradeoff.tolerances))
        return tolerance_table(self.store, self.tradeoff, tuple(names))


def read_report_data(store: Store, criteria: Criteria = _DEFAULT_CRITERIA) -> ReportData:
    """Read what a report draws of a store.

    A SweepFileError says that the criteria name what the store does not have, a StoreError that it
    has no value of the error that is asked for.
    """
    axes, labels = read_axes(store), read_run_labels(store)
    report, reason = None, ""
    try:
        report = analyse(store, criteria)
    except StoreError as error:
        if criteria.error is not None:
            raise
        reason = str(error)
    map_axes, quantities = most_informative_axes(axes, labels), read_quantities(store)
    return ReportData(store, axes, labels, quantities, map_axes, report, reason)


_DEFAULT_PAGE = PageRequest()


def write_page(store: Store, target: Path, request: PageRequest = _DEFAULT_PAGE) -> tuple[str, ...]:
    """Write a store as one HTML page that needs no other file and no network.

    The same store gives the same bytes; notes say what the page leaves out. Besides the errors of
    `read_report_data`, an OutputError says that a library is missing, or what cannot be written.
    """
    with optional("figures", "a report"):
        html_page = extensions("page")["html"].load()
    text, notes = html_page(store, request)
    with atomic_write(target) as temporary:
        temporary.write_bytes(text.encode())
    return notes


def write_figures(
    store: Store,
    folder: Path,
    formats: Sequence[str],
    criteria: Criteria = _DEFAULT_CRITERIA,
    width: str | None = None,
) -> tuple[list[Path], dict[str, str]]:
    """Write every figure for which a store has the data as png, svg or pdf.

    Returns the files, and why there is none of the other figures. The same store gives the same
    bytes. A width, as in `85mm`, lays them out for paper. Besides the errors of `read_report_data`,
    an OutputError says that a format is unknown, the width is none, a library is missing, or what
    cannot be written.
    """
    for form in formats:
        if form not in FORMATS:
            raise OutputError(f"unknown format '{form}'; choose from {', '.join(FORMATS)}")
    with optional("figures", "a report"):
        figure_files = extensions("page")["figures"].load()
    files, missing = figure_files(read_report_data(store, criteria), formats, width)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make {folder}: {error.strerror}") from error
    for name, content in files.items():
        with atomic_write(folder / name) as temporary:
            temporary.write_bytes(content)
    return [folder / name for name in files], missing
