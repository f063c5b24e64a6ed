"""The columns of `runs.parquet`, and how a record becomes one of its rows."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import pyarrow as pa
from pydantic_core import from_json, to_json

from contactlab.schema.evidence import Accuracy, Cost, Engine, EvidenceRecord, InitialState, Timing

_TEXT = pa.string()
REAL = pa.float64()
_WHOLE = pa.int64()
_TRUTH = pa.bool_()


@dataclass(frozen=True)
class Column:
    """One column of the table."""

    name: str
    type: pa.DataType
    unit: str  # its unit, `1` for counts and ratios, empty for text
    description: str
    better: str = ""  # lower, higher or none for a measured value; empty otherwise
    resolution: float = 0.0  # magnitude below which a measured value counts as 0, in its unit
    # Whether it is measured in the second pass, which a sweep may leave out.
    second_pass: bool = False


FIXED_COLUMNS = (
    Column("run_id", _TEXT, "", "hash of scene content, settings, seed and duration"),
    Column("index", _WHOLE, "1", "the run's place in the plan"),
    Column("scene", _TEXT, "", "scene's name"),
    Column("scene_hash", _TEXT, "", "hash of the scene's files"),
    Column("seed", _WHOLE, "1", "what perturbed the start state"),
    Column("duration", REAL, "s", "simulated time asked for"),
    Column("drive", _TEXT, "", "what drove the run, as JSON"),
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
    Column("cost_cpu_s", REAL, "s", "thread CPU time of the stepping"),
    Column("cost_cpu_per_sim_s", REAL, "1", "CPU seconds per simulated second", "lower"),
    Column("cost_latency_budget_s", REAL, "s", "wall time a step may take"),
    Column("cost_latency_used", REAL, "1", "mean CPU time of a step over the budget"),
    Column("error_final", REAL, "m", "distance from the reference at the end", "lower"),
    Column("error_mean", REAL, "m", "distance from the reference, mean over time", "lower"),
    Column("error_peak", REAL, "m", "distance from the reference, largest", "lower"),
    Column("error_estimate", REAL, "m", "what the reference itself may be off by", "lower"),
    Column("error_final_estimate", REAL, "m", "the same for the error at the end"),
    Column("error_mean_estimate", REAL, "m", "the same for the mean error"),
    Column("error_velocity", REAL, "m/s", "difference of velocities, mean over time", "lower"),
    Column("error_energy", REAL, "1", "difference of energy and momenta, mean over time", "lower"),
    Column("error_kind", _TEXT, "", "trajectory, local or invariants; the last have no unit"),
    Column("chaotic", _TRUTH, "", "whether a start 1e-8 away grows to the size of the errors"),
    Column("divergence", REAL, "m", "how far a start 1e-8 away gets from the reference"),
    Column("reference_integrator", _TEXT, "", "the reference's integrator"),
    Column("reference_timestep", REAL, "s", "the finest reference's timestep"),
    Column("impacts", _WHOLE, "1", "how often contacts began or ended in the run"),
    Column("solref_rule", _TEXT, "", "absolute, or tied to the timestep"),
    Column("solref_clamped", _TRUTH, "", "whether refsafe raised solref to two timesteps"),
    Column("time_min", REAL, "1", "CPU s per simulated s, least of the rounds", "lower"),
    Column("time_median", REAL, "1", "CPU s per simulated s, median of the rounds", "lower"),
    Column("step_p50", REAL, "s", "CPU time of a single step, median", "lower"),
    Column("step_p99", REAL, "s", "CPU time of a single step, 99th percentile", "lower"),
    Column("compile_time", REAL, "s", "CPU time to compile the model", "lower"),
    Column("work_steps", REAL, "1/s", "steps per simulated second", "lower"),
    Column("work_iterations", REAL, "1/s", "solver iterations per simulated second", "lower"),
    Column("work_contacts", REAL, "1/s", "contacts of all steps per simulated second", "lower"),
    Column("work_rows", REAL, "1/s", "constraint rows of all steps per simulated second", "lower"),
    Column("timing_settings", _TEXT, "", "hash of how times were measured"),
    Column("effects", pa.struct([]), "", "every effect, on or off"),
    Column("effect_reasons", _TEXT, "", "why each effect is on or off, as JSON"),
    Column(
        "effects_missed",
        _TEXT,
        "",
        "effects that are off although the run called for them, as JSON",
    ),
    Column("settings", pa.struct([]), "", "every resolved setting"),
    Column("initial_qpos", pa.list_(REAL), "", "start configuration"),
    Column("initial_qvel", pa.list_(REAL), "", "start velocity"),
    Column("initial_ctrl", pa.list_(REAL), "", "constant control"),
    Column("initial_applied", pa.list_(REAL), "", "constant force and torque on each body"),
    Column("pairs", _TEXT, "", "effective contact parameters of each pair, as JSON"),
    Column("edited_geoms", pa.list_(_TEXT), "", "geoms whose contact parameters were set"),
    Column("coverage", _TEXT, "", "what moved, was loaded and touched, as JSON"),
    Column("warnings", _TEXT, "", "engine warnings by name, as JSON"),
    Column("engine_name", _TEXT, "", "what computed the trajectory"),
    Column("engine_version", _TEXT, "", "its version"),
    Column("trace_file", _TEXT, "", "the run's MCAP file, relative to the store"),
    Column("trace_sha256", _TEXT, "", "its SHA-256"),
    Column("trace_bytes", _WHOLE, "B", "its size"),
    Column("trace_messages", _TEXT, "", "its messages by topic, as JSON"),
    Column("controls", _TEXT, "", "hash of what the run's policy did, which names its file"),
    Column("started", _TEXT, "", "UTC, ISO 8601"),
    Column("finished", _TEXT, "", "UTC, ISO 8601"),
    Column("provenance", _TEXT, "", "tool, host and versions, as JSON"),
    Column("axis_names", pa.list_(_TEXT), "", "names of the run's axis columns"),
)
PLUGINS_COLUMN = Column("plugins", _TEXT, "", "plug-ins that were loaded, as JSON")
"""Only in tables of sweeps with plug-ins."""
LOOP_COLUMNS = (
    Column("success", _TRUTH, "", "whether the loop calls its episode a success"),
    Column("total_reward", REAL, "", "sum of the rewards of the episode"),
    Column("loop", _TEXT, "", "what was noticed of the episode, as JSON"),
)
"""Only in tables of recorded loops."""
RESERVED_COLUMNS = frozenset(
    column.name for column in (*FIXED_COLUMNS, PLUGINS_COLUMN, *LOOP_COLUMNS)
)


def table_schema(own: Sequence[Column]) -> pa.Schema:
    """Return the schema of a table with columns of its own; see `write_table`."""
    columns = {column.name: column for column in (*FIXED_COLUMNS, *own)}
    return pa.schema([_field(column) for column in columns.values()])


def struct_column(name: str, values: Mapping[str, object]) -> Column:
    """Return the column of `settings` or `effects` with the fields that hold these values."""
    (placeholder,) = (column for column in FIXED_COLUMNS if column.name == name)
    fields = [pa.field(inner, _type_of(value)) for inner, value in values.items()]
    return replace(placeholder, type=pa.struct(fields))


def axis_column(name: str, values: Sequence[object], unit: str, description: str) -> Column:
    """Return the column of an axis, of the type that its values need."""
    kinds = {_type_of(value) for value in values}
    for kind, fitting in ((_TRUTH, {_TRUTH}), (_WHOLE, {_WHOLE}), (REAL, {_WHOLE, REAL})):
        if kinds <= fitting:
            return Column(name, kind, unit, description)
    return Column(name, _TEXT, unit, description)


def as_ratios(names: Iterable[str]) -> list[Column]:
    """Return the named fixed columns, where they have a unit, as columns of ratios."""
    wanted = set(names)
    return [replace(each, unit="1") for each in FIXED_COLUMNS if each.name in wanted and each.unit]


def _field(column: Column) -> pa.Field:
    meta = {"unit": column.unit, "description": column.description, "better": column.better}
    if column.better:
        meta["resolution"] = f"{column.resolution:g}"
    if column.second_pass:
        meta["measured_in"] = "second pass"
    given = {key: text for key, text in meta.items() if text}
    return pa.field(column.name, column.type, metadata=given)


def column_of(field: pa.Field) -> Column:
    """Return the column that a field of a stored table is."""
    meta = texts_of(field.metadata)
    said = (meta.get(key, "") for key in ("unit", "description", "better"))
    resolution, second = float(meta.get("resolution", 0)), "measured_in" in meta
    return Column(field.name, field.type, *said, resolution=resolution, second_pass=second)


def texts_of(metadata: Mapping[bytes, bytes] | None) -> dict[str, str]:
    """Return the metadata of a field as texts."""
    return {key.decode(): text.decode() for key, text in (metadata or {}).items()}


def _type_of(value: object) -> pa.DataType:
    if isinstance(value, bool):
        return _TRUTH
    if isinstance(value, int):
        return _WHOLE
    if isinstance(value, float):
        return REAL
    return _TEXT if isinstance(value, str) else pa.list_(REAL)


# Fields that all runs of a store share; the table has them once, in its metadata.
SHARED_FIELDS = ("schema_version", "sweep", "units", "metric_versions")
# Mappings of any keys, stored as JSON text, which every reader of Parquet can show.
_JSON_TEXT = ("drive", "pairs", "warnings", "provenance", "effect_reasons", "effects_missed")
_MODELS = ("coverage", "loop")
_NESTED = ("axes", "metrics", "labels", "plugins", *_MODELS)
# Columns of their own for each entry: how their names begin, and the entries.
_PARTS = {
    "engine": ("engine_", tuple(Engine.model_fields)),
    "initial": ("initial_", tuple(InitialState.model_fields)),
    "cost": ("cost_", tuple(Cost.model_fields)),
    "accuracy": ("", tuple(Accuracy.model_fields)),
    "timing": ("", tuple(Timing.model_fields)),
    "trace": ("trace_", ("file", "sha256", "bytes")),
}
# The columns of lists, with an entry for each label.
_LABELS = {"labels": "label", "label_reasons": "reason", "label_steps": "step"}
_PLAIN = tuple(
    name
    for name in EvidenceRecord.model_fields
    if name not in {*SHARED_FIELDS, *_JSON_TEXT, *_NESTED, *_PARTS}
)

Row = dict[str, Any]


def record_to_row(record: EvidenceRecord) -> Row:
    """Return a record as a flat row, with axes and metrics by name beside its fields."""
    loop = {column.name for column in LOOP_COLUMNS} if record.loop is None else ()
    return to_row({name: value for name, value in record if name not in loop})


def to_row(fields: Mapping[str, Any]) -> Row:
    """Return the columns of some fields of a record."""
    row: Row = {name: fields[name] for name in _PLAIN if name in fields}
    row |= {name: _encoded(fields[name]) for name in _JSON_TEXT if name in fields}
    if "labels" in fields:
        row |= _columns_of_labels(fields["labels"])
    for part, (prefix, names) in _PARTS.items():
        if part in fields:
            row |= {prefix + name: getattr(fields[part], name, None) for name in names}
    if "trace" in fields:
        row["trace_messages"] = fields["trace"] and _encoded(fields["trace"].messages)
    if "axes" in fields:
        row["axis_names"] = tuple(fields["axes"])
    for name in fields.keys() & _MODELS:
        said = fields[name]
        row[name] = said and said.model_dump_json(exclude_defaults=True)
    if fields.get("plugins"):
        row["plugins"] = _encoded(fields["plugins"])
    return row | fields.get("axes", {}) | fields.get("metrics", {})


def _columns_of_labels(labels: Sequence[Any]) -> Row:
    row: Row = {
        column: tuple(getattr(each, field) for each in labels) for column, field in _LABELS.items()
    }
    worst = labels[0] if labels else None
    return row | {"label_reason": worst and worst.reason, "label_step": worst and worst.step}


def row_to_record(row: Mapping[str, Any], shared: Mapping[str, Any]) -> EvidenceRecord:
    """Return the record of a row, given the fields that all runs of its store share."""
    data: Row = {name: row[name] for name in _PLAIN if name in row}
    # Older stores lack some of them.
    data |= {name: from_json(text) for name in _JSON_TEXT if (text := row.get(name)) is not None}
    data |= {name: shared[name] for name in SHARED_FIELDS}
    # The column has a field for each setting of any run; those of other runs are null.
    data["settings"] = {name: each for name, each in row["settings"].items() if each is not None}
    labels = zip(*(row[column] for column in _LABELS), strict=True)
    data["labels"] = [dict(zip(_LABELS.values(), each, strict=True)) for each in labels]
    for part, (prefix, names) in _PARTS.items():
        found = {name: row[prefix + name] for name in names if prefix + name in row}
        if any(value is not None for value in found.values()):
            data[part] = found
    if "trace" in data:
        data["trace"]["messages"] = from_json(row["trace_messages"])
    data |= {name: from_json(text) for name in _MODELS if (text := row.get(name)) is not None}
    if PLUGINS_COLUMN.name in row:
        data["plugins"] = from_json(row["plugins"])
    data["axes"] = {name: row[name] for name in row["axis_names"]}
    data["metrics"] = {name: row[name] for name in shared["units"]}
    return EvidenceRecord.model_validate(data)


def _encoded(value: object) -> str:
    return to_json(value).decode()
