"""What a page tells of a run beside its numbers."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from contactlab.errors import StoreError
from contactlab.report.packing import pack, real, whole
from contactlab.report.series import RunSeries, run_series
from contactlab.schema import EvidenceRecord
from contactlab.store import Store, from_row

_BITS = 12


def records(store: Store, rows: Sequence[int]) -> dict[int, EvidenceRecord]:
    """Return the records of some rows."""
    columns = store.columns
    return {row: from_row(columns.row(row), columns.shared) for row in sorted(rows)}


def told(record: EvidenceRecord) -> dict[str, Any]:
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
        return run_series(store.trace(record))
    except StoreError:
        # A damaged trace is what `contactlab verify` is for; the page shows the others.
        return None


def _described(row: int, series: RunSeries, columns: dict[str, np.ndarray]) -> dict[str, Any]:
    for index, signal in enumerate(series.signals):
        columns[f"{row}:t{index}"] = real(signal.time, _BITS)
        columns[f"{row}:v{index}"] = real(signal.values, _BITS)
    for index, ribbon in enumerate(series.ribbons):
        columns[f"{row}:s{index}"] = real(ribbon.starts, _BITS)
        columns[f"{row}:m{index}"] = whole(ribbon.modes)
    return {
        "signals": [[each.name, each.unit, each.panel] for each in series.signals],
        "ribbons": [[each.pair, each.end] for each in series.ribbons],
    }
