"""A report as a tree of blocks, which is rendered as text, Markdown and HTML with the same facts.

Blocks hold plain text only: each renderer escapes it. A function that describes a report chooses
the facts and their order. A renderer decides how they look.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

Align = Literal["left", "right"]


@dataclass(frozen=True)
class Mark:
    """A cell that states an outcome: a word in text, a sign elsewhere."""

    word: str
    sign: str = ""


@dataclass(frozen=True)
class Bar:
    """A cell that draws a number along a scale; the number itself is in another cell.

    Attributes:
        part: filled part of the full width, 0 to 1.
        limit: place of the limit along the full width; None without one.
        exceeds: whether the number is above the limit.
    """

    part: float
    limit: float | None = None
    exceeds: bool = False


Cell = str | Mark | Bar


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        name: the head; "" for none.
        align: numbers are aligned right.
        droppable: whether a narrow terminal may leave it out.
        breakable: whether its words may be broken, as names of bodies may.
    """

    name: str
    align: Align = "left"
    droppable: bool = False
    breakable: bool = False


@dataclass(frozen=True)
class Row:
    """Cells of a table, one for each column.

    Attributes:
        group: the head above all rows in a row that have the same group; "" for none.
        details: lines of a file below the row, such as those of a fix.
        title: an explanation that HTML shows on request.
    """

    cells: tuple[Cell, ...]
    group: str = ""
    details: tuple[str, ...] = ()
    title: str = ""


@dataclass(frozen=True)
class Table:
    """Rows under named columns.

    Attributes:
        ruled: whether a line separates the head in text.
        headed: whether text shows the head; Markdown and HTML need it.
        more: a sentence about omitted rows and their place; "" if there are no others.
    """

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    ruled: bool = True
    headed: bool = True
    more: str = ""


@dataclass(frozen=True)
class Headline:
    """The result in one sentence; the sign of its mark is shown, but not the word."""

    text: str
    mark: Mark | None = None


@dataclass(frozen=True)
class Sentence:
    """A paragraph, after a mark or none."""

    text: str
    mark: Mark | None = None


@dataclass(frozen=True)
class Facts:
    """Names with texts. Further texts of one name follow with the name ""."""

    entries: tuple[tuple[str, str], ...]
    colon: bool = False  # whether text has a colon after a name


@dataclass(frozen=True)
class Items:
    """A list of texts, each a line of its own, under a title or none."""

    texts: tuple[str, ...]
    title: str = ""


@dataclass(frozen=True)
class Code:
    """Lines of a file or commands, which are never wrapped."""

    lines: tuple[str, ...]
    language: str = ""
    more: str = ""  # a sentence about omitted lines
    indent: int = 2  # of text


@dataclass(frozen=True)
class Commands:
    """Command lines for the next step, each with its purpose."""

    entries: tuple[tuple[str, str], ...]


Block = Commands | Headline | Sentence | Facts | Items | Code | Table


@dataclass(frozen=True)
class Section:
    """Blocks that belong together.

    Attributes:
        name: key of the section for a page, such as `budget`.
        title: its head; "" for none.
        folded: whether Markdown and HTML show it on request only.
        follows: whether text has no empty line before it.
    """

    blocks: tuple[Block, ...]
    name: str = ""
    title: str = ""
    folded: bool = False
    follows: bool = False


@dataclass(frozen=True)
class Document:
    """A report in words: sections in the order of their weight."""

    sections: tuple[Section, ...] = field(default_factory=tuple[Section, ...])

    @property
    def blocks(self) -> Iterator[Block]:
        """All blocks in their order."""
        for section in self.sections:
            yield from section.blocks

    def section(self, name: str) -> "Document":
        """Return a document of the sections of a name, which may be empty."""
        return Document(tuple(one for one in self.sections if one.name == name))


def document_of(*sections: Section | Sequence[Block]) -> Document:
    """Return a document of sections, or of the blocks of sections; empty ones are left out."""
    all_sections = [one if isinstance(one, Section) else Section(tuple(one)) for one in sections]
    return Document(tuple(section for section in all_sections if section.blocks))


def table_of(
    columns: Sequence[str | Column],
    rows: Sequence[Sequence[object]],
    *,
    most: int | None = None,
    droppable: int = 0,
) -> Table:
    """Return a table of values; columns of numbers are aligned right.

    Args:
        columns: names, or columns.
        rows: values, one for each column.
        most: number of rows that are shown; a sentence says where the others are.
        droppable: number of the last columns that a narrow terminal may leave out.
    """
    shown_rows = rows if most is None else rows[:most]
    all_columns: list[Column] = []
    for place, column in enumerate(columns):
        if isinstance(column, Column):
            all_columns.append(column)
            continue
        numeric = bool(shown_rows) and all(
            isinstance(row[place], int | float) for row in shown_rows
        )
        optional = place >= len(columns) - droppable
        all_columns.append(Column(column, "right" if numeric else "left", droppable=optional))
    more = (
        f"and {len(rows) - len(shown_rows):,} more, see --format json"
        if rows[len(shown_rows) :]
        else ""
    )
    return Table(
        tuple(all_columns), tuple(Row(tuple(map(cell_of, row))) for row in shown_rows), more=more
    )


def cell_of(value: object) -> Cell:
    """Return a value as a cell: `-` for None, yes or no, and numbers in four digits."""
    match value:
        case Mark() | Bar() | str():
            return value
        case None:
            return "-"
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.4g}"
        case _:
            return str(value)
