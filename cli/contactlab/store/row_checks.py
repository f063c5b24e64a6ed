"""Finds rows that may contradict the schema of a record, the sweep, or themselves.

Whole columns are checked at once. A record is built, and checked field by field, only for the rows
found here. Every row that violates a rule is found; a row that is found may still be valid.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache, cached_property, reduce
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import create_model

from contactlab.schema.evidence import EvidenceRecord, InTable, SweepIdentity
from contactlab.schema.strict_model import Model
from contactlab.store.arrow_values import number_array, numpy_array, text_scalar
from contactlab.store.run_columns import rows_of
from contactlab.store.runs_table import compute_digests
from contactlab.store.table_layout import (
    AXES_COLUMN,
    FIELDS_OF_PARTS,
    OF_LABELS,
    PLAIN_FIELDS,
    StoredField,
    original_type,
    row_to_record,
    type_of_field,
)

Columns = Mapping[str, pa.Array]
Truths = NDArray[np.bool_]
_TEXT_TYPE, _REAL_TYPE, _WHOLE_TYPE, _TRUTH_TYPE = pa.string(), pa.float64(), pa.int64(), pa.bool_()
_SCALAR_TYPES = frozenset({_TEXT_TYPE, _REAL_TYPE, _WHOLE_TYPE, _TRUTH_TYPE})
_SETTING_TYPES = _SCALAR_TYPES | {pa.list_(_REAL_TYPE)}
_LISTS_OF_LABELS = {
    "labels": pa.list_(_TEXT_TYPE),
    "label_reasons": pa.list_(_TEXT_TYPE),
    "label_steps": pa.list_(_WHOLE_TYPE),
    "label_bodies": pa.list_(pa.list_(_TEXT_TYPE)),
}
_UNRESTRICTED_TYPES = (str, int, float, bool, tuple[str, ...], tuple[float, ...])
"""Types of fields that accept every value of their column's type, except NaN and infinity."""


class RowChecks:
    """Finds the rows of a store's table with records that must be built and checked.

    The rows are of a sweep, with the fields that all of them share.
    """

    def __init__(self, sweep: SweepIdentity, shared: Mapping[str, Any]) -> None:
        self._asked, self._shared = sweep.resolved, shared
        self._fields, self._parts = _checks_of_fields()

    def find_suspects(self, rows: pa.RecordBatch) -> Truths:
        """Return (n,) a mask of rows that may violate a rule; there is at least one row."""
        columns = dict(zip(rows.schema.names, rows.columns, strict=True))
        try:
            # A fault of shared fields, or of the set of columns, shows in every row.
            row_to_record(rows.slice(0, 1).to_pylist()[0], self._shared)
            return reduce(np.logical_or, self._rule_violations(columns))
        except (LookupError, TypeError, ValueError, pa.ArrowException):
            return np.ones(len(rows), bool)

    def _rule_violations(self, columns: Columns) -> Iterator[Truths]:
        """Yield (n,) a mask of rows that may violate each rule."""
        yield from (check(columns) for check in self._fields if check.name in columns)
        for part, checks in self._parts.items():
            has = _has_part(columns, checks)
            wrong = ~has & EvidenceRecord.model_fields[part].is_required()
            for check in checks:
                if check.name in columns:
                    wrong |= has & check(columns)
                elif check.required:
                    wrong |= has
            yield wrong
        names = columns[AXES_COLUMN.name]
        wrong = is_null(names) | _wrong_values(names, {AXES_COLUMN.type})
        for axis in compute_digests("list_flatten", names).unique().to_pylist():
            wrong |= _wrong_values(columns[axis], _SCALAR_TYPES) if axis is not None else True
        yield wrong
        for name in self._shared["units"]:
            yield _wrong_values(columns[name], {_REAL_TYPE, _WHOLE_TYPE})
        yield _wrong_labels(columns)
        through = compute_digests("equal", columns["status"], text_scalar("ok"))
        yield numpy_array(through) != is_null(columns["status_reason"])
        yield _wrong_ends(columns, self._shared["units"])
        yield _misnamed_traces(columns)
        for part in ("accuracy", "timing"):
            if not self._asked.get(part):
                yield _has_part(columns, self._parts[part])
        if "knife_edge" in columns and not self._asked.get("knife_edge"):
            yield ~is_null(columns["knife_edge"])
        yield _wrong_cost(columns, self._asked.get("latency_budget"))


class _FieldCheck:
    """Finds rows with a value that the field of their column does not accept."""

    def __init__(self, stored: StoredField) -> None:
        self.name = stored.column.name
        self.required = stored.info.is_required()
        self._stored = stored
        # A plain column accepts all values of its type except NaN and infinity.
        annotation = stored.info.annotation
        optional = get_origin(annotation) in {Union, UnionType}
        kinds = [kind for kind in get_args(annotation) if kind is not NoneType] if optional else []
        rules = [rule for rule in stored.info.metadata if not isinstance(rule, InTable)]
        is_unrestricted = all(kind in _UNRESTRICTED_TYPES for kind in kinds or [annotation])
        self._is_plain = not (stored.is_json or rules) and is_unrestricted
        self._known = set[str]()

    def __call__(self, columns: Columns) -> Truths:
        """Return (n,) a mask of rows with a value that the field does not accept."""
        column, stored = columns[self.name], self._stored
        wrong = is_null(column) & (not self._accepts_null)
        if column.null_count == len(column):
            return wrong
        if stored.is_struct:
            (_, entry) = get_args(stored.info.annotation)
            kind = type_of_field(entry)
            kinds = _SETTING_TYPES if kind is None else {kind}
            entries = (_wrong_values(entry, kinds) for entry in column.flatten())
            return wrong | reduce(np.logical_or, entries, np.zeros(len(column), bool))
        if original_type(column.type) != stored.column.type:
            return np.ones(len(column), bool)
        if self._is_plain:
            return wrong | _wrong_values(column, {stored.column.type})
        return wrong | self._wrong_texts(column)

    @cached_property
    def _accepts_null(self) -> bool:
        # Null instead of JSON means that the field is omitted.
        return not self.required if self._stored.is_json else self._accepts_texts(None)

    @cached_property
    def _value_model(self) -> type[Model]:
        info = self._stored.info
        kind = Annotated[info.annotation, *info.metadata] if info.metadata else info.annotation
        field: Any = list[kind], ...
        return create_model("Checked", __base__=Model, values=field)

    def _accepts_texts(self, *values: object) -> bool:
        """Return whether the field accepts each of some values."""
        try:
            self._value_model.model_validate({"values": [*map(self._stored.from_stored, values)]})
        except ValueError:
            return False
        return True

    def _wrong_texts(self, column: pa.Array) -> Truths:
        """Return (n,) a mask of texts that the field does not accept; each text is tried once."""
        different = {text for text in column.unique().to_pylist() if text is not None}
        new_texts = different - self._known
        wrong = (
            set[str]()
            if self._accepts_texts(*new_texts)
            else {text for text in new_texts if not self._accepts_texts(text)}
        )
        # Most texts of a column that are cached as valid.
        if len(self._known) < 1 << 12:
            self._known |= different - wrong
        if not wrong:
            return np.zeros(len(column), bool)
        return np.array([text in wrong for text in column.to_pylist()])


@cache
def _checks_of_fields() -> tuple[list[_FieldCheck], dict[str, list[_FieldCheck]]]:
    # They do not depend on a store, and their models take longer to build than stores to check.
    parts = {
        part: [_FieldCheck(field) for field in inner.values()]
        for part, inner in FIELDS_OF_PARTS.items()
    }
    return [_FieldCheck(field) for field in PLAIN_FIELDS.values()], parts


def _wrong_values(column: pa.Array, kinds: Collection[pa.DataType]) -> Truths:
    """Return (n,) a mask of NaN, infinities, and lists with nulls; all if the type differs."""
    kind = original_type(column.type)
    if kind not in kinds:
        return np.ones(len(column), bool)
    if pa.types.is_list(kind):
        entries = compute_digests("list_flatten", column)
        wrong = is_null(entries) | _wrong_values(entries, {kind.value_type})
        return _any_of_lists(column, wrong)
    if pa.types.is_floating(kind):
        return ~np.isfinite(numpy_array(column)) & ~is_null(column)
    return np.zeros(len(column), bool)


def _any_of_lists(column: pa.Array, entries: Truths) -> Truths:
    """Return (n,) a mask of lists with any marked entry, from the mask of all entries."""
    has_entry = np.zeros(len(column), bool)
    if entries.any():
        has_entry[np.repeat(np.arange(len(column)), list_lengths(column))[entries]] = True
    return has_entry


def _has_part(columns: Columns, checks: Sequence[_FieldCheck]) -> Truths:
    """Return (n,) a mask of rows that have any field of a part of the record."""
    there = (~is_null(columns[check.name]) for check in checks if check.name in columns)
    return reduce(np.logical_or, there, np.zeros(len(columns["run_id"]), bool))


def _wrong_labels(columns: Columns) -> Truths:
    """Return (n,) a mask of rows with incomplete labels, or with a wrong worst label."""
    names = columns["labels"]
    lengths = list_lengths(names)
    wrong = np.zeros(len(names), bool)
    # Stores of version 0.2 do not have the bodies of labels.
    for name in (name for name in OF_LABELS if name in columns):
        column, kind = columns[name], _LISTS_OF_LABELS[name]
        wrong |= is_null(column) | (list_lengths(column) != lengths)
        if name == "label_steps":
            # A label may have no step.
            wrong |= original_type(column.type) != kind
        elif name == "label_bodies":
            bodies = compute_digests("list_flatten", column)
            unfit = is_null(bodies) | _wrong_values(bodies, {kind.value_type})
            wrong |= _any_of_lists(column, unfit)
        else:
            wrong |= _wrong_values(column, {kind})
    for one, several in (("label_reason", "label_reasons"), ("label_step", "label_steps")):
        wrong |= ~equal_values(columns[one], _first_entries(columns[several]))
    return wrong | ((lengths > 0) & ~equal_values(columns["label"], _first_entries(names)))


def is_null(column: pa.Array) -> Truths:
    """Return (n,) a mask of nulls in a column."""
    if column.null_count in {0, len(column)}:
        return np.full(len(column), column.null_count > 0)
    return numpy_array(compute_digests("is_null", column))


def list_lengths(lists: pa.Array) -> NDArray[np.int64]:
    """Return (n,) the lengths of lists, 0 for nulls."""
    lengths = compute_digests("list_value_length", lists)
    return np.where(is_null(lengths), 0, numpy_array(lengths)).astype(np.int64)


def _first_entries(lists: pa.Array) -> pa.Array:
    """Return (n,) the first entry of each list, null for an empty one."""
    lengths, entries = list_lengths(lists), compute_digests("list_flatten", lists)
    places = np.cumsum(lengths) - lengths
    # Append a null entry, which empty lists refer to.
    ends = pa.concat_arrays([entries, pa.nulls(1, entries.type)])
    return compute_digests("take", ends, number_array(np.where(lengths > 0, places, len(entries))))


def equal_values(one: pa.Array, other: pa.Array) -> Truths:
    """Return (n,) whether entries of two columns of one type are equal, or both null."""
    null, also = is_null(one), is_null(other)
    if not pa.types.is_list(one.type):
        return np.where(null | also, null & also, numpy_array(compute_digests("equal", one, other)))
    equal = (null == also) & (list_lengths(one) == list_lengths(other))
    (ours, theirs) = (
        compute_digests("list_flatten", rows_of(lists, equal)) for lists in (one, other)
    )
    equal[equal] = ~_any_of_lists(rows_of(one, equal), ~equal_values(ours, theirs))
    return equal


def _wrong_ends(columns: Columns, metrics: Iterable[str]) -> Truths:
    # A run that ended with its process has no results.
    statuses = columns["status"].to_pylist()
    ended = np.array([status in {"crashed", "timeout"} for status in statuses], bool)
    if not ended.any():
        return ended
    has_results = ~equal_values(columns["label"], columns["status"]) | (
        numpy_array(columns["steps"]) != 0
    )
    for name in ("trajectory_hash", "trace_file", *metrics):
        has_results |= ~is_null(columns[name])
    return ended & has_results


def _misnamed_traces(columns: Columns) -> Truths:
    """Return (n,) a mask of traces in a file with a name other than their run's id."""
    files = columns["trace_file"]
    if files.null_count == len(files):
        return np.zeros(len(files), bool)
    pairs = zip(columns["run_id"].to_pylist(), files.to_pylist(), strict=True)
    return np.array([file is not None and not file.endswith(f"/{run}.mcap") for run, file in pairs])


def _wrong_cost(columns: Columns, budget: float | None) -> Truths:
    """Return (n,) a mask of costs that differ from `Cost.of_steps` for their CPU time."""
    settings = columns["settings"]
    timestep = settings.field(settings.type.get_field_index("timestep"))
    if timestep.type not in {_REAL_TYPE, _WHOLE_TYPE}:
        return np.ones(len(settings), bool)
    of_sim, of_budget, budget_share = (
        columns[f"cost_{name}"] for name in ("cpu_per_sim_s", "latency_budget_s", "latency_used")
    )
    cpu, steps = (numpy_array(columns[name]).astype(float) for name in ("cost_cpu_s", "steps"))
    with np.errstate(all="ignore"):
        simulated = steps * numpy_array(timestep)
        wrong = numpy_array(of_sim) != np.where(simulated != 0, cpu / simulated, 0.0)
        if budget:
            wrong |= is_null(of_budget) | (numpy_array(of_budget) != budget)
            is_used = steps != 0
            wrong |= is_used == is_null(budget_share)
            wrong |= is_used & (numpy_array(budget_share) != cpu / steps / budget)
        else:
            wrong |= ~is_null(budget_share) | ~is_null(of_budget)
    return is_null(timestep) | (wrong & ~is_null(columns["cost_cpu_s"]))
