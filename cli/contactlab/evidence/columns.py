"""The columns of `runs.parquet`: type, unit and description."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import pyarrow as pa

_TEXT = pa.string()
_REAL = pa.float64()
_WHOLE = pa.int64()
_TRUTH = pa.bool_()


@dataclass(frozen=True)
class Column:
    """One column of the table."""

    name: str
    type: pa.DataType
    unit: str
    description: str


FIXED = (
    Column("run_id", _TEXT, "", "hash of scene content, settings, seed and duration"),
    Column("index", _WHOLE, "1", "the run's place in the plan"),
    Column("scene", _TEXT, "", "scene's name"),
    Column("scene_hash", _TEXT, "", "hash of the scene's files"),
    Column("seed", _WHOLE, "1", "what perturbed the start state"),
    Column("duration", _REAL, "s", "simulated time asked for"),
    Column("label", _TEXT, "", "worst label"),
    Column("labels", pa.list_(_TEXT), "", "every label that applies, worst first"),
    Column("label_reason", _TEXT, "", "why the worst label applies"),
    Column("label_step", _WHOLE, "1", "step at which the worst label was first met"),
    Column("label_reasons", pa.list_(_TEXT), "", "why each label applies"),
    Column("label_steps", pa.list_(_WHOLE), "1", "step at which each label was first met"),
    Column("status", _TEXT, "", "ok, stopped, error, crashed or timeout"),
    Column("status_reason", _TEXT, "", "what ended the run, if it did not go through"),
    Column("steps", _WHOLE, "1", "steps made"),
    Column("steps_asked", _WHOLE, "1", "steps asked for"),
    Column("trajectory_hash", _TEXT, "", "SHA-256 of every state row"),
    Column("expected", pa.list_(_TEXT), "", "labels of which one was expected"),
    Column("expectation_met", _TRUTH, "", "whether what was expected came out"),
    Column("expectation_reason", _TEXT, "", "what was missed"),
    Column("tolerances_met", _TRUTH, "", "whether every tolerance of the sweep is met"),
    Column("knife_edge", _TRUTH, "", "whether a start 1e-6 away gives another label"),
    Column("cost_cpu_s", _REAL, "s", "thread CPU time of the stepping"),
    Column("cost_cpu_per_sim_s", _REAL, "1", "CPU seconds per simulated second"),
    Column("cost_latency_budget_s", _REAL, "s", "wall time a step may take"),
    Column("cost_latency_used", _REAL, "1", "mean CPU time of a step over the budget"),
    Column("effects", pa.struct([]), "", "engine switches"),
    Column("settings", pa.struct([]), "", "every resolved setting"),
    Column("initial_qpos", pa.list_(_REAL), "", "start configuration"),
    Column("initial_qvel", pa.list_(_REAL), "", "start velocity"),
    Column("initial_ctrl", pa.list_(_REAL), "", "constant control"),
    Column("initial_applied", pa.list_(_REAL), "", "constant force and torque on each body"),
    Column("pairs", _TEXT, "", "effective contact parameters of each pair, as JSON"),
    Column("edited_geoms", pa.list_(_TEXT), "", "geoms whose contact parameters were set"),
    Column("warnings", _TEXT, "", "engine warnings by name, as JSON"),
    Column("engine_name", _TEXT, "", "what computed the trajectory"),
    Column("engine_version", _TEXT, "", "its version"),
    Column("trace_file", _TEXT, "", "the run's MCAP file, relative to the store"),
    Column("trace_sha256", _TEXT, "", "its SHA-256"),
    Column("trace_bytes", _WHOLE, "B", "its size"),
    Column("trace_messages", _TEXT, "", "its messages by topic, as JSON"),
    Column("started", _TEXT, "", "UTC, ISO 8601"),
    Column("finished", _TEXT, "", "UTC, ISO 8601"),
    Column("provenance", _TEXT, "", "tool, host and versions, as JSON"),
    Column("axis_names", pa.list_(_TEXT), "", "names of the run's axis columns"),
)
RESERVED = frozenset(column.name for column in FIXED)


def table_schema(own: Sequence[Column]) -> pa.Schema:
    """Return the table's schema.

    Args:
        own: columns of axes and metrics, and of `settings` and `effects`, which say what is in
            them.
    """
    columns = {column.name: column for column in (*FIXED, *own)}
    return pa.schema([_field(column) for column in columns.values()])


def struct_column(name: str, values: Mapping[str, object]) -> Column:
    """Return the column of `settings` or `effects`, with the fields that these values need."""
    (placeholder,) = (column for column in FIXED if column.name == name)
    fields = [pa.field(inner, _type_of(value)) for inner, value in values.items()]
    return replace(placeholder, type=pa.struct(fields))


def axis_column(name: str, values: Sequence[object], unit: str, description: str) -> Column:
    """Return the column of an axis, typed by the values that it takes."""
    kinds = {type(value) for value in values}
    if kinds <= {bool}:
        kind = _TRUTH
    elif kinds <= {int}:
        kind = _WHOLE
    elif kinds <= {int, float}:
        kind = _REAL
    else:
        kind = _TEXT
    return Column(name, kind, unit, description)


def metric_column(name: str, unit: str, description: str) -> Column:
    """Return the column of a metric."""
    return Column(name, _REAL, unit, description)


def _field(column: Column) -> pa.Field:
    meta = {"unit": column.unit, "description": column.description}
    told = {key: text for key, text in meta.items() if text}
    return pa.field(column.name, column.type, metadata=told)


def _type_of(value: object) -> pa.DataType:
    if isinstance(value, bool):
        return _TRUTH
    if isinstance(value, int):
        return _WHOLE
    if isinstance(value, float):
        return _REAL
    return _TEXT if isinstance(value, str) else pa.list_(_REAL)
