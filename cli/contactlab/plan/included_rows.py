"""Rows of `include`, from the sweep file itself or from a CSV file."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from contactlab.errors import SweepFileError
from contactlab.plan.diagnostics import Place, SourceText
from contactlab.plan.grid import RowValues
from contactlab.plan.names import SweepContext, check_axis, check_conflicts
from contactlab.plan.yaml_document import Document, read_text
from contactlab.schema.sweep_schema import IncludeFile

# One cell and what ends it: a quoted text, in which "" stands for a quote, or what has no comma.
_CELL = re.compile(r'\s*(?:"((?:[^"]|"")*)"|([^,]*?))\s*(,|$)')


@dataclass(frozen=True)
class CsvCell:
    """One cell: a value, and the axis of its column. Empty cells are left out."""

    name: str
    value: object
    place: Place


def read_rows(context: SweepContext, folder: Path) -> tuple[RowValues, ...]:
    """Return the rows to include, with canonical values; add their mistakes to the document.

    A CSV file lies in the sweep's folder or below: a sweep may come from a stranger.
    """
    include, document = context.sweep.include, context.document
    if isinstance(include, IncludeFile):
        header, *lines = _read_csv(document, folder, include.file) or [[]]
        _check_header(context, header)
        return tuple(
            {cell.name: context.canonical(cell.name, cell.value, cell.place) for cell in cells}
            for cells in lines
        )
    rows: list[RowValues] = []
    for index, row in enumerate(include):
        path = context.path("include", index)
        keys = {name: document.key((*path, name)) for name in row}
        for name, place in keys.items():
            check_axis(context, name, place)
        check_conflicts(context, keys)
        places = {name: document.value((*path, name)) for name in row}
        rows.append({name: context.canonical(name, row[name], places[name]) for name in row})
    return tuple(rows)


def _check_header(context: SweepContext, header: Iterable[CsvCell]) -> None:
    places: dict[str, Place] = {}
    for cell in header:
        if not cell.name:
            context.document.add("bad-table", cell.place, "a column without a name")
            continue
        if cell.name in places:
            context.document.add("bad-table", cell.place, f"a second column '{cell.name}'")
        check_axis(context, cell.name, cell.place)
        places[cell.name] = cell.place
    check_conflicts(context, places)


def _read_csv(document: Document, folder: Path, name: str) -> list[list[CsvCell]]:
    """Return the header of a CSV file and its rows, or nothing; add its mistakes to a document."""
    at, path = ("include", "file"), folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        document.add("bad-table", at, f"{path} lies outside of the sweep's folder", "put it there")
        return []
    if path.exists() and not path.is_file():
        document.add("bad-table", at, f"{path} is no file")
        return []
    try:
        source = SourceText(str(path), tuple(read_text(path).splitlines()))
    except SweepFileError as error:
        document.add("bad-table", at, str(error))
        return []
    numbers = [number for number, line in enumerate(source.lines, 1) if line.strip()]
    if len(numbers) < 2:
        hint = "the first line names the axes, each further line is a row"
        document.add("bad-table", at, f"{path} has no rows", hint)
        return []
    header = [CsvCell(text, text, place) for text, place in _cells(source, numbers[0])]
    rows = (_row(document, header, source, number) for number in numbers[1:])
    return [header, *(row for row in rows if row)]


def _cells(source: SourceText, number: int) -> Iterator[tuple[str, Place]]:
    line, start = source.lines[number - 1], 0
    while match := _CELL.match(line, start):
        group = 2 if match.group(1) is None else 1
        text, begin = match.group(group), match.start(group)
        yield text.replace('""', '"'), Place(source, number, begin + 1, max(len(text), 1))
        start = match.end()
        if not match.group(3):
            return
    rest = Place(source, number, start + 1, max(len(line) - start, 1))
    yield line[start:], rest


def _row(
    document: Document, header: Sequence[CsvCell], source: SourceText, number: int
) -> list[CsvCell]:
    cells = list(_cells(source, number))
    if len(cells) != len(header):
        place = Place(source, number, 1, len(source.lines[number - 1]))
        message = f"{len(cells)} cells under {len(header)} columns"
        document.add("bad-table", place, message, "quote a cell that holds a comma")
        return []
    named = zip(header, cells, strict=True)
    return [CsvCell(top.name, _scalar(text), place) for top, (text, place) in named if text]


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
