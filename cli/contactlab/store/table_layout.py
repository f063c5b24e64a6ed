"""The columns of `runs.parquet`, and the conversion of a record into one of its rows and back.

Both follow from the fields of `EvidenceRecord`: their names, types, units and descriptions.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, cast, get_args, get_origin

import pyarrow as pa
from pydantic.fields import FieldInfo
from pydantic_core import from_json, to_json

from contactlab.schema.evidence import EvidenceRecord, InColumns, InTable, Timing
from contactlab.schema.strict_model import Model

_TEXT_TYPE = pa.string()
REAL = pa.float64()
_WHOLE_TYPE = pa.int64()
_TRUTH_TYPE = pa.bool_()


@dataclass(frozen=True)
class Column:
    """One column of the table."""

    name: str
    type: pa.DataType
    unit: str  # its unit, `1` for counts and ratios, empty for text
    description: str
    better: str = ""  # lower, higher or none for a measured value; empty otherwise
    resolution: float = 0.0  # a smaller measured value counts as 0, in its unit
    # Whether it is measured in the second pass, which a sweep may omit.
    second_pass: bool = False


@dataclass(frozen=True)
class StoredField:
    """A field of the record, or of a part of it, and the column with its values."""

    column: Column
    info: FieldInfo
    is_json: bool = False
    is_struct: bool = False
    is_sparse: bool = False  # JSON without the entries that have their default
    is_left_out: Callable[[Any], bool] | None = None

    @classmethod
    def from_field(cls, name: str, info: FieldInfo, prefix: str = "") -> "StoredField":
        """Return a field with the column that follows from its type and description."""
        is_struct = InTable.STRUCT in info.metadata
        kind = pa.struct([]) if is_struct else type_of_field(info.annotation)
        facts = cast("dict[str, str]", info.json_schema_extra or {})
        description = info.description or ""
        column = Column(
            prefix + name,
            _TEXT_TYPE if kind is None else kind,
            facts.get("unit", ""),
            f"{description}, as JSON" if kind is None else description,
            facts.get("better", ""),
        )
        is_sparse = InTable.WITHOUT_DEFAULTS in info.metadata
        left_out = info.exclude_if
        return cls(column, info, kind is None, is_struct, is_sparse, left_out)

    def to_stored(self, value: Any) -> Any:  # noqa: ANN401 - of the field's own type
        """Return a value of the field in the form of the table."""
        if value is None or not self.is_json:
            return value
        return (
            value.model_dump_json(exclude_defaults=True)
            if self.is_sparse
            else to_json(value).decode()
        )

    def from_stored(self, value: Any) -> Any:  # noqa: ANN401 - of the column's type
        """Return a value of the column in the form of the field."""
        if self.is_json:
            return None if value is None else from_json(value)
        if self.is_struct and value is not None:
            # The column has a field for each entry of any run; those of other runs are null.
            return {name: entry for name, entry in value.items() if entry is not None}
        return value


def type_of_field(annotation: Any) -> pa.DataType | None:  # noqa: ANN401 - any type
    """Return the type of a field's column; None if the column holds JSON."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return type_of_field(inner[0])
    if origin in {Union, UnionType}:
        kinds = [type_of_field(kind) for kind in inner if kind is not NoneType]
        return kinds[0] if len(kinds) == 1 else None
    if origin is Literal:
        return _TEXT_TYPE
    if origin is tuple:
        kind = type_of_field(inner[0])
        return None if kind is None else pa.list_(kind)
    return {str: _TEXT_TYPE, int: _WHOLE_TYPE, float: REAL, bool: _TRUTH_TYPE}.get(annotation)


def _model_of(annotation: Any) -> type[Model]:  # noqa: ANN401 - a model or null
    """Return the model class of a field's values."""
    return next(kind for kind in (*get_args(annotation), annotation) if kind is not NoneType)


_RECORD_FIELDS = EvidenceRecord.model_fields
# Fields that all runs of a store share; the table has them once, in its metadata.
SHARED_FIELDS = tuple(
    name for name, info in _RECORD_FIELDS.items() if InTable.SHARED in info.metadata
)
# Fields with a separate column for each entry, by the entry's name; and the labels.
_WITH_OWN_COLUMNS = {
    "labels",
    *(name for name, info in _RECORD_FIELDS.items() if InTable.BY_NAME in info.metadata),
}
FIELDS_OF_PARTS = {
    name: {
        inner: StoredField.from_field(inner, inner_info, mark.prefix)
        for inner, inner_info in _model_of(info.annotation).model_fields.items()
    }
    for name, info in _RECORD_FIELDS.items()
    for mark in info.metadata
    if isinstance(mark, InColumns)
}
PLAIN_FIELDS = {
    name: StoredField.from_field(name, info)
    for name, info in _RECORD_FIELDS.items()
    if name not in {*SHARED_FIELDS, *_WITH_OWN_COLUMNS, *FIELDS_OF_PARTS}
}
OF_LABELS = {
    "labels": "label",
    "label_reasons": "reason",
    "label_steps": "step",
    "label_bodies": "bodies",
}
"""The columns of lists with an entry for each label, with the entry's field."""
_LABEL_COLUMNS = (
    Column("labels", pa.list_(_TEXT_TYPE), "", _RECORD_FIELDS["labels"].description or ""),
    Column("label_reason", _TEXT_TYPE, "", "why the worst label applies"),
    Column("label_step", _WHOLE_TYPE, "1", "step at which the worst label was first met"),
    Column("label_reasons", pa.list_(_TEXT_TYPE), "", "why each label applies"),
    Column("label_steps", pa.list_(_WHOLE_TYPE), "1", "step at which each label was first met"),
    Column("label_bodies", pa.list_(pa.list_(_TEXT_TYPE)), "", "the bodies that each label is of"),
)
AXES_COLUMN = Column("axis_names", pa.list_(_TEXT_TYPE), "", "names of the run's axis columns")
# The order of the fields in the table; others come last.
_FIELD_ORDER = (
    *("run_id", "index", "scene", "scene_hash", "seed", "duration", "drive", "label", "labels"),
    *("status", "status_reason", "steps", "steps_asked", "trajectory_hash", "expected"),
    *("expectation_met", "expectation_reason", "tolerances_met", "knife_edge", "cost"),
    *("accuracy", "timing", "effects", "effect_reasons", "effects_missed", "settings", "initial"),
    *("pairs", "edited_geoms", "coverage", "warnings", "engine", "trace", "controls", "started"),
    *("finished", "provenance", "axes"),
)


def _columns_of_field(name: str) -> Sequence[Column]:
    if name in FIELDS_OF_PARTS:
        return [stored.column for stored in FIELDS_OF_PARTS[name].values()]
    if name in PLAIN_FIELDS:
        return [PLAIN_FIELDS[name].column]
    return {"labels": _LABEL_COLUMNS, "axes": (AXES_COLUMN,)}.get(name, ())


FIXED_COLUMNS = tuple(
    column
    for name in dict.fromkeys((*_FIELD_ORDER, *_RECORD_FIELDS))
    for column in _columns_of_field(name)
    if _RECORD_FIELDS[name].exclude_if is None
)
PLUGINS_COLUMN = PLAIN_FIELDS["plugins"].column
"""Only in tables of sweeps with plug-ins."""
LOOP_COLUMNS = tuple(PLAIN_FIELDS[name].column for name in ("success", "total_reward", "loop"))
"""Only in tables of recorded loops."""
RESERVED_COLUMNS = frozenset(
    column.name for column in (*FIXED_COLUMNS, PLUGINS_COLUMN, *LOOP_COLUMNS)
)

COLUMNS_OF_MACHINE = frozenset(
    {name for name in RESERVED_COLUMNS if name.startswith(("cost_", "trace_"))}
    | {name for name in Timing.model_fields if not name.startswith("work_")}
    | {"started", "finished", "provenance"}
)
"""Columns that depend on the machine, the day, and the choice of kept traces."""


def table_schema(own: Sequence[Column]) -> pa.Schema:
    """Return the schema of a table with additional columns; see `write_table`."""
    columns = {column.name: column for column in (*FIXED_COLUMNS, *own)}
    return pa.schema([_arrow_field(column) for column in columns.values()])


def struct_column(name: str, rows: Iterable[Mapping[str, object]]) -> Column:
    """Return the column of `settings` or `effects` with fields for all of these rows."""
    (placeholder,) = (column for column in FIXED_COLUMNS if column.name == name)
    kinds = {inner: _value_type(value) for row in rows for inner, value in row.items()}
    fields = [pa.field(inner, kind) for inner, kind in kinds.items()]
    return replace(placeholder, type=pa.struct(fields))


def axis_column(name: str, values: Iterable[object], unit: str, description: str) -> Column:
    """Return the column of an axis, of the type that its canonical values need.

    Raises a ValueError if only some of the values are texts.
    """
    kinds = {*map(_value_type, map(axis_cell, values))}
    if _TEXT_TYPE in kinds and len(kinds) > 1:
        raise ValueError("mixes single numbers with lists or shares; write all in one form")
    for kind, fitting in (
        (_TRUTH_TYPE, {_TRUTH_TYPE}),
        (_WHOLE_TYPE, {_WHOLE_TYPE}),
        (REAL, {_WHOLE_TYPE, REAL}),
    ):
        if kinds <= fitting:
            return Column(name, kind, unit, description)
    return Column(name, _TEXT_TYPE, unit, description)


def axis_cell(value: object) -> bool | int | float | str:
    """Return an axis value as in its column; several numbers become one string, "0.02 1"."""
    if isinstance(value, tuple):
        return " ".join(map(_short_number, cast("tuple[object, ...]", value)))
    assert isinstance(value, (bool, int, float, str))
    return value


def _short_number(number: object) -> str:
    assert isinstance(number, (int, float))
    return f"{number:g}" if float(f"{number:g}") == number else repr(number)


def as_ratios(names: Iterable[str]) -> list[Column]:
    """Return the named fixed columns that have a unit, as columns of ratios."""
    wanted_names = set(names)
    return [
        replace(fixed, unit="1")
        for fixed in FIXED_COLUMNS
        if fixed.name in wanted_names and fixed.unit
    ]


def _arrow_field(column: Column) -> pa.Field:
    meta = {"unit": column.unit, "description": column.description, "better": column.better}
    if column.better:
        meta["resolution"] = f"{column.resolution:g}"
    if column.second_pass:
        meta["measured_in"] = "second pass"
    present = {key: text for key, text in meta.items() if text}
    return pa.field(column.name, column.type, metadata=present)


def column_of(field: pa.Field) -> Column:
    """Return the column of a field in a stored table."""
    meta = texts_of(field.metadata)
    texts = (meta.get(key, "") for key in ("unit", "description", "better"))
    resolution, second = float(meta.get("resolution", 0)), "measured_in" in meta
    return Column(field.name, field.type, *texts, resolution=resolution, second_pass=second)


def original_type(kind: pa.DataType) -> pa.DataType:
    """Return the original type of a stored one: Parquet renames entries of lists."""
    if pa.types.is_list(kind):
        return pa.list_(original_type(kind.value_type))
    if pa.types.is_struct(kind):
        return pa.struct([pa.field(inner.name, original_type(inner.type)) for inner in kind])
    return kind


# Columns without which nothing can be said about a run.
_REQUIRED_COLUMNS = frozenset(
    (
        *("run_id", "index", "scene", "seed", "duration", "label", "labels", "label_reason"),
        *("label_step", "status", "steps", "expectation_met", "trace_file", "settings"),
        "axis_names",
    )
)
_NUMBER_TYPES = (REAL, _WHOLE_TYPE)


def check_layout(schema: pa.Schema, shared: object) -> None:
    """Check the columns of a stored table, and the fields that its runs share.

    Raises a ValueError with the first fault.
    """
    names, fixed = set(schema.names), {column.name: column for column in FIXED_COLUMNS}
    if len(names) < len(schema.names):
        twice = next(name for name in schema.names if schema.names.count(name) > 1)
        raise ValueError(f"column {twice} is there twice")
    if not isinstance(shared, dict):
        raise TypeError("the fields that all runs share are not a table")
    known_fields: dict[str, Any] = shared
    severity = known_fields.get("severity", [])
    if not _is_table(known_fields.get("units"), str) or not _is_table(
        known_fields.get("metric_versions"), int
    ):
        raise ValueError("units and versions of its metrics are missing")
    if not isinstance(severity, list) or not all(isinstance(name, str) for name in severity):
        raise ValueError("the order of its labels is no list")
    most_labels = 1000  # a written table has some dozens; a damaged one must not fill the memory
    if len(severity) > most_labels:
        raise ValueError(f"it has {len(severity):,} labels")
    units = known_fields["units"]
    if missing := sorted((_REQUIRED_COLUMNS | units.keys()) - names):
        raise ValueError(f"column {missing[0]} is missing")
    for field in schema:
        column, kind = fixed.get(field.name), original_type(field.type)
        if field.name in units:
            expected_kind = "numbers" if kind not in _NUMBER_TYPES else ""
        elif field.name in ("settings", "effects"):
            expected_kind = "" if pa.types.is_struct(kind) else "a struct"
        else:
            expected_kind = "" if column is None or kind == column.type else str(column.type)
        if expected_kind:
            raise ValueError(f"column {field.name} is {kind}, not {expected_kind}")
        column_of(field)


def _is_table(value: object, kind: type) -> bool:
    return isinstance(value, dict) and all(isinstance(entry, kind) for entry in value.values())


def texts_of(metadata: Mapping[bytes, bytes] | None) -> dict[str, str]:
    """Return the metadata of a field as texts."""
    return {key.decode(): text.decode() for key, text in (metadata or {}).items()}


def _value_type(value: object) -> pa.DataType:
    if isinstance(value, bool):
        return _TRUTH_TYPE
    if isinstance(value, int):
        return _WHOLE_TYPE
    if isinstance(value, float):
        return REAL
    return _TEXT_TYPE if isinstance(value, str) else pa.list_(REAL)


Row = dict[str, Any]


def record_to_row(record: EvidenceRecord) -> Row:
    """Return a record as a flat row, with axes and metrics by name next to its fields."""
    return to_row(dict(record))


def row_entries(fields: Mapping[str, Any]) -> list[bytes]:
    """Return the columns of some fields of a record that have a value, each as a JSON entry."""
    entries: list[bytes] = []
    for name, value in to_row(fields).items():
        if value is not None:
            entries.append(to_json({name: value})[1:-1])
    return entries


def to_row(fields: Mapping[str, Any]) -> Row:
    """Return the columns of some fields of a record."""
    row: Row = {}
    for name, field in PLAIN_FIELDS.items():
        if name in fields and not (field.is_left_out and field.is_left_out(fields[name])):
            row[name] = field.to_stored(fields[name])
    for part, inner in FIELDS_OF_PARTS.items():
        if part in fields:
            of_part = fields[part]
            row |= {
                field.column.name: field.to_stored(getattr(of_part, name, None))
                for name, field in inner.items()
            }
    if "labels" in fields:
        labels = fields["labels"]
        columns: Row = {
            column: tuple(getattr(label, field) for label in labels)
            for column, field in OF_LABELS.items()
        }
        worst = labels[0] if labels else None
        row |= columns | {
            "label_reason": worst and worst.reason,
            "label_step": worst and worst.step,
        }
    if "axes" in fields:
        row[AXES_COLUMN.name] = tuple(fields["axes"])
    return row | fields.get("axes", {}) | fields.get("metrics", {})


def axes_as_written(axes: Mapping[str, object]) -> dict[str, bool | int | float | str]:
    """Return the values of axes as in their columns."""
    return dict(zip(axes, map(axis_cell, axes.values()), strict=True))


def row_to_record(row: Mapping[str, Any], shared: Mapping[str, Any]) -> EvidenceRecord:
    """Return the record of a row, from the row and the fields that all runs of its store share."""
    data: Row = {name: shared[name] for name in SHARED_FIELDS}
    data |= _restore_fields(row, PLAIN_FIELDS)
    for part, inner in FIELDS_OF_PARTS.items():
        inner_fields = _restore_fields(row, inner)
        if any(value is not None for value in inner_fields.values()):
            data[part] = inner_fields
    # Stores of version 0.2 do not have the bodies of labels.
    label_fields = {column: field for column, field in OF_LABELS.items() if column in row}
    labels = zip(*(row[column] for column in label_fields), strict=True)
    data["labels"] = [dict(zip(label_fields.values(), label, strict=True)) for label in labels]
    data["axes"] = {name: row[name] for name in row[AXES_COLUMN.name]}
    data["metrics"] = {name: row[name] for name in shared["units"]}
    return EvidenceRecord.model_validate(data)


def _restore_fields(row: Mapping[str, Any], fields: Mapping[str, StoredField]) -> Row:
    """Return the fields with columns in a row; JSON that is null counts as missing."""
    return {
        name: field.from_stored(row[field.column.name])
        for name, field in fields.items()
        if row.get(field.column.name) is not None
        or (field.column.name in row and not field.is_json)
    }
