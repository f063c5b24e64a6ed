"""Renders a document as plain text of any width.

Only lines of files and single words may be wider than the width, since they cannot be broken.
"""

import re
import textwrap
from collections.abc import Callable, Iterator, Sequence

from contactlab.printable import in_one_line, printable
from contactlab.rendering.document import (
    Bar,
    Block,
    Cell,
    Code,
    Column,
    Commands,
    Document,
    Facts,
    Headline,
    Items,
    Mark,
    Row,
    Sentence,
    Table,
)

COLUMNS = 80
"""Width of a report in a pipe or a file."""
_GAP = "  "  # between columns
_MARK_WIDTH, _LEAST_WIDTH_OF_WORDS = 4, 14  # of the column of marks, and of a column of words
Paint = Callable[[str, str], str]
"""Colors a cell, from the name of its column and its text."""


def render_text(document: Document, width: int = COLUMNS, paint: Paint | None = None) -> str:
    """Return a document as lines; sections are separated by empty lines."""
    lines: list[str] = []
    for section in document.sections:
        lines += [""] if lines and not section.follows else []
        if section.title:
            lines += wrap_text(section.title, width).split("\n")
        for block in section.blocks:
            lines += _block_lines(block, width, paint or _keep_text)
    return "\n".join(line.rstrip() for line in lines)


def wrap_text(text: str, width: int = COLUMNS, first: str = "", rest: str | None = None) -> str:
    """Return a text in lines between words, the first and the others each after an indent."""
    lines = _wrap_words(
        in_one_line(text),
        width,
        initial_indent=first,
        subsequent_indent="  " if rest is None else rest,
        break_long_words=False,
        break_on_hyphens=False,
    )
    # A word that begins a line now may be a command there.
    return printable("\n".join(lines or [first]))


def _keep_text(_: str, text: str) -> str:
    return text


def _block_lines(block: Block, width: int, paint: Paint) -> Iterator[str]:
    match block:
        case Headline(text):
            yield from wrap_text(text, width).split("\n")
        case Sentence(text, mark):
            first = f"{mark.word:{_MARK_WIDTH}}  " if mark else ""
            yield from wrap_text(text, width, first).split("\n")
        case Commands(entries):
            yield from (in_one_line(f"{purpose}: {command}") for purpose, command in entries)
        case Facts():
            yield from _fact_lines(block, width)
        case Items(texts, title):
            if title:
                yield from wrap_text(title, width).split("\n")
            indent = "  " if title else ""
            for text in texts:
                yield from wrap_text(text, width, indent, indent + "  ").split("\n")
        case Code(lines, more=more, indent=indent):
            yield from (f"{' ' * indent}{in_one_line(line)}" for line in lines)
            if more:
                yield from wrap_text(more, width, " " * indent, " " * indent).split("\n")
        case Table():
            yield from _table_lines(block, width, paint)
            if block.more:
                yield from wrap_text(block.more, width).split("\n")


def _fact_lines(facts: Facts, width: int) -> Iterator[str]:
    colon = ":" if facts.colon else ""
    names = [in_one_line(f"{name}{colon}" if name else "") for name, _ in facts.entries]
    gap, most_indent = 1 if facts.colon else 2, 30
    indent = min(max(map(len, names), default=0) + gap, most_indent)
    for name, (_, text) in zip(names, facts.entries, strict=True):
        first = f"{name:{indent - gap}}{' ' * gap}"
        yield from wrap_text(text, width, first, " " * indent).split("\n")


def _table_lines(table: Table, width: int, paint: Paint) -> Iterator[str]:
    indent = "  " if any(row.group for row in table.rows) else ""
    columns = table.columns
    rows = [[_cell_text(cell) for cell in row.cells] for row in table.rows]
    for row, cells in zip(table.rows, rows, strict=True):
        cells[0] = f"{indent if row.group else ''}{cells[0]}"
    widths, least = _column_widths(columns, rows)
    column_count = len(columns)
    while (
        _total_width(least[:column_count]) > width
        and column_count > 1
        and columns[column_count - 1].droppable
    ):
        column_count -= 1
    columns, dropped_columns = columns[:column_count], columns[column_count:]
    if _total_width(least[:column_count]) > width:
        yield from _block_rows(table, rows, width)
        return
    widths = _fit_widths(widths[:column_count], least[:column_count], width)
    head = [in_one_line(column.name) for column in columns]
    if any(head) and table.headed:
        yield from _row_lines(columns, head, widths, _keep_text)
        if table.ruled:
            yield "─" * _total_width(widths)
    group = ""
    for row, cells in zip(table.rows, rows, strict=True):
        if row.group != group:
            group = row.group
            yield from wrap_text(f"{group}:", width).split("\n") if group else ()
        yield from _row_lines(columns, cells[:column_count], widths, paint)
        yield from _detail_lines(row, width)
    if dropped_columns:
        names = ", ".join(column.name for column in dropped_columns)
        yield from wrap_text(f"not shown: {names}; --format csv has all", width).split("\n")


def _cell_text(cell: Cell) -> str:
    match cell:
        case Mark(word):
            return in_one_line(word)
        case Bar(part):
            return "#" * max(1, round(8 * min(1.0, part))) if part > 0 else ""
        case _:
            return in_one_line(cell)


def _detail_lines(row: Row, width: int) -> Iterator[str]:
    for line in row.details:
        yield from wrap_text(line, width, "   ", "     ").split("\n")


def _total_width(widths: Sequence[int]) -> int:
    return sum(widths) + len(_GAP) * (len(widths) - 1)


def _column_widths(
    columns: Sequence[Column], rows: Sequence[Sequence[str]]
) -> tuple[list[int], list[int]]:
    """Return the widths that columns need, and the least ones that they can have."""
    widths: list[int] = []
    least: list[int] = []
    for place, column in enumerate(columns):
        cells = [in_one_line(column.name), *(row[place] for row in rows)]
        widths.append(max(map(len, cells)))
        words = max((len(word) for cell in cells for word in cell.split()), default=0)
        narrow = len(cells[0]) if column.breakable else max(words, len(cells[0]))
        wraps = column.align == "left" and any(" " in cell for cell in cells[1:])
        can_wrap = column.breakable or wraps
        least.append(
            min(widths[-1], max(_LEAST_WIDTH_OF_WORDS, narrow)) if can_wrap else widths[-1]
        )
    return widths, least


def _fit_widths(widths: Sequence[int], least: Sequence[int], width: int) -> list[int]:
    """Return widths between the least and the needed ones, so that a row has the width at most.

    Columns that need more than the others are narrowed first.
    """
    low, high = 0, max(widths, default=0)
    while low < high:  # the largest width of columns that can wrap
        middle = (low + high + 1) // 2
        cut = [max(few, min(all_, middle)) for few, all_ in zip(least, widths, strict=True)]
        low, high = (middle, high) if _total_width(cut) <= width else (low, middle - 1)
    fitted = [max(few, min(all_, low)) for few, all_ in zip(least, widths, strict=True)]
    for place, all_ in enumerate(widths):  # signs that are left over
        fitted[place] += max(0, min(all_ - fitted[place], width - _total_width(fitted)))
    return fitted


def _row_lines(
    columns: Sequence[Column], cells: Sequence[str], widths: Sequence[int], paint: Paint
) -> Iterator[str]:
    wrapped_cells = [
        _wrap_cell(cell, width, breakable=column.breakable)
        for column, cell, width in zip(columns, cells, widths, strict=True)
    ]
    for place in range(max(map(len, wrapped_cells))):
        line = ""
        for column, lines, width in zip(columns, wrapped_cells, widths, strict=True):
            text = lines[place] if place < len(lines) else ""
            space = " " * (width - len(text))
            cell_text = paint(column.name, text) if text else ""
            line += (space + cell_text if column.align == "right" else cell_text + space) + _GAP
        yield printable(line.rstrip()) if paint is _keep_text else line.rstrip()


def _wrap_cell(cell: str, width: int, *, breakable: bool) -> list[str]:
    if len(cell) <= width:
        return [cell]
    indent = " " * (len(cell) - len(cell.lstrip()))
    return _wrap_words(
        cell, width, subsequent_indent=indent, break_long_words=breakable, break_on_hyphens=False
    ) or [""]


# A space between a number and its unit; no line ends there.
_BEFORE_UNIT = re.compile(
    r"(?<=\d) (?=(?:%|[kMmµn]?(?:s|m|N|J|W|Hz|rad|g)|deg|min|[kMG]B|1/s)\b|%)"
)
_UNBROKEN = "\N{NO-BREAK SPACE}"


def _wrap_words(text: str, width: int, **options: str | bool) -> list[str]:
    wrapper = textwrap.TextWrapper(width)
    for name, value in options.items():
        setattr(wrapper, name, value)
    lines = wrapper.wrap(_BEFORE_UNIT.sub(_UNBROKEN, text))
    # Also a no-break space of the text itself, which reads the same.
    return [line.replace(_UNBROKEN, " ") for line in lines]


def _block_rows(table: Table, rows: Sequence[Sequence[str]], width: int) -> Iterator[str]:
    """Yield each row as lines, one for each of its cells that say something.

    The cells of a table without a head have no names, so they follow each other in a sentence.
    """
    names = [in_one_line(column.name) for column in table.columns]
    room = max(map(len, names)) + 2
    group = ""
    for row, cells in zip(table.rows, rows, strict=True):
        if row.group != group:
            group = row.group
            yield from wrap_text(f"{group}:", width).split("\n") if group else ()
        if not table.headed:
            first = f"{cells[0].strip():{_MARK_WIDTH}}  "
            head, *rest = filter(None, cells[1:])
            text = f"{head}: {', '.join(rest)}" if rest else head
            yield from wrap_text(text, width, first, " " * len(first)).split("\n")
            continue
        yield from wrap_text(f"{names[0]} {cells[0].strip()}".strip(), width).split("\n")
        for name, value in zip(names[1:], cells[1:], strict=True):
            if value:
                first = f"  {name:<{room}}"
                room_left = max(width, len(first) + _LEAST_WIDTH_OF_WORDS)
                yield from wrap_text(value, room_left, first, " " * len(first)).split("\n")
        yield from _detail_lines(row, width)
