"""The columns of `runs.parquet`: type, unit and description."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import pyarrow as pa

_TEXT = pa.string()
_REAL = pa.float64()
_WHOLE = pa.int64()
_TRUTH = pa.bool_()


@dataclass(frozen=True)
class Column:
    """One column of the table.

    Attributes:
        name: its name.
        type: its Arrow type.
        unit: its unit, `1` for counts and ratios, empty for words.
        description: what it holds.
        better: of what is measured: lower, higher or none; empty for all else.
        resolution: magnitude below which a measured value is 0, in its unit.
        second_pass: whether it is measured in the second pass, which a sweep may leave out.
    """

    name: str
    type: pa.DataType
    unit: str
    description: str
    better: str = ""
    resolution: float = 0.0
    second_pass: bool = False


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
    Column("cost_cpu_per_sim_s", _REAL, "1", "CPU seconds per simulated second", "lower"),
    Column("cost_latency_budget_s", _REAL, "s", "wall time a step may take"),
    Column("cost_latency_used", _REAL, "1", "mean CPU time of a step over the budget"),
    Column("error_final", _REAL, "m", "distance from the reference at the end", "lower"),
    Column("error_mean", _REAL, "m", "distance from the reference, mean over time", "lower"),
    Column("error_peak", _REAL, "m", "distance from the reference, largest", "lower"),
    Column("error_estimate", _REAL, "m", "what the reference itself may be off by", "lower"),
    Column("error_final_estimate", _REAL, "m", "the same for the error at the end"),
    Column("error_mean_estimate", _REAL, "m", "the same for the mean error"),
    Column("error_kind", _TEXT, "", "trajectory, local or invariants; the last have no unit"),
    Column("chaotic", _TRUTH, "", "whether a start 1e-8 away grows to the size of the errors"),
    Column("reference_integrator", _TEXT, "", "the reference's integrator"),
    Column("reference_timestep", _REAL, "s", "the finest reference's timestep"),
    Column("impacts", _WHOLE, "1", "how often contacts began or ended in the run"),
    Column("solref_rule", _TEXT, "", "absolute, or tied to the timestep"),
    Column("solref_clamped", _TRUTH, "", "whether refsafe raised solref to two timesteps"),
    Column("time_min", _REAL, "1", "CPU s per simulated s, least of the rounds", "lower"),
    Column("time_median", _REAL, "1", "CPU s per simulated s, median of the rounds", "lower"),
    Column("step_p50", _REAL, "s", "CPU time of a single step, median", "lower"),
    Column("step_p99", _REAL, "s", "CPU time of a single step, 99th percentile", "lower"),
    Column("compile_time", _REAL, "s", "CPU time to compile the model", "lower"),
    Column("work_steps", _REAL, "1/s", "steps per simulated second", "lower"),
    Column("work_iterations", _REAL, "1/s", "solver iterations per simulated second", "lower"),
    Column("work_contacts", _REAL, "1/s", "contacts of all steps per simulated second", "lower"),
    Column("work_rows", _REAL, "1/s", "constraint rows of all steps per simulated second", "lower"),
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


def metric_column(
    name: str,
    unit: str,
    description: str,
    *,
    better: str = "none",
    resolution: float = 0.0,
    second_pass: bool = False,
) -> Column:
    """Return the column of a metric; what the arguments say is in `Column`."""
    return Column(name, _REAL, unit, description, better, resolution, second_pass)


def ratios(names: Iterable[str]) -> list[Column]:
    """Return those of these columns that have a unit, as ratios instead."""
    wanted = set(names)
    return [replace(each, unit="1") for each in FIXED if each.name in wanted and each.unit]


def _field(column: Column) -> pa.Field:
    meta = {"unit": column.unit, "description": column.description, "better": column.better}
    if column.better:
        meta["resolution"] = f"{column.resolution:g}"
    if column.second_pass:
        meta["measured_in"] = "second pass"
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
