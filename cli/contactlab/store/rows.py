"""Between an EvidenceRecord and the flat row that the journal and the table hold of it."""

import json
from collections.abc import Mapping
from typing import Any

from pydantic_core import to_json

from contactlab.schema import Accuracy, EvidenceRecord, Timing

# What every run of a store has in common; in the table it is said once, in the file's metadata.
SHARED = ("schema_version", "sweep", "units", "metric_versions")
# Open-ended tables within a row; kept as JSON text, which every reader of Parquet can show.
_TEXT = ("pairs", "warnings", "provenance", "effect_reasons", "effects_missed")
_PLAIN = (
    "run_id",
    "index",
    "scene",
    "scene_hash",
    "seed",
    "label",
    "trajectory_hash",
    "expectation_met",
    "expectation_reason",
    "tolerances_met",
    "knife_edge",
    "status",
    "status_reason",
    "steps",
    "steps_asked",
    "duration",
    "settings",
    "effects",
    "started",
    "finished",
)
_ENGINE = ("name", "version")
_INITIAL = ("qpos", "qvel", "ctrl", "applied")
_COST = ("cpu_s", "cpu_per_sim_s", "latency_budget_s", "latency_used")
_TRACE = ("file", "sha256", "bytes")
_ACCURACY = tuple(Accuracy.model_fields)
_TIMING = tuple(Timing.model_fields)

Row = dict[str, Any]


def to_row(record: EvidenceRecord) -> Row:
    """Return a record as a flat row: axes and metrics by their own names beside its fields."""
    row: Row = {name: getattr(record, name) for name in _PLAIN}
    row |= {name: _encoded(getattr(record, name)) for name in _TEXT}
    row |= {f"engine_{name}": getattr(record.engine, name) for name in _ENGINE}
    row |= _label_columns(record)
    row["expected"] = record.expected
    row["edited_geoms"] = record.edited_geoms
    row |= {f"initial_{name}": getattr(record.initial, name) for name in _INITIAL}
    row |= {f"cost_{name}": getattr(record.cost, name, None) for name in _COST}
    row |= {name: getattr(record.accuracy, name, None) for name in _ACCURACY}
    row |= {name: getattr(record.timing, name, None) for name in _TIMING}
    row |= {f"trace_{name}": getattr(record.trace, name, None) for name in _TRACE}
    row["trace_messages"] = None if record.trace is None else _encoded(record.trace.messages)
    row["axis_names"] = tuple(record.axes)
    return row | record.axes | record.metrics


def from_row(row: Mapping[str, Any], shared: Mapping[str, Any]) -> EvidenceRecord:
    """Return the record that a row and its store's shared part came from."""
    data: Row = {name: row[name] for name in _PLAIN}
    data |= {name: json.loads(row[name]) for name in _TEXT}
    data |= {name: shared[name] for name in SHARED}
    data["engine"] = {name: row[f"engine_{name}"] for name in _ENGINE}
    # The column has the settings of every run; those of some runs only are empty in others.
    data["settings"] = {name: each for name, each in row["settings"].items() if each is not None}
    data["labels"] = [
        {"label": label, "reason": reason, "step": step}
        for label, reason, step in zip(
            row["labels"], row["label_reasons"], row["label_steps"], strict=True
        )
    ]
    data["expected"], data["edited_geoms"] = row["expected"], row["edited_geoms"]
    data["initial"] = {name: row[f"initial_{name}"] for name in _INITIAL}
    if row["cost_cpu_s"] is not None:
        data["cost"] = {name: row[f"cost_{name}"] for name in _COST}
    if row["error_kind"] is not None:
        data["accuracy"] = {name: row[name] for name in _ACCURACY}
    if row["timing_settings"] is not None:
        data["timing"] = {name: row[name] for name in _TIMING}
    if row["trace_file"] is not None:
        data["trace"] = {name: row[f"trace_{name}"] for name in _TRACE}
        data["trace"]["messages"] = json.loads(row["trace_messages"])
    data["axes"] = {name: row[name] for name in row["axis_names"]}
    data["metrics"] = {name: row[name] for name in shared["units"]}
    return EvidenceRecord.model_validate(data)


def _label_columns(record: EvidenceRecord) -> Row:
    worst = record.labels[0] if record.labels else None
    return {
        "labels": tuple(entry.label for entry in record.labels),
        "label_reasons": tuple(entry.reason for entry in record.labels),
        "label_steps": tuple(entry.step for entry in record.labels),
        "label_reason": worst.reason if worst else None,
        "label_step": worst.step if worst else None,
    }


def _encoded(value: object) -> str:
    return to_json(value).decode()
