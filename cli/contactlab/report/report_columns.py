"""The axes of a store's runs, as places in a grid."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats
from contactlab.measure import LABELS
from contactlab.schema import Role, Sweep, axis_role
from contactlab.store import MeasuredColumn, RunColumns, Store
from contactlab.tradeoff import COLOURS, REST

Codes = NDArray[np.int64]

MOST_VALUES = 40
"""More values of an axis than this are drawn as bins."""
_BINS = 20
_LOGARITHMIC = 50.0
SEED = "seed"


@dataclass(frozen=True)
class GridAxis:
    """One axis of n runs.

    Attributes:
        name: its name.
        unit: its unit; `1` or empty for none.
        role: knob or scenario.
        words: its values, or bins of them, in order.
        codes: (n,) the place of each run's value in `words`.
        numbers: (n,) the values themselves where `words` are bins; else None.
        marks: (words,) the values as numbers, NaN where they are none, and the middles of bins.
    """

    name: str
    unit: str
    role: Role
    words: tuple[str, ...]
    codes: Codes
    numbers: Floats | None
    marks: Floats

    @property
    def title(self) -> str:
        """Its name with its unit."""
        return with_unit(self.name, self.unit)


def with_unit(name: str, unit: str) -> str:
    """Return a name with its unit, where it has one."""
    return name if unit in {"", "1", "any"} else f"{name} [{unit}]"


def read_axes(store: Store) -> tuple[GridAxis, ...]:
    """Return the axes that differ between runs of a store, and the seed if there are several."""
    columns = store.columns
    roles = _roles(store)
    names = [name for name in (*columns.axis_names, SEED) if name in columns.schema.names]
    axes = [_axis(columns, name, roles.get(name, "knob")) for name in dict.fromkeys(names)]
    return tuple(axis for axis in axes if len(axis.words) > 1)


def _axis(columns: RunColumns, name: str, kind: Role) -> GridAxis:
    metadata = columns.schema.field(name).metadata or {}
    unit = metadata.get(b"unit", b"").decode()
    if not columns.is_number(name):
        codes, words = columns.strings(name)
        known = tuple(word.strip() for word in words)
        shown = (*known, "none") if (codes < 0).any() else known
        places = np.where(codes < 0, len(known), codes)
        return GridAxis(name, unit, kind, shown, places, None, np.full(len(shown), np.nan))
    numbers = columns.numbers(name).values
    values, places = np.unique(numbers, return_inverse=True)
    if str(columns.schema.field(name).type) == "bool":
        words = tuple("true" if value else "false" for value in values)
        return GridAxis(name, unit, kind, words, places, None, values)
    if len(values) > MOST_VALUES and np.isfinite(values).all():
        words, places, middles = _binned(numbers)
        return GridAxis(name, unit, kind, words, places, numbers, middles)
    return GridAxis(name, unit, kind, _number_ticks(values), places, None, values)


def _number_ticks(values: Floats) -> tuple[str, ...]:
    short = tuple("none" if math.isnan(value) else f"{value:.4g}" for value in values)
    if len(set(short)) == len(short):
        return short
    return tuple(f"{value:.10g}" for value in values)


def _binned(numbers: Floats) -> tuple[tuple[str, ...], Codes, Floats]:
    """Return bins of equal width, of logarithms where the numbers span decades."""
    low, high = float(numbers.min()), float(numbers.max())
    spaced = np.geomspace if low > 0 and high / low > _LOGARITHMIC else np.linspace
    edges = spaced(low, high, _BINS + 1)
    codes = np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, _BINS - 1)
    pairs = list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
    words = tuple(f"{first:.3g} to {last:.3g}" for first, last in pairs)
    return words, codes.astype(np.int64), np.array([(first + last) / 2 for first, last in pairs])


def _roles(store: Store) -> dict[str, Role]:
    sweep = Sweep.model_validate(store.manifest.sweep.resolved)
    named = [*sweep.axes.items(), *(pair for block in sweep.zip for pair in block.items())]
    return {**{name: axis_role(axis) for name, axis in named}, SEED: "scenario"}


def combination_codes(axes: Sequence[GridAxis], runs: int) -> Codes:
    """Return (n,) one number for each combination of values of some axes."""
    codes = np.zeros(runs, dtype=np.int64)
    for axis in axes:
        codes = codes * len(axis.words) + axis.codes
    return codes


@dataclass(frozen=True)
class Quantity:
    """One measured column of n runs.

    Attributes:
        told: its name, unit, direction and resolution.
        description: what it is.
        values: (n,), NaN where there is no finite one.
    """

    told: MeasuredColumn
    description: str
    values: Floats

    @property
    def name(self) -> str:
        """Its name."""
        return self.told.name

    @property
    def title(self) -> str:
        """Its name with its unit."""
        return with_unit(self.told.name, self.told.unit)


def read_quantities(store: Store) -> tuple[Quantity, ...]:
    """Return the columns of measured values that any run has a value of."""
    found = (_quantity(store, told) for told in store.columns.measured.values())
    return tuple(each for each in found if np.isfinite(each.values).any())


def _quantity(store: Store, told: MeasuredColumn) -> Quantity:
    values = store.columns.numbers(told.name).values
    metadata = store.columns.schema.field(told.name).metadata or {}
    finite = np.where(np.isfinite(values), values, np.nan)
    return Quantity(told, metadata.get(b"description", b"").decode(), finite)


STABLE = "stable"
STABLE_COLOUR = "#dbe5de"
"""What is stable stays in the background."""
_ORDER = (2, 1, 3, 0, 4, 5, 6, 7)
"""The palette with its reds first, for the worst labels."""


@dataclass(frozen=True)
class RunLabels:
    """The worst label of n runs.

    Attributes:
        names: labels that occur, the worst first and `stable` last.
        letters: one of each, none alike; empty for `stable`.
        colours: one of each.
        meanings: what each says of a run.
        counts: runs of each.
        codes: (n,) the place of each run's label in `names`.
        masks: (n,) all labels of a run: bit i for `every[i]`.
        every: labels that occur at all, also beside a worse one.
    """

    names: tuple[str, ...]
    letters: tuple[str, ...]
    colours: tuple[str, ...]
    meanings: tuple[str, ...]
    counts: tuple[int, ...]
    codes: NDArray[np.int64]
    masks: NDArray[np.int64]
    every: tuple[str, ...]

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(n,) whether a run has a failure label."""
        stable = [name == STABLE for name in self.names]
        return ~np.array([*stable, False])[self.codes]

    @property
    def legend(self) -> tuple[str, ...]:
        """Labels with their letters."""
        return tuple(map(with_letter, self.letters, self.names))


def with_letter(letter: str, name: str) -> str:
    """Return a label with its letter in front."""
    return f"{letter}  {name}" if letter else name


def read_run_labels(store: Store, also: Sequence[str] = ()) -> RunLabels:
    """Return the labels of a store's runs.

    Args:
        store: the store.
        also: labels that are to be named beside those that occur.
    """
    codes, words = store.columns.strings("label")
    told = [str(name) for name in store.columns.shared.get("severity", ())]
    ranks = {name: rank for rank, name in enumerate([*LABELS, *told])}
    named = dict.fromkeys((*words, *also))
    names = sorted(named, key=lambda name: (name == STABLE, ranks.get(name, -1), name))
    places = np.array([names.index(word) for word in words], dtype=np.int64)
    placed = places[codes]
    failures = [name for name in names if name != STABLE]
    letters = dict(zip(failures, _letters(failures), strict=True))
    colours = {name: _colour(rank) for rank, name in enumerate(failures)}
    masks, every = store.columns.string_sets("labels")
    return RunLabels(
        names=tuple(names),
        letters=tuple(letters.get(name, "") for name in names),
        colours=tuple(colours.get(name, STABLE_COLOUR) for name in names),
        meanings=tuple(LABELS[name].meaning if name in LABELS else "" for name in names),
        counts=tuple(np.bincount(placed, minlength=len(names)).tolist()),
        codes=placed,
        masks=masks,
        every=every,
    )


def _letters(names: list[str]) -> list[str]:
    """Return a letter of each name that no name before it has; a digit where none is left."""
    taken: list[str] = []
    for name in names:
        wanted = [*name.upper().replace("_", ""), *"ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"]
        taken.append(next(letter for letter in wanted if letter not in taken))
    return taken


def _colour(rank: int) -> str:
    return COLOURS[_ORDER[rank]] if rank < len(_ORDER) else REST
