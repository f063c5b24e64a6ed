"""The runs of a sweep, in a fixed order: the product of its axes, minus `exclude`, plus `include`.

Rows are streamed: even a plan of a million runs does not hold them in memory.
"""

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import cast

from contactlab.expression import Expression, ExpressionError, NoValueError
from contactlab.plan.diagnostics import Diagnostic, Place, SweepMistakesError
from contactlab.schema.sweep_schema import Expectation, Sweep
from contactlab.schema.vocabulary import Role

CONFIRM_ABOVE = 100_000
MOST_RUNS = 10_000_000

RowValues = dict[str, object]
Split = Callable[[object], Mapping[str, float]]


@dataclass(frozen=True)
class Block:
    """A factor of the product: axes that advance together, with a tuple of values for each row."""

    names: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]

    def column_values(self, name: str) -> tuple[object, ...]:
        """Return the values of one of its axes, row by row."""
        return tuple(map(itemgetter(self.names.index(name)), self.rows))

    def filter_rows(self, name: str, values: Collection[object]) -> "Block":
        """Return only the rows with one of some values of an axis, if the block has the axis."""
        if name not in self.names:
            return self
        index = self.names.index(name)
        return Block(self.names, tuple(row for row in self.rows if row[index] in values))


@dataclass(frozen=True)
class Match:
    """A condition on a row: values of settings, and an expression that must be true."""

    settings: tuple[tuple[str, object], ...]  # canonical values by axis
    expression: Expression | None  # a further condition, if any
    place: Place
    inside: Place | None = None  # place of the expression's first character, if known
    splits: tuple[tuple[str, Split], ...] = ()
    """Functions that split the values of axes into the parts that the expression may name."""

    def is_met(self, row: Mapping[str, object]) -> bool:
        """Return whether a row meets the condition; a row without one of the axes does not.

        A SweepMistakesError says that the expression cannot be computed for this row.
        """
        if any(name not in row or row[name] != value for name, value in self.settings):
            return False
        if self.expression is None:
            return True
        try:
            return bool(self.expression.evaluate(self._with_parts(row)))
        except NoValueError:
            return False
        except ExpressionError as error:
            raise SweepMistakesError([self._computation_failure(error, row)]) from error

    def _with_parts(self, row: Mapping[str, object]) -> Mapping[str, object]:
        """Return the row with the parts of its values that the expression may name."""
        parts: RowValues = {}
        for name, split in self.splits:
            if name in row:
                parts |= split(row[name])
        return {**parts, **row} if parts else row

    def _computation_failure(self, error: ExpressionError, row: Mapping[str, object]) -> Diagnostic:
        place = self.inside.narrow_range(error.start, error.width) if self.inside else self.place
        names = cast("Expression", self.expression).names
        all_values = self._with_parts(row)
        values = ", ".join(f"{name} = {all_values[name]}" for name in names)
        return Diagnostic("bad-expression", str(error), place, f"at {values}" if values else "")


@dataclass(frozen=True)
class Grid:
    """All rows of a sweep, streamed."""

    base: RowValues  # settings of every row
    blocks: tuple[Block, ...] | None
    """Factors of the product, the last one fastest; None without a product."""
    excludes: tuple[Match, ...]  # conditions on rows of the product to leave out
    included_rows: tuple[RowValues, ...]  # rows to include
    baseline_rows: tuple[RowValues, ...] = ()  # rows of the scene as written, one for each scenario

    @property
    def names(self) -> tuple[str, ...]:
        """The axes of any row, in order, including effects of all rows."""
        blocks = (block.names for block in self.blocks or () if block.rows)
        return tuple(dict.fromkeys(itertools.chain(*blocks, self.base, *self.included_rows)))

    def axis_values(self, name: str) -> tuple[object, ...]:
        """Return the values of an axis in any row, each once, in order."""
        values = dict[object, None]()
        for block in self.blocks or ():
            if name in block.names:
                values.update(dict.fromkeys(block.column_values(name)))
        rows = (row for row in (self.base, *self.included_rows) if name in row)
        return tuple(values | dict.fromkeys(row[name] for row in rows))

    def product_values(self, name: str) -> tuple[object, ...]:
        """Return the values of an axis in the product, in order; in any row without one."""
        for block in self.blocks or ():
            if name in block.names:
                return block.column_values(name)
        return self.axis_values(name)

    def filter_rows(self, name: str, values: Collection[object]) -> "Grid":
        """Return the grid with only the rows with one of some values of an axis."""
        added = tuple(row for row in self.included_rows if (self.base | row).get(name) in values)
        blocks = self.blocks
        if blocks and any(name in block.names for block in blocks):
            blocks = tuple(block.filter_rows(name, values) for block in blocks)
        elif self.base.get(name) not in values:
            blocks = None
        return replace(self, blocks=blocks, included_rows=added)

    def with_baseline(self, scenario: Sequence[str]) -> "Grid":
        """Return the grid with a row of the scene as written for each scenario of some axes."""
        rows = [
            {name: row[name] for name in scenario if name in row} for row in self.iterate_rows()
        ]
        distinct = {tuple(row.items()): row for row in rows}
        return replace(self, baseline_rows=tuple(distinct.values()))

    @property
    def product_size(self) -> int:
        """Number of rows of the product before the exclusion of any."""
        return 0 if self.blocks is None else math.prod(len(block.rows) for block in self.blocks)

    def iterate_rows(self) -> Iterator[RowValues]:
        """Yield every row, in order."""
        if self.excludes:
            yield from (row for row in self._product_rows() if not self._is_excluded(row))
        else:
            yield from self._product_rows()
        yield from (self.base | row for row in self.included_rows)
        yield from self.baseline_rows

    def count_rows(self, most: float = math.inf) -> tuple[int, Sequence[Match]]:
        """Return the number of rows, counted up to `most`, and the excludes that match none."""
        further = len(self.included_rows) + len(self.baseline_rows)
        if not self.excludes:
            return self.product_size + further, ()
        included, unmatched = 0, list(self.excludes)
        for row in self._product_rows():
            if unmatched:
                matched = [exclude for exclude in self.excludes if exclude.is_met(row)]
                unmatched = (
                    [condition for condition in unmatched if condition not in matched]
                    if matched
                    else unmatched
                )
                included += not matched
            else:
                included += not self._is_excluded(row)
            if included >= most:
                return included, ()
        return included + further, unmatched

    def _product_rows(self) -> Iterator[RowValues]:
        if self.blocks is None:
            return
        base, join = self.base, itertools.chain.from_iterable
        names = tuple(join(block.names for block in self.blocks))
        for parts in itertools.product(*(block.rows for block in self.blocks)):
            row = dict(zip(names, join(parts), strict=True))
            yield base | row if base else row

    def _is_excluded(self, row: RowValues) -> bool:
        return any(exclude.is_met(row) for exclude in self.excludes)


@dataclass(frozen=True)
class SweptAxis:
    """One axis of a plan, with its canonical values, each once, in order."""

    name: str
    role: Role
    values: tuple[object, ...]

    @property
    def count(self) -> int:
        """Number of different values."""
        return len(self.values)


@dataclass(frozen=True, slots=True)
class Run:
    """One planned rollout."""

    index: int  # its position in the plan, from 0
    values: Mapping[str, object]
    """Canonical settings by axis, with the sweep's effects. Treat it as read-only, since the seeds
    of one row share it. Absent settings keep the scene's value."""
    seed: int  # seeds the scene's perturbation


@dataclass(frozen=True, slots=True)
class Row:
    """The runs of one row of settings, one for each seed; `first` is the index of the first run."""

    first: int
    values: Mapping[str, object]
    seeds: Sequence[int]


Expected = tuple[tuple[Match, Expectation], ...]
"""Conditions of `expect`, each with its expectation."""


@dataclass(frozen=True)
class Plan:
    """The runs that a sweep file and the options of the command line define."""

    sweep: Sweep
    axes: tuple[SweptAxis, ...]  # the slowest to advance first
    count: int
    warnings: tuple[Diagnostic, ...]  # mistakes that do not stop the sweep
    grid: Grid
    expected: Expected

    def iterate_rows(self) -> Iterator[Row]:
        """Yield the rows: the product in the order written, then included rows, then baselines."""
        seeds = self.sweep.seed_values
        starts = range(0, self.count, len(seeds))
        # zip() stops at the last position, so later rows are never created.
        for first, values in zip(starts, self.grid.iterate_rows(), strict=False):
            yield Row(first, values, seeds[: self.count - first])

    def iterate_runs(self) -> Iterator[Run]:
        """Yield the runs, row by row, seeds innermost."""
        for row in self.iterate_rows():
            for index, seed in enumerate(row.seeds, row.first):
                yield Run(index, row.values, seed)


def find_expectations(expected: Expected, values: Mapping[str, object]) -> list[Expectation]:
    """Return the expectations that apply to a run with these settings."""
    return [expectation for match, expectation in expected if match.is_met(values)]
