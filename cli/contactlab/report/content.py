"""What the script of a page is given: names and words as JSON, numbers packed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.report.asking import PageAsk
from contactlab.report.charts import templates
from contactlab.report.details import packed_series, records, told
from contactlab.report.gathering import Gathered
from contactlab.report.grid import GridAxis
from contactlab.report.packing import ids, pack, real, whole
from contactlab.report.picks import picked
from contactlab.report.sums import summed_axes, sums
from contactlab.report.weighing import Weighing
from contactlab.store import Store
from contactlab.tradeoff import mjcf_lines

_FEW = 5_000
_SHORT = 11
_MOST_LINES = 200
# Bytes that a run takes, and each of its numbers, once compressed.
_RUN, _VALUE = 12.0, 2.2
_PER_LABEL = 50
_FEW_PICKS = 12


@dataclass(frozen=True)
class Content:
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


def content(gathered: Gathered, ask: PageAsk, chart: dict[str, Any] | None) -> Content:
    """Return what the script of a page is given.

    Where all runs would take more room than the page may have, it is given every cell of every
    map instead, and some runs only.
    """
    report = gathered.weighing.report if gathered.weighing else None
    is_summed = _needed(gathered) > ask.most_bytes
    traces = min(ask.traces, _FEW_PICKS) if is_summed else ask.traces
    picks = picked(gathered.store, gathered.outcomes, gathered.plane, report, traces)
    rows = _kept(gathered, picks) if is_summed else np.arange(gathered.store.columns.runs)
    places = dict(zip(rows.tolist(), range(len(rows)), strict=True)) if is_summed else None
    found = records(gathered.store, picks)
    found = {places[row] if places else row: record for row, record in found.items()}
    axes = summed_axes(gathered.axes) if is_summed else gathered.axes
    columns = _columns(gathered, axes, rows)
    if is_summed:
        columns |= sums(axes, gathered.outcomes, gathered.quantities)
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
        "specs": templates(gathered, chart),
        "tradeoff": _weighed(gathered.store, gathered.weighing) if gathered.weighing else None,
        "details": {row: told(record) for row, record in found.items()},
    }
    notes = (_summed_note(gathered, len(rows)),) if is_summed else ()
    return Content(words, pack(columns), packed_series(gathered.store, found), notes)


def _needed(gathered: Gathered) -> float:
    """Return about how much room all runs would take [B]."""
    width = _RUN + _VALUE * len(gathered.quantities)
    return 4 / 3 * width * gathered.store.columns.runs


def _kept(gathered: Gathered, picks: Sequence[int]) -> NDArray[np.int64]:
    """Return the runs that a page has beside sums: some of each label, one of each cell."""
    outcomes = gathered.outcomes
    kept = [
        np.flatnonzero(outcomes.codes == code)[:_PER_LABEL] for code in range(len(outcomes.names))
    ]
    if gathered.plane is not None:
        kept.append(np.unique(gathered.plane.cells, return_index=True)[1])
    return np.unique(np.concatenate([np.array(picks, dtype=np.int64), *kept]))


def _summed_note(gathered: Gathered, kept: int) -> str:
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


def _labels(gathered: Gathered) -> dict[str, Any]:
    outcomes = gathered.outcomes
    return {
        "names": outcomes.names,
        "letters": outcomes.letters,
        "legend": outcomes.legend,
        "every": outcomes.every,
    }


def _boundary(gathered: Gathered) -> dict[str, Any] | None:
    boundary = gathered.boundary
    if boundary is None:
        return None
    return {"axis": boundary.axis.name, "marks": boundary.axis.marks.tolist()}


def _plane(gathered: Gathered) -> list[str | None]:
    plane = gathered.plane
    if plane is None:
        return [None, None]
    return [plane.x.name, plane.y.name if plane.y else None]


def _columns(
    gathered: Gathered, axes: Sequence[GridAxis], rows: NDArray[np.int64]
) -> dict[str, NDArray[Any]]:
    """Return the columns of some runs, and of the configurations."""
    store, outcomes = gathered.store, gathered.outcomes
    bits = 23 if len(rows) <= _FEW else _SHORT
    columns: dict[str, NDArray[Any]] = {
        "id": ids(store.columns.keys("run_id")[rows]),
        "label": whole(outcomes.codes[rows]),
        "labels": (outcomes.masks[rows] & 0xFFFFFFFF).astype("u4"),
        "labels:high": (outcomes.masks[rows] >> 32).astype("u4"),
        "met": whole(_met(gathered)[rows]),
    }
    if gathered.boundary is not None:
        columns["boundary"] = real(gathered.boundary.values[rows])
    for axis in axes:
        columns[f"axis:{axis.name}"] = whole(axis.codes[rows])
        if axis.numbers is not None:
            columns[f"number:{axis.name}"] = real(axis.numbers[rows])
    for each in gathered.quantities:
        columns[f"value:{each.name}"] = real(each.values[rows], bits)
    if gathered.weighing is not None:
        columns |= _weighed_columns(gathered.weighing, rows, bits)
    return columns


def _met(gathered: Gathered) -> NDArray[np.int64]:
    """Return (n,) 2 where a run is as expected, 1 where it is not, 0 where nothing was expected."""
    met, given = gathered.store.columns.numbers("expectation_met")
    return np.where(given, np.nan_to_num(met) + 1, 0).astype(np.int64)


def _weighed_columns(
    weighing: Weighing, rows: NDArray[np.int64], bits: int
) -> dict[str, NDArray[Any]]:
    report = weighing.report
    configurations = report.configurations
    exact = {report.error.name, *report.tolerances}
    return {
        "place": whole(weighing.places[rows]),
        "sound": whole(weighing.sound),
        "time": _numbers([each.time for each in configurations]),
        "error": _numbers([each.error for each in configurations]),
        **{
            f"worst:{name}": sizes if name in exact else real(sizes, bits)
            for name, sizes in weighing.worst.items()
        },
    }


def _numbers(values: list[float | None]) -> NDArray[np.float64]:
    return np.array([np.nan if value is None else value for value in values])


def _weighed(store: Store, weighing: Weighing) -> dict[str, Any]:
    report = weighing.report
    return {
        "knobs": report.knobs,
        "configurations": [list(each.configuration.values()) for each in report.configurations],
        "error": [report.error.name, report.error.unit],
        "tolerances": report.tolerances,
        "mjcf": _mjcf(store, weighing),
    }


def _mjcf(store: Store, weighing: Weighing) -> list[str] | None:
    """Return the lines that set each configuration, where there are not too many."""
    report = weighing.report
    count = len(report.configurations)
    if count > _MOST_LINES:
        return None
    firsts = np.unique(weighing.places, return_index=True)[1].tolist()
    found = records(store, firsts)
    return ["\n".join(mjcf_lines(report.knobs, found[row]).mjcf) for row in firsts]
