"""Rows that a sweep includes in addition to its product: in the file, or in a separate table."""

import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from contactlab.errors import SweepFileError
from contactlab.plan.diagnostics import Place, SourceText
from contactlab.plan.grid import RowValues
from contactlab.plan.names import check_axis, check_conflicts
from contactlab.plan.rows import SweepContext
from contactlab.plan.yaml_document import Document, read_text
from contactlab.schema.setting_values import parse_decimal
from contactlab.schema.sweep_schema import IncludeFile

# One cell and its end: a quoted text with "" for each quote, or a text without commas.
_CSV_CELL = re.compile(r'\s*(?:"((?:[^"]|"")*)"|([^,]*?))\s*(,|$)')


def read_rows(context: SweepContext, folder: Path) -> tuple[RowValues, ...]:
    """Return the rows to include, with canonical values. Add their mistakes to the document.

    A CSV file must be in the sweep's folder or below, because a sweep may come from a stranger.
    """
    include, document = context.sweep.include, context.document
    if isinstance(include, IncludeFile):
        source = _read_table(document, folder, include.file)
        return tuple(_table_rows(context, source)) if source else ()
    rows: list[RowValues] = []
    for index, row in enumerate(include):
        path = context.entry_path("include", index)
        _check_row(context, {name: document.key_place((*path, name)) for name in row})
        places = {name: document.value_place((*path, name)) for name in row}
        rows.append({name: context.canonical_value(name, row[name], places[name]) for name in row})
    return tuple(rows)


def _check_row(context: SweepContext, places: dict[str, Place]) -> None:
    for name, place in places.items():
        check_axis(context, name, place)
    check_conflicts(context, places)


def _read_table(document: Document, folder: Path, name: str) -> SourceText | None:
    path, lines, hint = folder / name, (), ""
    if not path.resolve().is_relative_to(folder.resolve()):
        message, hint = f"{path} is outside of the sweep's folder", "move it into the folder"
    elif path.exists() and not path.is_file():
        message = f"{path} is not a file"
    else:
        message = f"{path} has no rows"
        hint = "the first line names the axes, each further line is a row"
        try:
            lines = tuple(read_text(path).splitlines())
        except SweepFileError as error:
            message, hint = str(error), "relative names start at the sweep's folder"
    if sum(bool(line.strip()) for line in lines) > 1:
        return SourceText(str(path), lines)
    document.add_mistake("bad-table", ("include", "file"), message, hint)
    return None


def _table_rows(context: SweepContext, source: SourceText) -> Iterator[RowValues]:
    document = context.document
    first, *numbers = [number for number, line in enumerate(source.lines, 1) if line.strip()]
    header = list(_read_cells(source, first))
    places: dict[str, Place] = {}
    for name, place in header:
        if not name or name in places:
            message = f"a second column '{name}'" if name else "a column without a name"
            document.add_mistake("bad-table", place, message)
        else:
            places[name] = place
    _check_row(context, places)
    for number in numbers:
        cells = list(_read_cells(source, number))
        if len(cells) != len(header):
            place = Place(source, number, 1, len(source.lines[number - 1]))
            message = f"{len(cells)} cells under {len(header)} columns"
            document.add_mistake("bad-table", place, message, "quote a cell that holds a comma")
            continue
        row = {
            name: context.canonical_value(name, parse_cell(text), place)
            for (name, _), (text, place) in zip(header, cells, strict=True)
            if text
        }
        if row:
            yield row


def _read_cells(source: SourceText, number: int) -> Iterator[tuple[str, Place]]:
    line, start = source.lines[number - 1], 0
    while match := _CSV_CELL.match(line, start):
        group = 2 if match.group(1) is None else 1
        text, begin = match.group(group), match.start(group)
        yield text.replace('""', '"'), Place(source, number, begin + 1, max(len(text), 1))
        start = match.end()
        if not match.group(3):
            return
    yield line[start:], Place(source, number, start + 1, max(len(line) - start, 1))


def parse_cell(text: str) -> object:
    """Return the number, true, false or the word in a cell."""
    if text.lower() in {"true", "false"}:
        return text.lower() == "true"
    with suppress(ValueError):
        number = parse_decimal(text)
        return int(text) if text.lstrip("+-").isdigit() else number
    return text
