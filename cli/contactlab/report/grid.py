"""The axes of a store's runs, as places in a grid."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats
from contactlab.schema import Role, Sweep, role
from contactlab.store import RunColumns, Store

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
        return titled(self.name, self.unit)


def titled(name: str, unit: str) -> str:
    """Return a name with its unit, where it has one."""
    return name if unit in {"", "1", "any"} else f"{name} [{unit}]"


def read_grid(store: Store) -> tuple[GridAxis, ...]:
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
        codes, words = columns.words(name)
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
    return GridAxis(name, unit, kind, _words(values), places, None, values)


def _words(values: Floats) -> tuple[str, ...]:
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
    return {**{name: role(axis) for name, axis in named}, SEED: "scenario"}


def combined(axes: Sequence[GridAxis], runs: int) -> Codes:
    """Return (n,) one number for each combination of values of some axes."""
    codes = np.zeros(runs, dtype=np.int64)
    for axis in axes:
        codes = codes * len(axis.words) + axis.codes
    return codes
