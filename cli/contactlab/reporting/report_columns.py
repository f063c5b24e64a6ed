"""Columns of a report: axes, measured quantities and labels of a table of runs."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import StoreError
from contactlab.measure.run_integrity import find_accepted
from contactlab.palette import OTHERS_COLOUR
from contactlab.schema.evidence import LabelFacts
from contactlab.schema.vocabulary import Role
from contactlab.store.finished_store import Store
from contactlab.store.run_columns import RunColumns
from contactlab.store.table_layout import Column

Codes = NDArray[np.integer[Any]]
_ADDED = TypeAdapter(dict[str, LabelFacts])

SEED = "seed"
SCENES_OWN = "as in the scene"
STABLE = "stable"
_UNITLESS = {"", "1", "any"}
_MORE_LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0789"
_SMALLER = {"s": "ms", "m": "mm"}
_LARGER = {small: unit for unit, small in _SMALLER.items()}


@dataclass(frozen=True)
class GridAxis:
    """One axis of n runs."""

    name: str
    unit: str  # its unit; `1` or empty for none
    role: Role
    ticks: tuple[str, ...]  # its values, or bins of them, as text, in order
    codes: Codes  # (n,) index into `ticks` of each run's value
    numbers: Floats | None  # (n,) the values themselves if `ticks` are bins, otherwise None

    @property
    def title(self) -> str:
        """Its name with its unit."""
        return with_unit(self.name, self.unit)

    @property
    def amount_unit(self) -> str:
        """Its unit where its values are amounts of it; empty for ratios, words and pairs."""
        return self.unit if self.is_ordered and self.unit not in _UNITLESS else ""

    @property
    def is_ordered(self) -> bool:
        """True if its values are numbers, the least first."""
        return self.numbers is not None or all(map(_is_number, self.ticks))


@dataclass(frozen=True)
class Quantity:
    """One measured column of n runs; values (n,) are NaN if a run has no finite value."""

    column: Column
    values: Floats

    @property
    def name(self) -> str:
        """Its name."""
        return self.column.name

    @property
    def title(self) -> str:
        """Its name with its unit."""
        return with_unit(self.column.name, self.column.unit)


@dataclass(frozen=True)
class Quantities:
    """The measured columns with a value of any run, each read on request."""

    stored: RunColumns
    columns: tuple[Column, ...]

    @classmethod
    def of(cls, stored: RunColumns) -> "Quantities":
        """Return those of a table."""
        metric_columns = stored.metric_columns.items()
        return cls(
            stored, tuple(column for name, column in metric_columns if stored.has_finite(name))
        )

    def __iter__(self) -> Iterator[Quantity]:
        """Yield them in the order of the table, with one at a time in memory."""
        return self._read_columns(self.columns)

    def select_named(self, names: Sequence[str]) -> Iterator[Quantity]:
        """Yield those of these names, in the order of the table."""
        return self._read_columns([column for column in self.columns if column.name in names])

    def _read_columns(self, columns: Sequence[Column]) -> Iterator[Quantity]:
        for column in columns:
            values = self.stored.numbers(column.name).values
            values[~np.isfinite(values)] = np.nan
            yield Quantity(column, values)


@dataclass(frozen=True)
class RunLabels:
    """The labels of n runs."""

    names: tuple[str, ...]  # worst labels that occur, the worst first and `stable` last
    letters: tuple[str, ...]  # one letter for each, all different; empty for `stable`
    facts: tuple[LabelFacts, ...]  # description and look of each, as far as known
    codes: Codes  # (n,) index into `names` of each run's worst label
    masks: Codes  # (n,) all labels of a run as bits: bit i for `every[i]`
    every: tuple[str, ...]  # all labels that occur, also together with a worse one
    # The order of the runs with each label, which several parts of a report show.
    _worst_rows: dict[int, NDArray[np.uint32]] = field(
        default_factory=dict[int, NDArray[np.uint32]], init=False, repr=False, compare=False
    )

    @property
    def colours(self) -> tuple[str, ...]:
        """The color of each."""
        return tuple(facts.colour or OTHERS_COLOUR for facts in self.facts)

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """The number of runs with each."""
        return tuple(np.bincount(self.codes, minlength=len(self.names)).tolist())

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(n,) whether a run has a failure label."""
        return np.array([name != STABLE for name in self.names], dtype=bool)[self.codes]

    def worst_rows(self, store: Store, code: int) -> NDArray[np.uint32]:
        """Return the runs with a worst label, by its code: the worst by its metrics first."""
        from contactlab.judge.worst_runs import order_worst_first  # noqa: PLC0415 - takes a while

        if code not in self._worst_rows:
            rows = np.flatnonzero(self.codes == code).astype(np.uint32)
            self._worst_rows[code] = rows[order_worst_first(store, self.names[code], rows)]
        return self._worst_rows[code]

    @property
    def legend(self) -> tuple[str, ...]:
        """Labels with their letters in front."""
        pairs = zip(self.letters, self.names, strict=True)
        return tuple(f"{letter}  {name}" if letter else name for letter, name in pairs)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def with_unit(name: str, unit: str) -> str:
    """Return a name with its unit in brackets, where it has one."""
    return name if unit in _UNITLESS else f"{name} [{unit}]"


def number_with_unit(text: str, unit: str) -> str:
    """Return a number with its unit after it, where it has one."""
    return text if unit in _UNITLESS else f"{text} {unit}"


def read_axes(store: Store) -> tuple[GridAxis, ...]:
    """Return the axes that differ between runs of a store, and the seed if there are several."""
    columns = store.columns
    roles: dict[str, Role] = {**store.reported_roles, SEED: "scenario"}
    axis_names = dict.fromkeys((*columns.axis_names, SEED))
    names = [name for name in axis_names if name in columns.schema.names and columns.varies(name)]
    whole = store.manifest.sweep.whole
    grid = whole.axes if whole else {}
    axes = [
        _read_axis(columns, name, roles.get(name, "knob"), grid.get(name, ())) for name in names
    ]
    return tuple(axis for axis in axes if len(axis.ticks) > 1)


def _read_axis(columns: RunColumns, name: str, kind: Role, grid: Sequence[Any]) -> GridAxis:
    """Return an axis; a refined one has all values of its grid."""
    unit = columns.described[name].unit
    if not columns.is_number(name):
        codes, values = columns.read_codes(name)
        ticks = tuple(SCENES_OWN if value is None else value.strip() for value in values)
        return GridAxis(name, unit, kind, ticks, _in_few_bytes(codes, len(ticks)), None)
    numbers, places = columns.rank_numbers(name, grid)
    numbers, unit = in_small_units(numbers, unit)
    # Two that differ in their last digits may be one in small units.
    values, codes = np.unique(numbers, return_inverse=True)
    most_values = 40  # an axis with more values than this is drawn in bins
    if not grid and len(values) > most_values and np.isfinite(values).all():
        return GridAxis(name, unit, kind, *_bin_numbers(numbers[places]), numbers[places])
    codes = _in_few_bytes(codes, len(values))[places]
    if str(columns.schema.field(name).type) == "bool":
        ticks = [{0.0: "false", 1.0: "true"}.get(value, SCENES_OWN) for value in values.tolist()]
    else:
        ticks = [SCENES_OWN if math.isnan(value) else f"{value:.4g}" for value in values]
    # Equal ticks get more digits.
    ticks = ticks if len({*ticks}) == len(ticks) else [f"{value:.10g}" for value in values]
    return GridAxis(name, unit, kind, tuple(ticks), codes, None)


def tick_of(axis: GridAxis, value: object) -> int:
    """Return the place of a value among the ticks of an axis that is not in bins.

    Raises a ValueError for other values.
    """
    if not isinstance(value, float | int) or isinstance(value, bool):
        return axis.ticks.index(str(value).lower() if isinstance(value, bool) else str(value))
    value = 1e3 * value if axis.unit in _LARGER else value
    short, long = f"{value:.4g}", f"{value:.10g}"
    return axis.ticks.index(short if short in axis.ticks else long)


def read_accepted_overlap(columns: RunColumns, row: int) -> str:
    """Return why a contact of a stable run may be deep, as `accepted: ...`; empty if it is not."""
    reason = columns.select_values(["label_reason"], [row])[0]["label_reason"]
    accepted = find_accepted(reason or "")
    return f"accepted: {accepted}" if accepted else ""


def in_small_units(numbers: Floats, unit: str) -> tuple[Floats, str]:
    """Return times and lengths in ms and mm where all are below a tenth of the unit."""
    least_of_unit = 0.1
    finite = np.abs(numbers[np.isfinite(numbers)])
    if unit not in _SMALLER or not finite.size or finite.max() >= least_of_unit:
        return numbers, unit
    values, places = np.unique(numbers, return_inverse=True)
    # A thousand times 1.1e-3 is not quite 1.1.
    return np.array([float(f"{1e3 * value:.12g}") for value in values])[places], _SMALLER[unit]


def _bin_numbers(numbers: Floats) -> tuple[tuple[str, ...], Codes]:
    """Return bins of equal width, of logarithms where the numbers span decades."""
    low, high = float(numbers.min()), float(numbers.max())
    # Bins are logarithmic if the largest value is more than this multiple of the least.
    log_span = 50.0
    spaced = np.geomspace if low > 0 and high / low > log_span else np.linspace
    bins = 20
    edges = spaced(low, high, bins + 1)
    codes = np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, bins - 1)
    ticks = tuple(f"{first:.3g} to {last:.3g}" for first, last in pairwise(edges.tolist()))
    return ticks, _in_few_bytes(codes, bins)


def _in_few_bytes(codes: Codes, count: int) -> Codes:
    """Return codes below a count in as few bytes as hold them; sums of them need wider ones."""
    return codes.astype(np.min_scalar_type(max(0, count - 1)))


def combination_codes(axes: Sequence[GridAxis], runs: int) -> Codes:
    """Return (n,) one number for each combination of values of some axes."""
    codes = np.zeros(runs, dtype=np.int64)
    for axis in axes:
        codes *= len(axis.ticks)
        codes += axis.codes
    return codes


def exact_codes(axes: Sequence[GridAxis], runs: int) -> Codes:
    """Return (n,) the same as `combination_codes`, where axes in bins differ in their numbers."""
    codes = np.zeros(runs, dtype=np.int64)
    for axis in axes:
        count, places = len(axis.ticks), axis.codes
        if axis.numbers is not None:
            numbers, places = np.unique(axis.numbers, return_inverse=True)
            count = len(numbers)
        # Renumbered before a product of many axes overflows.
        if int(codes.max(initial=0)) > np.iinfo(np.int64).max // count - 1:
            codes = np.unique(codes, return_inverse=True)[1]
        codes *= count
        codes += places
    return codes


def summary_metrics() -> list[str]:
    """Return the physical metrics that a sweep's summary prints, the penetration first."""
    from contactlab.measure import METRICS  # noqa: PLC0415 - takes a while

    names = [
        metric.name for metric in METRICS.values() if metric.heading and metric.kind == "physics"
    ]
    return sorted(names, key=lambda name: name != "penetration_max")


def read_run_labels(store: Store, also: Sequence[str] = ()) -> RunLabels:
    """Return the labels of a store's runs; `also` lists further labels."""
    from contactlab.measure import LABELS  # noqa: PLC0415 - takes a while

    codes, strings = store.columns.read_codes("label")
    ours = {name: label.facts for name, label in LABELS.items() if not label.is_added}
    # Plug-ins may not be installed; the store has the facts about their labels.
    try:
        added = _ADDED.validate_python(store.columns.shared.get("labels", {}))
    except ValidationError as error:
        raise StoreError(f"{store.address}: its table describes labels wrongly: {error}") from error
    order = [str(name) for name in store.columns.shared.get("severity", ())]
    unordered = dict.fromkeys((*strings, *also))
    if unordered.keys() - {*order}:
        order = [*ours, *order]
    ranks = {name: rank for rank, name in enumerate(order)}
    names = sorted(unordered, key=lambda name: (name == STABLE, ranks.get(name, -1), name))
    placed = _in_few_bytes(np.array([names.index(string) for string in strings]), len(names))
    masks, every = store.columns.string_sets("labels")
    facts = {**dict.fromkeys(sorted(names), LabelFacts()), **added, **ours}
    letters: dict[str, str] = {STABLE: ""}
    for name in (*ours, *sorted(facts.keys() - ours)):
        # A letter that another label has already is replaced by one that none has.
        own = [*facts[name].letter, *name.upper().replace("_", ""), *_MORE_LETTERS]
        free = (letter for letter in own if letter not in letters.values())
        letters.setdefault(name, next(free, "?"))
    return RunLabels(
        tuple(names),
        tuple(letters[name] for name in names),
        tuple(facts[name] for name in names),
        placed[codes],
        masks.astype(np.min_scalar_type((1 << len(every)) - 1)),
        every,
    )
