"""Data for the script of a page: names and texts as JSON, numbers packed."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.charts import Spec, with_page_colours
from contactlab.errors import StoreError
from contactlab.measure import LABELS
from contactlab.page.inferred_cells import inferred_labels
from contactlab.page.map_cells import aggregated_axes, aggregated_columns
from contactlab.page.packing import (
    as_json,
    pack_columns,
    packed_integers,
    packed_text,
    rounded_floats,
    run_id_halves,
)
from contactlab.page.page_charts import MODE_NAMES, chart_templates
from contactlab.page.run_series import run_series
from contactlab.palette import mode_colour
from contactlab.pareto.analysis import ToleranceTable
from contactlab.pareto.recommendation import (
    EQUALLY_FAST,
    MORE_ACCURATE,
    SAFE_MARGIN,
    recommendable_places,
)
from contactlab.printable import Replacer
from contactlab.reporting.coverage_rows import coverage_rows
from contactlab.reporting.geom_names import load_geom_replacers
from contactlab.reporting.report import PageRequest, ReportData
from contactlab.reporting.report_columns import Codes, GridAxis, RunLabels, summary_metrics
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.finished_store import Store


@dataclass(frozen=True)
class _SelectionRules:
    """Which runs a page lists, and how many."""

    # Series of this number of runs of each label come first, others in the order of the plan last.
    series_per_label: int = 3
    other_series: int = 60
    series_if_aggregated: int = 12
    runs_per_label: int = 50
    most_metrics: int = 5
    # Up to this number of runs, numbers have all bits of single precision; above, three digits.
    most_precise_runs: int = 5_000


_RULES = _SelectionRules()


@dataclass(frozen=True)
class ScriptData:
    """Data of the script, as the texts of its elements, and notes on omitted data.

    These are names, texts and specifications; packed numbers; time series.
    """

    metadata: str
    columns: str
    series: str
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Selection:
    """The rows of the runs that a page lists, and the records of the runs with series.

    If all runs would take more bytes than allowed, the page has the cells of every map, and a
    selection of runs.
    """

    rows: Codes
    records: dict[int, EvidenceRecord]  # by place among the rows
    is_aggregated: bool
    axes: Sequence[GridAxis]


def script_data(data: ReportData, request: PageRequest, chart: Spec | None) -> ScriptData:
    """Return the data of a page's script."""
    # Bytes that a run takes, and each of its numbers, once compressed.
    bytes_per_run, bytes_per_value = 12.0, 2.2
    # The listed runs, those with series, and whether cells stand for the others.
    width = bytes_per_run + bytes_per_value * len(data.quantities.columns)
    stored = data.store.columns
    is_aggregated = 4 / 3 * width * stored.runs > request.most_bytes
    traces = min(request.traces, _RULES.series_if_aggregated) if is_aggregated else request.traces
    with_series = list(dict.fromkeys(_by_interest(data)))[:traces] if traces else []
    rows = _selected_runs(data, with_series) if is_aggregated else np.arange(stored.runs)
    places = {row: place for place, row in enumerate(rows.tolist())}
    places_shown = sorted(with_series)
    records = dict(
        zip(map(places.__getitem__, places_shown), data.store.records_at(places_shown), strict=True)
    )
    axes = aggregated_axes(data.axes) if is_aggregated else data.axes
    selection = _Selection(rows, records, is_aggregated, axes)
    table = data.tolerance_table()
    replacers = load_geom_replacers(data.store, selection.records)
    columns = _run_columns(data, selection, table)
    if selection.is_aggregated:
        columns |= aggregated_columns(selection.axes, data.labels, data.quantities)
    metadata = {
        "store": str(data.store.address),
        "runs": len(selection.rows),
        "total": data.store.columns.runs,
        "aggregated": selection.is_aggregated,
        **_page_names(data, selection.axes),
        # The page of an examination has no map.
        "specs": {} if request.examination else chart_templates(data, chart),
        "tradeoff": _tradeoff_data(data.tradeoff) if data.tradeoff and table else None,
        "details": {
            place: _run_details(record, replacers[place])
            for place, record in selection.records.items()
        },
    }
    total = data.store.columns.runs
    note = (
        f"{total:,} runs are too many for one page: each map covers all of them, over any two axes "
        f"and all values of the others; {len(selection.rows):,} single runs are listed"
    )
    return ScriptData(
        packed_text(as_json(metadata)),
        as_json(pack_columns(columns)),
        as_json(packed_series(data.store, selection.records, replacers)),
        (note,) if selection.is_aggregated else (),
    )


def _page_names(data: ReportData, axes: Sequence[GridAxis]) -> dict[str, Any]:
    """Return axes, labels, modes of contact and quantities, by the names that the script reads."""
    return {
        "axes": [
            {name: getattr(axis, name) for name in ("name", "title", "ticks", "role")}
            | {"binned": axis.numbers is not None, "amount": axis.amount_unit}
            for axis in axes
        ],
        "labels": {
            name: getattr(data.labels, name) for name in ("names", "letters", "legend", "every")
        }
        | {"colours": page_colours(data.labels)},
        "modes": [[name, mode_colour(mode)] for mode, name in MODE_NAMES.items()],
        "listed": listed_metrics(data),
        "quantities": [
            [column.name, column.unit, column.better, column.resolution, column.description]
            for column in data.quantities.columns
        ],
        "inferred": [
            {"shared": part.shared, "codes": part.codes.tolist()} for part in inferred_labels(data)
        ],
        "refined": [*data.boundaries.grid.axes] if data.boundaries else [],
        "mapAxes": [*data.map_axes.names, None][:2] if data.map_axes else [None, None],
    }


def page_colours(labels: RunLabels) -> list[str]:
    """Return the colors of labels as the page's style sheet has them, light or dark."""
    return with_page_colours({"colours": list(labels.colours)})["colours"]


def listed_metrics(data: ReportData) -> list[str]:
    """Return the metrics of lists of runs: the error, the time, and those of the summary.

    The first is that of the map if all runs are stable.
    """
    report = data.tradeoff
    first: tuple[str, ...] = ("backward_error",)
    if report is not None:
        first = (report.error.name, report.time.name, *report.tolerances)
    stored_names = {column.name for column in data.quantities.columns}
    metric_names = dict.fromkeys((*first, *summary_metrics()))
    return [name for name in metric_names if name in stored_names][: _RULES.most_metrics]


def _selected_runs(data: ReportData, with_series: Sequence[int]) -> Codes:
    """Return the runs of an aggregated page: some of each label, and one of each cell."""
    labels = data.labels
    codes = range(len(labels.names))
    selected: list[Codes] = [
        labels.worst_rows(data.store, code)[: _RULES.runs_per_label] for code in codes
    ]
    if data.map_axes is not None:
        selected.append(data.map_axes.firsts)
    return np.unique(np.concatenate([np.array(with_series, dtype=np.int64), *selected]))


def _by_interest(data: ReportData) -> Iterator[int]:
    """Yield the rows of runs, those first that a reader will ask for first; some more than once.

    The recommended ones come first, then a few of each label, the worst first, then one of each
    cell of the default map, then the others in the order of the plan.
    """
    columns, report = data.store.columns, data.tradeoff
    for run in (report.recommendation, report.robust) if report else ():
        if run is not None:
            place = columns.place_of(run.run_id)
            yield from () if place is None else (place,)
    for code in range(len(data.labels.names)):
        yield from data.labels.worst_rows(data.store, code)[: _RULES.series_per_label].tolist()
    if data.map_axes is not None:
        yield from np.sort(data.map_axes.firsts).tolist()
    yield from range(min(columns.runs, _RULES.other_series))


def _run_columns(
    data: ReportData, selection: _Selection, table: ToleranceTable | None
) -> dict[str, NDArray[Any]]:
    rows, labels = selection.rows, data.labels
    values, is_finite = data.store.columns.numbers("expectation_met").at(rows)
    masks = labels.masks[rows].astype(np.uint64)
    # 2 for a run as expected, 1 for one that is not, 0 without an expectation.
    expected = np.where(is_finite, np.nan_to_num(values) + 1, 0).astype(np.int64)
    # Bits of a mantissa: all of single precision, or enough for three digits.
    all_bits, few_bits = 23, 11
    bits = all_bits if len(rows) <= _RULES.most_precise_runs else few_bits
    columns: dict[str, NDArray[Any]] = {
        "id": run_id_halves(data.store.columns.read_ids()[rows]),
        "label": packed_integers(labels.codes[rows]),
        "rank": packed_integers(_worst_ranks(data, rows)),
        "labels": (masks & 0xFFFFFFFF).astype("u4"),
        "labels:high": (masks >> 32).astype("u4"),
        "expected": packed_integers(expected),
    }
    for axis in selection.axes:
        columns[f"axis:{axis.name}"] = packed_integers(axis.codes[rows])
        if axis.numbers is not None:
            columns[f"number:{axis.name}"] = rounded_floats(axis.numbers[rows])
    for quantity in data.quantities:
        columns[f"value:{quantity.name}"] = rounded_floats(quantity.values[rows], bits)
    if data.tradeoff is not None and table is not None:
        exact = {data.tradeoff.error.name, *data.tradeoff.tolerances}
        columns |= {
            "configuration": packed_integers(table.configuration[rows]),
            "otherwiseFeasible": packed_integers(table.otherwise_feasible),
            "time": np.array(
                [configuration.time for configuration in data.tradeoff.configurations],
                dtype=np.float64,
            ),
            "error": np.array(
                [configuration.error for configuration in data.tradeoff.configurations],
                dtype=np.float64,
            ),
            **{
                f"worst:{name}": worst if name in exact else rounded_floats(worst, bits)
                for name, worst in table.worst.items()
            },
        }
    return columns


def _worst_ranks(data: ReportData, rows: Codes) -> Codes:
    # (m,) the place of each row, the worst label first, and of each label the worst run.
    order = [data.labels.worst_rows(data.store, code) for code in range(len(data.labels.names))]
    ranks = np.empty(data.store.columns.runs, np.uint32)
    ranks[np.concatenate(order)] = np.arange(len(ranks), dtype=ranks.dtype)
    return np.argsort(np.argsort(ranks[rows]))


def _tradeoff_data(report: TradeoffReport) -> dict[str, Any]:
    recommendable = recommendable_places(report.configurations)
    return {
        "knobs": report.knobs,
        "configurations": [
            list(configuration.configuration.values()) for configuration in report.configurations
        ],
        "units": report.units,
        "error": [report.error.name, report.error.unit],
        "tolerances": report.tolerances,
        "baseline": report.baseline is not None,
        # Null if all are.
        "recommendable": recommendable if len(recommendable) < len(report.configurations) else None,
        "clamped": [place for place, one in enumerate(report.configurations) if one.solref_clamped],
        "equallyFast": EQUALLY_FAST,
        "equallyAccurate": MORE_ACCURATE,
        "safeMargin": SAFE_MARGIN,
    }


def _run_details(record: EvidenceRecord, replace_geoms: Replacer) -> dict[str, Any]:
    return {
        "labels": [
            [label.label, replace_geoms(label.reason), label.step] for label in record.labels
        ],
        "settings": record.settings | record.axes,
        "coverage": [
            [replace_geoms(text) for text in row]
            for row in (coverage_rows(record.coverage, record.pairs) if record.coverage else ())
        ],
        "expectation_reason": record.expectation_reason,
        "status": record.status,
        "steps": record.steps,
        "engine": f"{record.engine.name} {record.engine.version}",
        "trace": record.trace.file if record.trace else None,
        "breaching": [
            *dict.fromkeys(
                threshold.name
                for label in record.labels
                if label.label in LABELS
                for threshold in LABELS[label.label].thresholds
            )
        ],
        "friction": {
            replace_geoms(name): pair.friction[0]
            for name, pair in record.pairs.items()
            if pair.condim > 1
        },
    }


def packed_series(
    store: Store, records: dict[int, EvidenceRecord], replacers: dict[int, Replacer]
) -> dict[str, Any]:
    """Return the time series of the runs that have a trace: their names, and packed numbers."""
    descriptions: dict[int, Any] = {}
    columns: dict[str, np.ndarray] = {}
    for row, record in records.items():
        if record.trace is None or store.manifest.traces_left_out:
            continue
        # A note on the page names damaged traces; it shows the others.
        with suppress(StoreError):
            joints = record.coverage.joints if record.coverage else {}
            descriptions[row], series = run_series(store.trace(record), replacers[row], joints)
            columns |= {f"{row}:{name}": values for name, values in series.items()}
    return {"runs": descriptions, "packed": pack_columns(columns)}
