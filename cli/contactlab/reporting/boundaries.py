"""Boundaries that a refined sweep found: the sides of each point of its grid, run or inferred."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from contactlab.measure import labels_with
from contactlab.plan.refined_axes import stride_of
from contactlab.plan.refinement import (
    UNKNOWN,
    Codes,
    filled,
    halved,
    lattices,
    least_met,
)
from contactlab.plan.sides import read_by, side_of
from contactlab.schema.evidence import WholeGrid
from contactlab.schema.sweep_schema import Refine
from contactlab.store.finished_store import Store

_Told = TypeVar("_Told", str, tuple[str, ...])
_MOST_LINES, _MOST_LAYERS = 8, 4
_SIDES = {
    "outcome": {True: "stable", False: "not stable"},
    "must": {True: "as required", False: "not as required"},
}


@dataclass(frozen=True)
class Sides:
    """The grid of one seed, all but the refined axes being equal.

    Attributes:
        shared: the values of the other axes by name, and the seed.
        names: of the sides.
        codes: (n, ...) the side of each point; UNKNOWN where no run is.
        ran: (n, ...) whether it ran; others are inferred from the cell that they lie in.
    """

    shared: Mapping[str, object]
    names: tuple[str, ...]
    codes: Codes
    ran: NDArray[np.bool_]


@dataclass(frozen=True)
class Boundaries:
    """What a refined sweep found, by seed and by the values of the other axes."""

    where: str
    grid: WholeGrid
    units: tuple[str, ...]  # of the refined axes
    sides: tuple[Sides, ...]


def boundaries(store: Store) -> Boundaries | None:
    """Return the boundaries that a store's sweep was refined for; None of one that was not."""
    identity = store.manifest.sweep
    if identity.whole is None or not identity.whole.axes:
        return None
    refine = Refine.model_validate(identity.resolved["refine"])
    stride, columns, axes = stride_of(refine), store.columns, identity.whole.axes
    assert stride is not None
    names = [*columns.axis_names, "seed"]
    rows = columns.arrow([*dict.fromkeys([*names, *read_by(refine.where)])]).to_pylist()
    side = side_of(refine.where, labels_with("required"))
    coded = dict[object, int]()
    of_runs = np.array([coded.setdefault(side(row), len(coded)) for row in rows], np.int32)
    settings = ({name: row[name] for name in columns.axis_names} for row in rows)
    runs = (
        (place, values, row["seed"])
        for place, (values, row) in enumerate(zip(settings, rows, strict=True))
    )
    found = list[Sides]()
    for lattice in lattices(runs, axes):
        ran = lattice.places != UNKNOWN
        codes = np.where(ran, of_runs[lattice.places], UNKNOWN)
        shared = {**lattice.shared, "seed": lattice.seed}
        whole = filled(codes, halved(codes, stride).cells)
        found.append(Sides(shared, _named(refine.where, coded), whole, ran))
    units = tuple(columns.described[name].unit for name in axes)
    return Boundaries(refine.where, identity.whole, units, tuple(found))


def _named(where: str, sides: Mapping[object, int]) -> tuple[str, ...]:
    """Return the sides in words."""
    words = _SIDES.get(where, {True: where, False: f"not {where}"})
    return tuple(
        str(side)
        if where == "label"
        else words.get(side is True, "")
        if side is not None
        else "not measured"
        for side in sides
    )


def coverage(found: Boundaries) -> str:
    """Return which share of a grid ran, and which islands that may have missed, in a sentence."""
    grid, ran = found.grid, sum(int(one.ran.sum()) for one in found.sides)
    inferred = grid.inside - grid.probes
    told = (
        f"{ran:,} of the grid's {grid.runs:,} runs were made; {inferred:,} are inferred from the "
        "corners of their cells"
    )
    met = least_met(grid.inside, grid.probes)
    if met is None:
        return f"{told}, and none of those was probed"
    return (
        f"{told}; {grid.probes:,} probes within those agree, and would have met an island of "
        f"{met:,} runs or more with 95 %"
    )


def boundary_lines(found: Boundaries) -> Iterator[str]:
    """Yield where outcomes change along the first refined axis, by the values of the others."""
    name, values = next(iter(found.grid.axes.items()))
    for sides in found.sides[:_MOST_LINES]:
        if len(found.sides) > 1:
            yield ", ".join(f"{name} {_shown(value)}" for name, value in sides.shared.items())
        if sides.codes.ndim == 1:
            yield _sequence(sides, sides.codes, values, name, found.units[0])
        elif sides.codes.ndim == 2:
            yield from _by_second(found, sides, sides.codes)
        else:
            yield from _by_third(found, sides)
    if len(found.sides) > _MOST_LINES:
        yield f"and {len(found.sides) - _MOST_LINES:,} more grids, of other seeds or settings"


def _by_second(found: Boundaries, sides: Sides, codes: Codes) -> Iterator[str]:
    first, second = ((name, values) for name, values in [*found.grid.axes.items()][:2])
    told = [
        _sequence(sides, codes[:, column], first[1], first[0], found.units[0])
        for column in range(codes.shape[1])
    ]
    for span, line in _alike(told, second[1], _MOST_LINES):
        yield f"{second[0]} {span}{_unit(found.units[1])}: {line}"


def _by_third(found: Boundaries, sides: Sides) -> Iterator[str]:
    name, values = [*found.grid.axes.items()][2]
    told = [
        tuple(_by_second(found, sides, sides.codes[:, :, layer]))
        for layer in range(sides.codes.shape[2])
    ]
    for span, lines in _alike(told, values, _MOST_LAYERS):
        yield f"{name} {span}{_unit(found.units[2])}:"
        yield from (f"  {line}" for line in lines)


def _alike(
    told: Sequence[_Told], values: Sequence[object], most: int
) -> Iterator[tuple[str, _Told]]:
    """Yield what is told of neighbouring values, once where it is equal, and of so many at most."""
    groups = [list(group) for _, group in groupby(range(len(told)), key=told.__getitem__)]
    shown = np.unique(np.linspace(0, len(groups) - 1, most).round().astype(int))
    for place in shown[: len(groups)].tolist():
        first, last = (values[groups[place][end]] for end in (0, -1))
        span = _shown(first) if first == last else f"{_shown(first)} to {_shown(last)}"
        yield span, told[groups[place][0]]


def _sequence(sides: Sides, codes: Codes, values: Sequence[object], name: str, unit: str) -> str:
    """Return the sides along an axis: `stable up to timestep 4.1 to 4.3 s, then tunneling`."""
    changes = np.flatnonzero(codes[1:] != codes[:-1]).tolist()
    if not changes:
        return f"{sides.names[codes[0]]} throughout"
    parts = [
        f"{sides.names[codes[step]]} up to {name} {_shown(values[step])} to "
        f"{_shown(values[step + 1])}{_unit(unit)}"
        for step in changes
    ]
    return ", then ".join([*parts, sides.names[codes[changes[-1] + 1]]])


def _unit(unit: str) -> str:
    return f" {unit}" if unit not in ("", "1") else ""


def _shown(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
