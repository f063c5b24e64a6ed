"""Rows of `include`: written in the sweep file, or in a CSV file, with the place of every cell."""

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from contactlab.plan.diagnostics import Place, SourceText
from contactlab.plan.grid import RowValues
from contactlab.plan.names import SweepContext, check_axis, check_conflicts
from contactlab.plan.yaml_document import Document, KeyPath
from contactlab.schema import IncludeFile

# One cell and what ends it: a quoted text, in which "" stands for a quote, or what has no comma.
_CELL = re.compile(r'\s*(?:"((?:[^"]|"")*)"|([^,]*?))\s*(,|$)')


@dataclass(frozen=True)
class CsvCell:
    """One value of a table.

    Attributes:
        name: the axis that its column is for.
        value: a number, a truth value or a word; empty cells are left out.
        place: where it stands.
    """

    name: str
    value: object
    place: Place


@dataclass(frozen=True)
class CsvTable:
    """A CSV file: the cells of its first line, and of every further one."""

    header: tuple[CsvCell, ...]
    rows: tuple[tuple[CsvCell, ...], ...]


def read_csv(document: Document, at: KeyPath, path: Path) -> CsvTable:
    """Read a CSV file; add its mistakes to the document that names it."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        document.add("bad-table", at, f"cannot read {path}: {reason}")
        return CsvTable((), ())
    source = SourceText(str(path), tuple(text.splitlines()))
    lines = [number for number, line in enumerate(source.lines, 1) if line.strip()]
    if len(lines) < 2:
        document.add(
            "bad-table",
            at,
            f"{path} has no rows",
            "the first line names the axes, each further line is a row",
        )
        return CsvTable((), ())
    header = tuple(CsvCell(text, text, place) for text, place in _cells(source, lines[0]))
    rows = (_row(document, header, source, number) for number in lines[1:])
    return CsvTable(_named_once(document, header), tuple(row for row in rows if row))


def _cells(source: SourceText, number: int) -> Iterator[tuple[str, Place]]:
    line, start = source.lines[number - 1], 0
    while found := _CELL.match(line, start):
        group = 2 if found.group(1) is None else 1
        text, begin = found.group(group), found.start(group)
        yield text.replace('""', '"'), Place(source, number, begin + 1, max(len(text), 1))
        start = found.end()
        if not found.group(3):
            return
    rest = Place(source, number, start + 1, max(len(line) - start, 1))
    yield line[start:], rest


def _named_once(document: Document, header: tuple[CsvCell, ...]) -> tuple[CsvCell, ...]:
    seen: set[str] = set()
    for cell in header:
        if not cell.name:
            document.add("bad-table", cell.place, "a column without a name")
        elif cell.name in seen:
            document.add("bad-table", cell.place, f"a second column '{cell.name}'")
        seen.add(cell.name)
    return header


def _row(
    document: Document, header: tuple[CsvCell, ...], source: SourceText, number: int
) -> tuple[CsvCell, ...]:
    cells = list(_cells(source, number))
    if len(cells) != len(header):
        place = Place(source, number, 1, len(source.lines[number - 1]))
        wording = f"{len(cells)} cells under {len(header)} columns"
        document.add("bad-table", place, wording, "quote a cell that holds a comma")
        return ()
    named = zip(header, cells, strict=True)
    return tuple(CsvCell(top.name, _scalar(text), place) for top, (text, place) in named if text)


def _scalar(text: str) -> object:
    """Return what a cell means: a number, true or false, or the word itself."""
    if text.lower() in {"true", "false"}:
        return text.lower() == "true"
    for read in (int, float):
        try:
            return read(text)
        except ValueError:
            continue
    return text


def read_rows(context: SweepContext, folder: Path) -> tuple[RowValues, ...]:
    """Return the rows to include, with canonical values; add their mistakes to the document.

    Args:
        context: the file and its names.
        folder: what the path of a CSV file is relative to.
    """
    include = context.sweep.include
    if isinstance(include, IncludeFile):
        return _table_rows(context, folder / include.file)
    rows: list[RowValues] = []
    for index, row in enumerate(include):
        path = context.draft.path("include", index)
        keys = {name: context.document.key((*path, name)) for name in row}
        for name, place in keys.items():
            check_axis(context, name, place)
        cells = [
            CsvCell(name, value, context.document.value((*path, name)))
            for name, value in row.items()
        ]
        check_conflicts(context, keys)
        rows.append(_canonical_row(context, cells))
    return tuple(rows)


def _table_rows(context: SweepContext, path: Path) -> tuple[RowValues, ...]:
    table = read_csv(context.document, ("include", "file"), path)
    for cell in filter(_has_name, table.header):
        check_axis(context, cell.name, cell.place)
    check_conflicts(context, {cell.name: cell.place for cell in table.header})
    return tuple(_canonical_row(context, cells) for cells in table.rows)


def _has_name(cell: CsvCell) -> bool:
    return bool(cell.name)


def _canonical_row(context: SweepContext, cells: Collection[CsvCell]) -> RowValues:
    return {cell.name: context.canonical(cell.name, cell.value, cell.place) for cell in cells}
