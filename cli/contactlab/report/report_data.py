"""What a page should hold, and what was written."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats
from contactlab.errors import StoreError
from contactlab.report.map_boundary import Boundary, read_boundary
from contactlab.report.map_cells import MapAxes, most_informative_axes
from contactlab.report.report_columns import (
    Codes,
    GridAxis,
    Quantity,
    RunLabels,
    read_axes,
    read_quantities,
    read_run_labels,
)
from contactlab.schema import TradeoffReport
from contactlab.store import Store
from contactlab.tradeoff import ESTIMATES, Criteria, analyse

DEFAULT_TRACES = 60
MOST_BYTES = 25_000_000
_DEFAULT = Criteria()


@dataclass(frozen=True)
class PageRequest:
    """What a page should hold.

    Attributes:
        question: which error stands for accuracy, and tolerances over those of the sweep.
        traces: of how many runs to give the time series.
        most_bytes: above this size sums over runs stand for runs [B].
        baseline: a store to compare with; None for none.
    """

    question: Criteria = _DEFAULT
    traces: int = DEFAULT_TRACES
    most_bytes: int = MOST_BYTES
    baseline: Store | None = None


@dataclass(frozen=True)
class WrittenPage:
    """A page that was written.

    Attributes:
        bytes: its size [B].
        notes: what it leaves out.
    """

    bytes: int
    notes: tuple[str, ...]


@dataclass(frozen=True)
class StoreTradeoff:
    """A trade-off over c configurations of n runs.

    Attributes:
        report: what `contactlab tradeoff` says.
        places: (n,) the configuration of each run.
        worst: metric to (c,) largest size over a configuration's runs, NaN if a run has none.
        sound: (c,) whether a configuration is feasible but for its tolerances.
    """

    report: TradeoffReport
    places: Codes
    worst: dict[str, Floats]
    sound: NDArray[np.bool_]


def evaluate_store(store: Store, question: Criteria) -> tuple[TradeoffReport | None, str]:
    """Return the trade-off of a store; without one, why there is none."""
    try:
        return analyse(store, question), ""
    except StoreError as error:
        if question.error is not None:
            raise
        return None, str(error)


def evaluation_columns(
    store: Store, report: TradeoffReport, quantities: tuple[Quantity, ...]
) -> StoreTradeoff:
    """Return the largest size of every quantity in every configuration, as a trade-off has it."""
    places = _places(store, report.knobs)
    count = len(report.configurations)
    cases = _places(store, (*report.scenarios, "seed"))
    pairs = np.unique(np.stack([places, cases], 1), axis=0)
    full = np.bincount(pairs[:, 0], minlength=count) == len(np.unique(cases))
    stable = np.array([set(each.outcomes.labels) == {"stable"} for each in report.configurations])
    timed = np.array([each.time is not None for each in report.configurations])
    order = np.argsort(places, kind="stable")
    starts = np.searchsorted(places[order], np.arange(count))
    sizes = {each.name: _sizes(store, each) for each in quantities}
    unknown = [name for name in report.tolerances if name not in sizes]
    sizes |= {name: np.abs(store.columns.numbers(name).values) for name in unknown}
    worst = {name: np.maximum.reduceat(each[order], starts) for name, each in sizes.items()}
    return StoreTradeoff(report, places, worst, full & stable & timed)


def _sizes(store: Store, quantity: Quantity) -> Floats:
    """Return sizes as tolerances are held against them.

    An error is at least what its reference may be off by.
    """
    sizes = np.abs(quantity.values)
    estimate = ESTIMATES.get(quantity.name)
    if estimate is None or estimate not in store.columns.schema.names:
        return sizes
    return np.maximum(sizes, np.nan_to_num(store.columns.numbers(estimate).values))


def _places(store: Store, names: tuple[str, ...]) -> Codes:
    """Return (n,) which combination of values each run has, numbered as they first occur."""
    codes = np.zeros(store.columns.runs, dtype=np.int64)
    for name in names:
        if store.columns.is_number(name):
            _, own = np.unique(store.columns.numbers(name).values, return_inverse=True)
        else:
            own = store.columns.strings(name).codes + 1
        _, codes = np.unique(codes * (int(own.max()) + 1) + own, return_inverse=True)
    _, firsts, inverse = np.unique(codes, return_index=True, return_inverse=True)
    ranks = np.empty(len(firsts), dtype=np.int64)
    ranks[np.argsort(firsts)] = np.arange(len(firsts))
    return ranks[inverse]


@dataclass(frozen=True)
class ReportData:
    """A store as a report sees it.

    Attributes:
        store: the store.
        axes: the axes that differ between its runs.
        outcomes: the labels of its runs.
        quantities: what was measured of them.
        plane: the two axes that tell most; None without axes.
        boundary: the line that the scene's closed form draws through maps; None without.
        weighing: accuracy against time; None where the store has no error.
        unweighed: why there is none.
    """

    store: Store
    axes: tuple[GridAxis, ...]
    outcomes: RunLabels
    quantities: tuple[Quantity, ...]
    plane: MapAxes | None
    boundary: Boundary | None
    weighing: StoreTradeoff | None
    unweighed: str


def read_report_data(store: Store, question: Criteria = _DEFAULT) -> ReportData:
    """Read what a report of a store needs.

    Raises:
        SweepFileError: the question names what the store does not have.
        StoreError: the store has no value of the error that is asked for.
    """
    axes, outcomes = read_axes(store), read_run_labels(store)
    quantities = read_quantities(store)
    report, unweighed = evaluate_store(store, question)
    return ReportData(
        store=store,
        axes=axes,
        outcomes=outcomes,
        quantities=quantities,
        plane=most_informative_axes(axes, outcomes),
        boundary=read_boundary(store, axes),
        weighing=evaluation_columns(store, report, quantities) if report else None,
        unweighed=unweighed,
    )
