"""What the sections of a sweep file say, in canonical values."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from contactlab.plan.blocks import read_blocks
from contactlab.plan.conditions import read_condition, read_rows
from contactlab.plan.names import Context
from contactlab.plan.rows import Block, Match, Row
from contactlab.schema import Condition, Expectation, switches


@dataclass(frozen=True)
class Parts:
    """The sections of a file that make its runs.

    Attributes:
        names: every axis that a run may carry, effects included.
        blocks: factors of the product; None where the file only lists rows.
        added: rows to include.
        excludes: conditions on rows to leave out.
        expected: conditions of `expect`, with what they ask for.
        base: settings of every run.
    """

    names: tuple[str, ...]
    blocks: tuple[Block, ...] | None
    added: tuple[Row, ...]
    excludes: tuple[Match, ...]
    expected: tuple[tuple[Match, Expectation], ...]
    base: Row

    def values(self) -> dict[str, dict[object, None]]:
        """Return the values that each axis takes anywhere, each once, in order."""
        found: dict[str, dict[object, None]] = {}
        for block in self.blocks or ():
            for name, column in zip(block.names, zip(*block.rows, strict=True), strict=False):
                found[name] = dict.fromkeys(column)
        for row in (self.base, *self.added):
            for name, value in row.items():
                found.setdefault(name, {})[value] = None
        return found


def read_parts(context: Context, folder: Path) -> Parts:
    """Read the sections of a file, noting their mistakes.

    Args:
        context: the file and its names.
        folder: what the path of a table of rows is relative to.
    """
    sweep = context.sweep
    blocks, added = read_blocks(context), read_rows(context, folder)
    base = {
        name: context.canonical(name, value, context.document.value(("effects", name)))
        for name, value in switches(sweep.effects).items()
    }
    product = tuple(dict.fromkeys([*(name for name, _ in context.swept()), *base]))
    names = tuple(dict.fromkeys([*product, *(name for row in added for name in row)]))
    wheres = (each.where for each in sweep.expect)
    expected = _matches(context, "expect", wheres, names, "where")
    excludes = _matches(context, "exclude", sweep.exclude, product)
    pairs = tuple(zip(expected, sweep.expect, strict=True))
    return Parts(names, blocks, added, excludes, pairs, base)


def _matches(
    context: Context, key: str, conditions: Iterable[Condition], names: tuple[str, ...], *below: str
) -> tuple[Match, ...]:
    return tuple(
        read_condition(context, condition, context.draft.path(key, index, *below), names)
        for index, condition in enumerate(conditions)
    )
