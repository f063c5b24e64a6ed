"""Rows from a CSV file, with the place of every cell."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from contactlab.plan.diagnostic import Place, Source
from contactlab.plan.document import Document, KeyPath

# One cell and what ends it: a quoted text, in which "" stands for a quote, or what has no comma.
_CELL = re.compile(r'\s*(?:"((?:[^"]|"")*)"|([^,]*?))\s*(,|$)')


@dataclass(frozen=True)
class Cell:
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
class Table:
    """A CSV file: the cells of its first line, and of every further one."""

    header: tuple[Cell, ...]
    rows: tuple[tuple[Cell, ...], ...]


def read_table(document: Document, at: KeyPath, path: Path) -> Table:
    """Read a CSV file, noting its mistakes in the document that names it at a path."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        document.add("bad-table", at, f"cannot read {path}: {reason}")
        return Table((), ())
    source = Source(str(path), tuple(text.splitlines()))
    lines = [number for number, line in enumerate(source.lines, 1) if line.strip()]
    if len(lines) < 2:
        document.add("bad-table", at, f"{path} has no rows", "first line: axes; then a row a line")
        return Table((), ())
    header = tuple(Cell(text, text, place) for text, place in _cells(source, lines[0]))
    rows = (_row(document, header, source, number) for number in lines[1:])
    return Table(_named_once(document, header), tuple(row for row in rows if row))


def _cells(source: Source, number: int) -> Iterator[tuple[str, Place]]:
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


def _named_once(document: Document, header: tuple[Cell, ...]) -> tuple[Cell, ...]:
    seen: set[str] = set()
    for cell in header:
        if not cell.name:
            document.add("bad-table", cell.place, "a column without a name")
        elif cell.name in seen:
            document.add("bad-table", cell.place, f"a second column '{cell.name}'")
        seen.add(cell.name)
    return header


def _row(
    document: Document, header: tuple[Cell, ...], source: Source, number: int
) -> tuple[Cell, ...]:
    cells = list(_cells(source, number))
    if len(cells) != len(header):
        place = Place(source, number, 1, len(source.lines[number - 1]))
        wording = f"{len(cells)} cells under {len(header)} columns"
        document.add("bad-table", place, wording, "quote a cell that holds a comma")
        return ()
    named = zip(header, cells, strict=True)
    return tuple(Cell(top.name, _scalar(text), place) for top, (text, place) in named if text)


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
