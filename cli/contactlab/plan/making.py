"""From the parts of a sweep file to its plan: filters, counts and what looks wrong."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from contactlab.plan.diagnostic import Place, Source
from contactlab.plan.document import Document
from contactlab.plan.names import Context
from contactlab.plan.override import Filter, check_values
from contactlab.plan.parts import Parts
from contactlab.plan.plan import MOST_RUNS, Plan, SweptAxis
from contactlab.plan.rows import Block, Grid, Match
from contactlab.schema import Role, Sweep, role


def made_plan(
    context: Context, parts: Parts, filters: Sequence[Filter], limit: int | None
) -> Plan | None:
    """Return the plan of a file without mistakes, or None if the plan itself shows some.

    Raises:
        SweepMistakesError: an expression cannot be computed for some row.
    """
    document, sweep = context.document, context.sweep
    values = parts.values()
    for match, _ in parts.expected:
        _warn_unmet(document, match, values)
    check_values(document, filters, values)
    if document.has_errors:
        return None
    left = parts
    for each in filters:
        left = _filtered(left, each)
    grid = Grid(left.base, left.blocks, left.excludes, left.added)
    runs = _count(document, grid, len(sweep.seed_values), limit, warn=not filters)
    if runs is None:
        return None
    warnings = tuple(each for each in document.found if each.severity == "warning")
    return Plan(sweep, _axes(sweep, left), runs, warnings, grid, parts.expected)


def _filtered(parts: Parts, each: Filter) -> Parts:
    rows = (row for row in parts.added if (parts.base | row).get(each.name) in each.values)
    blocks = parts.blocks
    if blocks is not None:
        in_block = any(each.name in block.names for block in blocks)
        if in_block:
            blocks = tuple(_filtered_block(block, each) for block in blocks)
        elif parts.base.get(each.name) not in each.values:
            blocks = None
    return replace(parts, blocks=blocks, added=tuple(rows))


def _filtered_block(block: Block, each: Filter) -> Block:
    if each.name not in block.names:
        return block
    index = block.names.index(each.name)
    return Block(block.names, tuple(row for row in block.rows if row[index] in each.values))


def _count(
    document: Document, grid: Grid, seeds: int, limit: int | None, *, warn: bool
) -> int | None:
    """Return the number of runs, or None if there are none or too many."""
    if limit is not None and limit < 1:
        place = Place(Source("command line", (f"--limit {limit}",), numbered=False), 1, 9, 9)
        document.add("bad-option", place, "the limit is at least 1 run")
        return None
    most = math.inf if limit is None else limit
    if grid.excludes and grid.product_size > MOST_RUNS:
        return _note_too_many(document, grid.product_size, "rows before `exclude`")
    rows, unmet = grid.count(most / seeds)
    runs = int(min(rows * seeds, most))
    if runs > MOST_RUNS:
        return _note_too_many(document, runs, "runs")
    for match in unmet if warn else ():
        document.add("unmatched-exclude", match.place, "excludes no run", severity="warning")
    if rows == 0:
        document.add("no-runs", document.key(("exclude",)), "no runs are left")
    return runs or None


def _note_too_many(document: Document, count: int, what: str) -> None:
    message = f"{count:,} {what}; a sweep takes at most {MOST_RUNS:,}"
    document.add("too-many-runs", document.key(("axes",)), message, "use `sample` or fewer values")


def _warn_unmet(
    document: Document, match: Match, values: Mapping[str, Mapping[object, None]]
) -> None:
    for name, value in match.settings:
        if value not in values.get(name, ()):
            message = f"no run has {name} = {value}, so nothing is expected here"
            document.add("unmatched-expect", match.place, message, severity="warning")


def _axes(sweep: Sweep, parts: Parts) -> tuple[SweptAxis, ...]:
    roles: dict[str, Role] = {}
    for axes in (sweep.axes, *sweep.zip):
        roles |= {name: role(axis) for name, axis in axes.items()}
    return tuple(
        SweptAxis(name, roles.get(name, "knob"), tuple(values))
        for name, values in parts.values().items()
        if name not in parts.base
    )
