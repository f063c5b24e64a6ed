"""Boundaries that a refined sweep found: the sides of each point of its grid, run or inferred."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from contactlab.measure import labels_with
from contactlab.plan.refinement import (
    UNKNOWN,
    Codes,
    first_stride,
    group_lattices,
    halve_cells,
    infer_codes,
    smallest_detected_island,
)
from contactlab.plan.sides import fields_read_by, side_of
from contactlab.rendering.amounts import format_setting
from contactlab.reporting.report_columns import in_small_units, number_with_unit
from contactlab.schema.evidence import WholeGrid
from contactlab.schema.sweep_schema import Limit
from contactlab.store.finished_store import Store
from contactlab.store.store_files import stored_sweep

_SIDES = {
    "outcome": {True: "stable", False: "not stable"},
    "must": {True: "as required", False: "not as required"},
}
_SOUND = {words[True] for words in _SIDES.values()}


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
    """Boundaries of a refined sweep, by seed and by the values of the other axes."""

    where: str
    grid: WholeGrid
    units: tuple[str, ...]  # of the refined axes
    sides: tuple[Sides, ...]
    limit: Limit | None = None  # the requested end of the passing values


def find_boundaries(store: Store) -> Boundaries | None:
    """Return the boundaries of a store with a refined sweep; None for other sweeps."""
    identity = store.manifest.sweep
    if identity.whole is None or not identity.whole.axes:
        return None
    sweep = stored_sweep(identity)
    refine = sweep.refining
    assert refine is not None
    stride, columns, axes = first_stride(refine), store.columns, identity.whole.axes
    assert stride is not None
    names = [*columns.axis_names, "seed"]
    rows = columns.read_arrow([*dict.fromkeys([*names, *fields_read_by(refine.where)])]).to_pylist()
    side = side_of(refine.where, labels_with("required"))
    coded = dict[object, int]()
    of_runs = np.array([coded.setdefault(side(row), len(coded)) for row in rows], np.int32)
    settings = ({name: row[name] for name in columns.axis_names} for row in rows)
    runs = (
        (place, values, row["seed"])
        for place, (values, row) in enumerate(zip(settings, rows, strict=True))
    )
    words = _SIDES.get(refine.where, {True: refine.where, False: f"not {refine.where}"})
    names_of_sides = tuple(
        str(side)
        if refine.where == "label"
        else words.get(side is True, "")
        if side is not None
        else "not measured"
        for side in coded
    )
    all_sides = list[Sides]()
    for lattice in group_lattices(runs, axes):
        ran = lattice.places != UNKNOWN
        codes = np.where(ran, of_runs[lattice.places], UNKNOWN)
        shared = {**lattice.shared, "seed": lattice.seed}
        whole = infer_codes(codes, halve_cells(codes, stride).cells)
        all_sides.append(Sides(shared, names_of_sides, whole, ran))
    units = tuple(columns.described[name].unit for name in axes)
    return Boundaries(refine.where, identity.whole, units, tuple(all_sides), sweep.limit)


def describe_coverage(boundaries: Boundaries) -> str:
    """Return a sentence on the share of a grid that ran, and on the size of missed islands."""
    grid, ran = boundaries.grid, sum(int(one.ran.sum()) for one in boundaries.sides)
    inferred = grid.inside - grid.probes
    coverage = (
        f"{ran:,} of the grid's {grid.runs:,} runs were made; {inferred:,} are inferred from the "
        "corners of their cells"
    )
    island = smallest_detected_island(grid.inside, grid.probes)
    if island is None:
        return f"{coverage}, and none of those was probed"
    return (
        f"{coverage}; {grid.probes:,} probes within those agree, and would have met an island of "
        f"{island:,} runs or more with 95 %"
    )


def boundary_lines(boundaries: Boundaries) -> Iterator[str]:
    """Yield where outcomes change along the first refined axis, by the values of the others."""
    if boundaries.limit is not None:
        yield from _limit_lines(boundaries, boundaries.limit)
        return
    most_grids = 8
    axes = [
        _AxisText.of(*axis)
        for axis in zip(boundaries.grid.axes.items(), boundaries.units, strict=True)
    ]
    for sides in boundaries.sides[:most_grids]:
        if len(boundaries.sides) > 1:
            yield ", ".join(
                f"{name} {format_setting(value, 4)}" for name, value in sides.shared.items()
            )
        yield from _axis_lines(axes, sides.names, sides.codes)
    if len(boundaries.sides) > most_grids:
        yield f"and {len(boundaries.sides) - most_grids:,} more grids, of other seeds or settings"


@dataclass(frozen=True)
class _AxisText:
    """An axis as text: its values, in ms and mm if all are small, and their unit."""

    name: str
    values: Sequence[str]
    unit: str

    @classmethod
    def of(cls, axis: tuple[str, Sequence[object]], unit: str) -> "_AxisText":
        name, values = axis
        if all(isinstance(value, float | int) for value in values):
            small, unit = in_small_units(np.array(values, float), unit)
            return cls(name, [f"{value:.4g}" for value in small.tolist()], unit)
        return cls(name, [*map(str, values)], unit)

    def at(self, *places: int) -> str:
        """Return `4.1 to 4.3 ms`."""
        return number_with_unit(" to ".join(self.values[place] for place in places), self.unit)

    def where(self, first: int, last: int) -> str:
        """Return `for friction.slide of 0.3 or more`."""
        end = len(self.values) - 1
        if (first, last) == (0, end):
            return f"for any {self.name}"
        if first == last:
            return f"for {self.name} of {self.at(first)}"
        if last == end:
            return f"for {self.name} of {self.at(first)} or more"
        return (
            f"for {self.name} of {self.at(first, last)}"
            if first
            else (f"for {self.name} of {self.at(last)} or less")
        )


def _axis_lines(axes: Sequence[_AxisText], names: Sequence[str], codes: Codes) -> Iterator[str]:
    """Yield the changes of sides along the first axis, once for equal values of the last."""
    *_, last = axes
    if codes.ndim == 1:
        # Such as `stable up to timestep 4.1 to 4.3 ms, then tunneling`.
        changes: list[int] = np.flatnonzero(codes[1:] != codes[:-1]).tolist()
        places: list[int] = codes.tolist()
        sides = [names[place] for place in places]
        parts = [f"{sides[step]} up to {last.name} {last.at(step, step + 1)}" for step in changes]
        yield ", then ".join([*parts, sides[-1]]) if changes else f"{sides[0]} throughout"
        return
    layers = np.moveaxis(codes, -1, 0)
    layer_lines = [tuple(_axis_lines(axes[:-1], names, layer)) for layer in layers]
    groups = [
        list(group) for _, group in groupby(range(len(layer_lines)), key=layer_lines.__getitem__)
    ]
    most_groups = 8 if codes.ndim == 2 else 4
    shown_groups = np.unique(np.linspace(0, len(groups) - 1, most_groups).round().astype(int))
    for place in shown_groups[: len(groups)].tolist():
        first, lines = groups[place][0], layer_lines[groups[place][0]]
        where = last.where(first, groups[place][-1])
        if codes.ndim == 2:
            yield f"{lines[0]}, {where}"
            continue
        yield f"{where}:"
        yield from (f"  {line}" for line in lines)


def _limit_lines(boundaries: Boundaries, limit: Limit) -> Iterator[str]:
    """Yield the last passing value of an axis in each scenario, over all seeds, and in all of them.

    Values count as long as all before them pass.
    """
    (values,) = boundaries.grid.axes.values()
    axis = _AxisText.of((limit.axis, values), boundaries.units[0])
    sound = dict[tuple[tuple[str, object], ...], NDArray[np.bool_]]()
    for sides in boundaries.sides:
        scenario = tuple(item for item in sides.shared.items() if item[0] != "seed")
        good = np.array(
            [name in _SOUND or name == f"not {boundaries.where}" for name in sides.names]
        )
        sound[scenario] = sound.get(scenario, np.bool_(True)) & good[sides.codes]
    inwards = (
        slice(None)
        if (values[0] < values[-1]) == (limit.largest is not None)
        else slice(None, None, -1)
    )
    order = np.arange(len(values))[inwards].tolist()
    counts = {
        scenario: int(np.argmin(np.append(good[order], False))) for scenario, good in sound.items()
    }
    most_limits = 12
    for scenario, count in [*counts.items()][:most_limits]:
        of = ", ".join(f"{name} {format_setting(value, 4)}" for name, value in scenario)
        yield f"{_limit_line(axis, limit, order, count)}{f', for {of}' if of else ''}"
        if again := int(sound[scenario][order[count:]].sum()):
            yield f"  beyond it {again:,} of {len(order) - count:,} pass again"
    if len(counts) > most_limits:
        yield f"and {len(counts) - most_limits:,} more scenarios"
    if len(counts) > 1:
        yield f"in all {len(counts):,}: {_limit_line(axis, limit, order, min(counts.values()))}"


def _limit_line(axis: _AxisText, limit: Limit, order: Sequence[int], count: int) -> str:
    """Return `largest passing timestep: 4.1 ms; 4.3 ms fails`."""
    sought = f"{'largest' if limit.largest else 'smallest'} passing {axis.name}"
    if not count:
        return f"{sought}: none, because {axis.at(order[0])} fails"
    if count == len(order):
        return f"{sought}: {axis.at(order[-1])}, the last of the sweep"
    return f"{sought}: {axis.at(order[count - 1])}; {axis.at(order[count])} fails"
