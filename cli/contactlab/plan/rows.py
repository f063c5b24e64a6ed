"""Rows of settings: the product of blocks, less what is excluded, and then what is included."""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from contactlab.expression import Expression, ExpressionError, NoValueError
from contactlab.plan.diagnostic import Diagnostic, Place, SweepMistakesError

Row = dict[str, object]
Split = Callable[[object], Mapping[str, float]]


@dataclass(frozen=True)
class Block:
    """Axes that advance together: one factor of the product.

    Attributes:
        names: the axes.
        rows: their values, one tuple a position.
    """

    names: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]


@dataclass(frozen=True)
class Match:
    """A condition on a row: settings that must be equal and an expression that must be true.

    Attributes:
        settings: canonical values by axis.
        expression: further condition, if any.
        place: where the condition stands.
        inside: where the expression's first character stands, if it can be told.
        splits: how the values of axes split into parts that the expression names.
    """

    settings: tuple[tuple[str, object], ...]
    expression: Expression | None
    place: Place
    inside: Place | None = None
    splits: tuple[tuple[str, Split], ...] = ()

    def holds(self, row: Mapping[str, object]) -> bool:
        """Tell whether a row meets the condition; an axis that it lacks meets none.

        Raises:
            SweepMistakesError: the expression cannot be computed for this row.
        """
        for name, value in self.settings:
            if name not in row or row[name] != value:
                return False
        if self.expression is None:
            return True
        try:
            return bool(self.expression.evaluate(self._with_parts(row)))
        except NoValueError:
            return False
        except ExpressionError as error:
            raise SweepMistakesError([self._failure(error, row)]) from error

    def _with_parts(self, row: Mapping[str, object]) -> Mapping[str, object]:
        """Return the row, and the parts of its values that the expression may name."""
        parts: Row = {}
        for name, split in self.splits:
            if name in row:
                parts |= split(row[name])
        return {**parts, **row} if parts else row

    def _failure(self, error: ExpressionError, row: Mapping[str, object]) -> Diagnostic:
        place = self.inside.part(error.start, error.width) if self.inside else self.place
        names = cast("Expression", self.expression).names
        known = self._with_parts(row)
        values = ", ".join(f"{name} = {known[name]}" for name in names)
        return Diagnostic("bad-expression", str(error), place, f"at {values}" if values else "")


@dataclass(frozen=True)
class Grid:
    """All rows of a sweep, streamed.

    Attributes:
        base: settings of every row.
        blocks: factors of the product, the last one fastest; None where there is no product.
        excludes: rows of the product to leave out.
        added: further rows.
    """

    base: Row
    blocks: tuple[Block, ...] | None
    excludes: tuple[Match, ...]
    added: tuple[Row, ...]

    @property
    def product_size(self) -> int:
        """Number of rows of the product, before any is left out."""
        return 0 if self.blocks is None else math.prod(len(block.rows) for block in self.blocks)

    def rows(self) -> Iterator[Row]:
        """Yield every row, in order."""
        if self.excludes:
            yield from (row for row in self._product() if not self._excluded(row))
        else:
            yield from self._product()
        yield from (self.base | row for row in self.added)

    def count(self, most: float = math.inf) -> tuple[int, Sequence[Match]]:
        """Return the number of rows, counted up to `most`, and the excludes that met none."""
        if not self.excludes:
            return self.product_size + len(self.added), ()
        left, unmet = 0, list(self.excludes)
        for row in self._product():
            if unmet:
                met = [each for each in self.excludes if each.holds(row)]
                unmet = [each for each in unmet if each not in met] if met else unmet
                left += not met
            else:
                left += not self._excluded(row)
            if left >= most:
                return left, ()
        return left + len(self.added), unmet

    def _product(self) -> Iterator[Row]:
        if self.blocks is None:
            return
        base, join = self.base, itertools.chain.from_iterable
        names = tuple(join(block.names for block in self.blocks))
        for parts in itertools.product(*(block.rows for block in self.blocks)):
            row = dict(zip(names, join(parts), strict=True))
            yield base | row if base else row

    def _excluded(self, row: Row) -> bool:
        return any(each.holds(row) for each in self.excludes)
