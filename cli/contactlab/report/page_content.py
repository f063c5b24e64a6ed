"""Which runs a page has the time series of."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.errors import StoreError
from contactlab.report.map_cells import MapAxes, aggregated_axes, aggregated_columns
from contactlab.report.packing import pack, packed_integers, rounded_floats, run_id_halves
from contactlab.report.page_charts import chart_templates
from contactlab.report.report_columns import GridAxis, RunLabels
from contactlab.report.report_data import PageRequest, ReportData, StoreTradeoff
from contactlab.report.run_series import RunSeries, read_run_series
from contactlab.schema import EvidenceRecord, TradeoffReport
from contactlab.store import Store, row_to_record
from contactlab.tradeoff import mjcf_lines

_SERIES_PER_LABEL = 3
_OTHERS = 60


def runs_with_series(
    store: Store,
    outcomes: RunLabels,
    plane: MapAxes | None,
    report: TradeoffReport | None,
    most: int,
) -> list[int]:
    """Return the rows of at most so many runs that a reader will ask for first.

    What is recommended comes first, then a few of each label, the worst ones first, then one of
    each cell of the default map, then the others in the order of the plan.
    """
    if not most:
        return []
    ids = store.columns.byte_strings("run_id")
    wanted = dict.fromkeys(_ordered(ids, outcomes, plane, report))
    return list(wanted)[:most]


def _ordered(
    ids: np.ndarray, outcomes: RunLabels, plane: MapAxes | None, report: TradeoffReport | None
) -> Iterator[int]:
    picks = [report.recommendation, report.robust] if report else []
    for pick in picks:
        if pick is not None:
            yield from np.flatnonzero(ids == pick.run_id.encode()).tolist()
    for code in range(len(outcomes.names)):
        yield from np.flatnonzero(outcomes.codes == code)[:_SERIES_PER_LABEL].tolist()
    if plane is not None:
        yield from np.sort(np.unique(plane.cells, return_index=True)[1]).tolist()
    yield from range(min(len(ids), _OTHERS))


_BITS = 12


def read_records(store: Store, rows: Sequence[int]) -> dict[int, EvidenceRecord]:
    """Return the records of some rows."""
    columns = store.columns
    return {row: row_to_record(columns.row(row), columns.shared) for row in sorted(rows)}


def run_details(record: EvidenceRecord) -> dict[str, Any]:
    """Return what a page tells of a run: its labels with their reasons, its settings, its trace."""
    return {
        "labels": [[each.label, each.reason, each.step] for each in record.labels],
        "settings": record.settings | record.axes,
        "expected": record.expected,
        "expectation_met": record.expectation_met,
        "expectation_reason": record.expectation_reason,
        "status": record.status,
        "steps": record.steps,
        "engine": f"{record.engine.name} {record.engine.version}",
        "pairs": {
            name: {"condim": pair.condim, "friction": pair.friction, "solref": pair.solref}
            for name, pair in record.pairs.items()
        },
        "trajectory": record.trajectory_hash,
        "trace": record.trace.file if record.trace else None,
    }


def packed_series(store: Store, found: dict[int, EvidenceRecord]) -> dict[str, Any]:
    """Return the time series of the runs that have a trace: what each is, and packed numbers."""
    described: dict[int, Any] = {}
    columns: dict[str, np.ndarray] = {}
    for row, record in found.items():
        series = _series(store, record)
        if series is not None:
            described[row] = _described(row, series, columns)
    return {"runs": described, "packed": pack(columns)}


def _series(store: Store, record: EvidenceRecord) -> RunSeries | None:
    if record.trace is None or store.manifest.traces_left_out:
        return None
    try:
        return read_run_series(store.trace(record))
    except StoreError:
        # A damaged trace is what `contactlab verify` is for; the page shows the others.
        return None


def _described(row: int, series: RunSeries, columns: dict[str, np.ndarray]) -> dict[str, Any]:
    for index, signal in enumerate(series.signals):
        columns[f"{row}:t{index}"] = rounded_floats(signal.time, _BITS)
        columns[f"{row}:v{index}"] = rounded_floats(signal.values, _BITS)
    for index, ribbon in enumerate(series.ribbons):
        columns[f"{row}:s{index}"] = rounded_floats(ribbon.starts, _BITS)
        columns[f"{row}:m{index}"] = packed_integers(ribbon.modes)
    return {
        "signals": [[each.name, each.unit, each.panel] for each in series.signals],
        "ribbons": [[each.pair, each.end] for each in series.ribbons],
    }


_FEW = 5_000
_SHORT = 11
_MOST_LINES = 200
# Bytes that a run takes, and each of its numbers, once compressed.
_RUN, _VALUE = 12.0, 2.2
_RUNS_PER_LABEL = 50
_FEW_PICKS = 12


@dataclass(frozen=True)
class PageContent:
    """What a page's script is given.

    Attributes:
        words: names, words and specifications.
        columns: numbers of runs and configurations, packed.
        series: time series of some runs, packed.
        notes: what is left out.
    """

    words: dict[str, Any]
    columns: dict[str, Any]
    series: dict[str, Any]
    notes: tuple[str, ...]


def page_content(
    gathered: ReportData, ask: PageRequest, chart: dict[str, Any] | None
) -> PageContent:
    """Return what the script of a page is given.

    Where all runs would take more room than the page may have, it is given every cell of every
    map instead, and some runs only.
    """
    report = gathered.weighing.report if gathered.weighing else None
    is_summed = _needed(gathered) > ask.most_bytes
    traces = min(ask.traces, _FEW_PICKS) if is_summed else ask.traces
    picks = runs_with_series(gathered.store, gathered.outcomes, gathered.plane, report, traces)
    rows = _kept(gathered, picks) if is_summed else np.arange(gathered.store.columns.runs)
    places = dict(zip(rows.tolist(), range(len(rows)), strict=True)) if is_summed else None
    found = read_records(gathered.store, picks)
    found = {places[row] if places else row: record for row, record in found.items()}
    axes = aggregated_axes(gathered.axes) if is_summed else gathered.axes
    columns = _columns(gathered, axes, rows)
    if is_summed:
        columns |= aggregated_columns(axes, gathered.outcomes, gathered.quantities)
    words = {
        "store": str(gathered.store.address),
        "runs": len(rows),
        "total": gathered.store.columns.runs,
        "summed": is_summed,
        "axes": [_axis(each) for each in axes],
        "labels": _labels(gathered),
        "quantities": [
            [each.name, each.told.unit, each.told.better, each.told.resolution, each.description]
            for each in gathered.quantities
        ],
        "plane": _plane(gathered),
        "boundary": _boundary(gathered),
        "digits": 6 if len(rows) <= _FEW else 3,
        "specs": chart_templates(gathered, chart),
        "tradeoff": _weighed(gathered.store, gathered.weighing) if gathered.weighing else None,
        "details": {row: run_details(record) for row, record in found.items()},
    }
    notes = (_summed_note(gathered, len(rows)),) if is_summed else ()
    return PageContent(words, pack(columns), packed_series(gathered.store, found), notes)


def _needed(gathered: ReportData) -> float:
    """Return about how much room all runs would take [B]."""
    width = _RUN + _VALUE * len(gathered.quantities)
    return 4 / 3 * width * gathered.store.columns.runs


def _kept(gathered: ReportData, picks: Sequence[int]) -> NDArray[np.int64]:
    """Return the runs that a page has beside sums: some of each label, one of each cell."""
    outcomes = gathered.outcomes
    kept = [
        np.flatnonzero(outcomes.codes == code)[:_RUNS_PER_LABEL]
        for code in range(len(outcomes.names))
    ]
    if gathered.plane is not None:
        kept.append(np.unique(gathered.plane.cells, return_index=True)[1])
    return np.unique(np.concatenate([np.array(picks, dtype=np.int64), *kept]))


def _summed_note(gathered: ReportData, kept: int) -> str:
    runs = gathered.store.columns.runs
    return (
        f"{runs:,} runs are more than fits: maps are of all of them, over any two axes and all "
        f"values of the others; single runs are here of {kept:,}"
    )


def _axis(axis: GridAxis) -> dict[str, Any]:
    return {
        "name": axis.name,
        "title": axis.title,
        "role": axis.role,
        "words": axis.words,
        "binned": axis.numbers is not None,
    }


def _labels(gathered: ReportData) -> dict[str, Any]:
    outcomes = gathered.outcomes
    return {
        "names": outcomes.names,
        "letters": outcomes.letters,
        "legend": outcomes.legend,
        "every": outcomes.every,
    }


def _boundary(gathered: ReportData) -> dict[str, Any] | None:
    boundary = gathered.boundary
    if boundary is None:
        return None
    return {"axis": boundary.axis.name, "marks": boundary.axis.marks.tolist()}


def _plane(gathered: ReportData) -> list[str | None]:
    plane = gathered.plane
    if plane is None:
        return [None, None]
    return [plane.x.name, plane.y.name if plane.y else None]


def _columns(
    gathered: ReportData, axes: Sequence[GridAxis], rows: NDArray[np.int64]
) -> dict[str, NDArray[Any]]:
    """Return the columns of some runs, and of the configurations."""
    store, outcomes = gathered.store, gathered.outcomes
    bits = 23 if len(rows) <= _FEW else _SHORT
    columns: dict[str, NDArray[Any]] = {
        "id": run_id_halves(store.columns.byte_strings("run_id")[rows]),
        "label": packed_integers(outcomes.codes[rows]),
        "labels": (outcomes.masks[rows] & 0xFFFFFFFF).astype("u4"),
        "labels:high": (outcomes.masks[rows] >> 32).astype("u4"),
        "met": packed_integers(_met(gathered)[rows]),
    }
    if gathered.boundary is not None:
        columns["boundary"] = rounded_floats(gathered.boundary.values[rows])
    for axis in axes:
        columns[f"axis:{axis.name}"] = packed_integers(axis.codes[rows])
        if axis.numbers is not None:
            columns[f"number:{axis.name}"] = rounded_floats(axis.numbers[rows])
    for each in gathered.quantities:
        columns[f"value:{each.name}"] = rounded_floats(each.values[rows], bits)
    if gathered.weighing is not None:
        columns |= _weighed_columns(gathered.weighing, rows, bits)
    return columns


def _met(gathered: ReportData) -> NDArray[np.int64]:
    """Return (n,) 2 where a run is as expected, 1 where it is not, 0 where nothing was expected."""
    met, given = gathered.store.columns.numbers("expectation_met")
    return np.where(given, np.nan_to_num(met) + 1, 0).astype(np.int64)


def _weighed_columns(
    weighing: StoreTradeoff, rows: NDArray[np.int64], bits: int
) -> dict[str, NDArray[Any]]:
    report = weighing.report
    configurations = report.configurations
    exact = {report.error.name, *report.tolerances}
    return {
        "place": packed_integers(weighing.places[rows]),
        "sound": packed_integers(weighing.sound),
        "time": _numbers([each.time for each in configurations]),
        "error": _numbers([each.error for each in configurations]),
        **{
            f"worst:{name}": sizes if name in exact else rounded_floats(sizes, bits)
            for name, sizes in weighing.worst.items()
        },
    }


def _numbers(values: list[float | None]) -> NDArray[np.float64]:
    return np.array([np.nan if value is None else value for value in values])


def _weighed(store: Store, weighing: StoreTradeoff) -> dict[str, Any]:
    report = weighing.report
    return {
        "knobs": report.knobs,
        "configurations": [list(each.configuration.values()) for each in report.configurations],
        "error": [report.error.name, report.error.unit],
        "tolerances": report.tolerances,
        "mjcf": _mjcf(store, weighing),
    }


def _mjcf(store: Store, weighing: StoreTradeoff) -> list[str] | None:
    """Return the lines that set each configuration, where there are not too many."""
    report = weighing.report
    count = len(report.configurations)
    if count > _MOST_LINES:
        return None
    firsts = np.unique(weighing.places, return_index=True)[1].tolist()
    found = read_records(store, firsts)
    return ["\n".join(mjcf_lines(report.knobs, found[row]).mjcf) for row in firsts]
