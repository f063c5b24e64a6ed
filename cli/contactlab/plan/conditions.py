"""Conditions of `exclude` and `expect`, and rows of `include`, with canonical values."""

from collections.abc import Collection
from pathlib import Path

from contactlab.errors import did_you_mean
from contactlab.expression import Expression, ExpressionError
from contactlab.plan.diagnostic import Place
from contactlab.plan.document import KeyPath
from contactlab.plan.names import Context, note_conflicts, note_unknown_axis
from contactlab.plan.rows import Match, Row
from contactlab.plan.table import Cell, read_table
from contactlab.schema import Condition, IncludeFile


def read_condition(
    context: Context, condition: Condition, path: KeyPath, known: Collection[str]
) -> Match:
    """Return a condition with canonical values, its mistakes noted.

    Args:
        context: the file and its names.
        condition: as written.
        path: where it stands.
        known: the axes that it may name.
    """
    document = context.document
    settings: list[tuple[str, object]] = []
    for name, raw in condition.settings.items():
        if name not in known:
            _note_not_swept(context, name, document.key((*path, name)), known)
            continue
        settings.append((name, context.canonical(name, raw, document.value((*path, name)))))
    expression, inside, splits = None, None, ()
    if condition.where is not None:
        inside = _inside(context, (*path, "where"), condition.where)
        specs = [spec for spec in map(context.find, known) if spec is not None]
        parts = {part for spec in specs for part in spec.parts}
        expression = _read_expression(context, condition.where, (*path, "where"), {*known, *parts})
        splits = tuple((spec.name, spec.split) for spec in specs if spec.split)
    return Match(tuple(settings), expression, document.value(path), inside, splits)


def read_rows(context: Context, folder: Path) -> tuple[Row, ...]:
    """Return the rows to include, with canonical values, their mistakes noted.

    Args:
        context: the file and its names.
        folder: what the path of a CSV file is relative to.
    """
    include = context.sweep.include
    if isinstance(include, IncludeFile):
        return _table_rows(context, folder / include.file)
    rows: list[Row] = []
    for index, row in enumerate(include):
        path = context.draft.path("include", index)
        keys = {name: context.document.key((*path, name)) for name in row}
        for name, place in keys.items():
            note_unknown_axis(context, name, place)
        cells = [
            Cell(name, value, context.document.value((*path, name))) for name, value in row.items()
        ]
        note_conflicts(context, keys)
        rows.append(_row(context, cells))
    return tuple(rows)


def _table_rows(context: Context, path: Path) -> tuple[Row, ...]:
    table = read_table(context.document, ("include", "file"), path)
    for cell in filter(_has_name, table.header):
        note_unknown_axis(context, cell.name, cell.place)
    note_conflicts(context, {cell.name: cell.place for cell in table.header})
    return tuple(_row(context, cells) for cells in table.rows)


def _has_name(cell: Cell) -> bool:
    return bool(cell.name)


def _row(context: Context, cells: Collection[Cell]) -> Row:
    return {cell.name: context.canonical(cell.name, cell.value, cell.place) for cell in cells}


def _read_expression(
    context: Context, text: str, path: KeyPath, known: Collection[str]
) -> Expression | None:
    inside = _inside(context, path, text)
    whole = context.document.value(path)
    try:
        expression = Expression(text)
    except ExpressionError as error:
        place = inside.part(error.start, error.width) if inside else whole
        context.document.add("bad-expression", place, str(error))
        return None
    for name, start in expression.places.items():
        if name not in known:
            place = inside.part(start, len(name)) if inside else whole
            _note_not_swept(context, name, place, known)
    return expression


def _inside(context: Context, path: KeyPath, text: str) -> Place | None:
    """Return where the first character of a text stands; None if it is written with escapes."""
    place = context.document.value(path)
    for skip in (0, 1):
        start = place.column - 1 + skip
        if place.text[start : start + len(text)] == text:
            return place.part(skip, 1)
    return None


def _note_not_swept(context: Context, name: str, place: Place, known: Collection[str]) -> None:
    specs = [context.find(each) for each in known]
    if any(spec and name in spec.choices for spec in specs):
        hint = f"quote the word: '{name}'"
    elif context.find(name):
        hint = "add it to `axes`"
    else:
        close = did_you_mean(name, known).removeprefix("; ")
        hint = close or f"swept here: {', '.join(known) or 'nothing'}"
    context.document.add("axis-not-swept", place, f"'{name}' is no axis of this sweep", hint)
