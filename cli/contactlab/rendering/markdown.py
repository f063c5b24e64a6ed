"""Renders a document as Markdown."""

from collections.abc import Iterable, Iterator

from contactlab.printable import in_markdown, in_one_line, printable
from contactlab.rendering.document import (
    Bar,
    Block,
    Cell,
    Code,
    Commands,
    Document,
    Facts,
    Headline,
    Items,
    Mark,
    Sentence,
    Table,
)


def render_markdown(document: Document) -> str:
    """Return a document as Markdown; each block is separated by an empty line."""
    lines: list[str] = []
    for section in document.sections:
        if section.folded:
            lines += [f"<details><summary>{in_markdown(section.title)}</summary>", ""]
        elif section.title:
            lines += [f"#### {in_markdown(section.title)}", ""]
        for block in section.blocks:
            lines += [*_block_lines(block), ""]
        if section.folded:
            lines += ["</details>", ""]
    while lines and not lines[-1]:
        lines.pop()
    return "\n".join(lines)


def markdown_row(cells: Iterable[str]) -> str:
    """Return a row of a table, from cells in Markdown."""
    return f"| {' | '.join(cells)} |"


def _block_lines(block: Block) -> Iterator[str]:
    match block:
        case Headline(text, mark):
            yield f"### {mark.sign} {in_markdown(text)}" if mark else f"### {in_markdown(text)}"
        case Sentence(text, mark):
            # A job takes a line that begins so for a command, in its log.
            yield f"{mark.sign} {in_markdown(text)}" if mark else printable(in_markdown(text))
        case Commands(entries):
            yield from ("<details><summary>commands</summary>", "")
            yield from _code_lines(
                (line for what, how in entries for line in (f"# {what}", how)), "sh"
            )
            yield from ("", "</details>")
        case Facts(entries):
            name = ""
            for entry_name, text in entries:
                name = entry_name or name
                yield (
                    f"- **{in_markdown(name)}** {in_markdown(text)}"
                    if name
                    else (f"- {in_markdown(text)}")
                )
        case Items(texts, title):
            yield from [printable(in_markdown(title)), ""] if title else []
            yield from (f"- {in_markdown(text)}" for text in texts)
        case Code(lines, language, more):
            yield from _code_lines(lines, language)
            yield from ["", printable(in_markdown(more))] if more else []
        case Table():
            yield from _table_lines(block)


def _code_lines(lines: Iterable[str], language: str = "") -> Iterator[str]:
    """Yield lines as code, which no line of theirs can end."""
    yield f"```{language}"
    yield from (in_one_line(line).replace("`", "'") for line in lines)
    yield "```"


def _table_lines(table: Table) -> Iterator[str]:
    yield markdown_row(in_markdown(column.name) for column in table.columns)
    yield "|".join(
        ["", *("---:" if column.align == "right" else "---" for column in table.columns), ""]
    )
    group = ""
    details: list[tuple[str, tuple[str, ...]]] = []
    for row in table.rows:
        if row.group != group:
            group = row.group
            if group:
                blank = [""] * (len(table.columns) - 1)
                yield markdown_row([f"**{in_markdown(group)}**", *blank])
        yield markdown_row(map(_cell_text, row.cells))
        if row.details:
            details.append((_cell_text(row.cells[0]), row.details))
    for name, lines in details:
        yield from ("", name, "", *_code_lines(lines))
    yield from ["", printable(in_markdown(table.more))] if table.more else []


def _cell_text(cell: Cell) -> str:
    match cell:
        case Mark(word, sign):
            return sign or in_markdown(word)
        case Bar(part):
            return "█" * max(1, round(8 * min(1.0, part))) if part > 0 else ""
        case _:
            return in_markdown(cell)
