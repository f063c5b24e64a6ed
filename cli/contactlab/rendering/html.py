"""Renders a document as HTML, for pages and notebooks."""

from collections.abc import Iterator
from html import escape

from contactlab.printable import visible
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
    Sentence,
    Table,
)


def render_html(document: Document) -> str:
    """Return a document as HTML, without a page around it."""
    lines: list[str] = []
    for section in document.sections:
        if section.folded:
            lines.append(f"<details><summary>{_render_text(section.title)}</summary>")
        elif section.title:
            lines.append(f"<h3>{_render_text(section.title)}</h3>")
        for block in section.blocks:
            lines += _block_lines(block)
        if section.folded:
            lines.append("</details>")
    return "\n".join(lines)


def _render_text(text: str) -> str:
    return escape(visible(text))


def _block_lines(block: Block) -> Iterator[str]:
    match block:
        case Headline(text, mark):
            text = f"{mark.sign} {text}" if mark else text
            yield f"<p><strong>{_render_text(text)}</strong></p>"
        case Sentence(text, mark):
            yield f"<p>{_render_text(f'{mark.sign} {text}' if mark else text)}</p>"
        case Commands(entries):
            yield _render_code(tuple(f"{purpose}: {command}" for purpose, command in entries))
        case Facts(entries):
            yield '<dl class="causes">'
            for name, text in entries:
                head = f"<dt>{_render_text(name)}</dt>" if name else ""
                yield f"{head}<dd><p>{_render_text(text)}</p></dd>"
            yield "</dl>"
        case Items(texts, title):
            yield from [f"<p>{_render_text(title)}</p>"] if title else []
            entries = "".join(f"<li>{_render_text(text)}</li>" for text in texts)
            yield f'<ul class="reasons">{entries}</ul>'
        case Code(lines, more=more):
            yield _render_code(lines)
            yield from [f'<p class="caption">{_render_text(more)}</p>'] if more else []
        case Table():
            yield from _table_lines(block)


def _render_code(lines: tuple[str, ...]) -> str:
    return f'<pre class="code">{_render_text(chr(10).join(lines))}</pre>'


def _table_lines(table: Table) -> Iterator[str]:
    has_bars = any(isinstance(cell, Bar) for row in table.rows for cell in row.cells)
    # Rows with a bar are stacked in a narrow window; each cell then names its column.
    yield f'<div class="scroll"><table class="budget{" bars" if has_bars else ""}">'
    if any(column.name for column in table.columns):
        heads = "".join(
            f'<th scope="col"{_class_of_column(column)}>{_render_text(column.name)}</th>'
            for column in table.columns
        )
        yield f"<thead><tr>{heads}</tr></thead>"
    yield "<tbody>"
    group = ""
    width = len(table.columns)
    for row in table.rows:
        if row.group != group:
            group = row.group
            if group:
                head = f'<th scope="rowgroup" colspan="{width}">{_render_text(group)}</th>'
                yield f'<tr class="kind">{head}</tr>'
        title = f' title="{_render_text(row.title)}"' if row.title else ""
        head, *cells = row.cells
        entries = [f'<th scope="row"{title}>{_cell_text(head)}</th>']
        for column, cell in zip(table.columns[1:], cells, strict=True):
            name = f' data-head="{_render_text(column.name)}"'
            shape = ' class="along"' if isinstance(cell, Bar) else _class_of_column(column) + name
            entries.append(f"<td{shape}>{_cell_text(cell)}</td>")
        yield f"<tr>{''.join(entries)}</tr>"
        if row.details:
            yield f'<tr><td colspan="{width}">{_render_code(row.details)}</td></tr>'
    yield "</tbody></table></div>"
    yield from [f'<p class="caption">{_render_text(table.more)}</p>'] if table.more else []


def _class_of_column(column: Column) -> str:
    return ' class="number"' if column.align == "right" else ""


def _cell_text(cell: Cell) -> str:
    match cell:
        case Mark(word):
            return _render_text(word)
        case Bar():
            return _draw_bar(cell)
        case _:
            # A unit stays with its number in a narrow window.
            return _render_text(cell).replace(" %", "&nbsp;%")


def _draw_bar(bar: Bar) -> str:
    """Draw a bar with a line at its limit."""
    bar_pixels = 160  # a column of a table; shares of 1 % are still visible
    width, limit = bar_pixels * min(1.0, max(0.0, bar.part)), ""
    if bar.limit is not None:
        place = f"{bar_pixels * bar.limit:.1f}"
        limit = f'<line x1="{place}" x2="{place}" y2="12"/>'
    return (
        f'<svg class="share{" over" if bar.exceeds else ""}" width="{bar_pixels}" height="12" '
        f'viewBox="0 0 {bar_pixels} 12" preserveAspectRatio="none" aria-hidden="true">'
        f'<rect width="{width:.1f}" height="12" rx="2"/>{limit}</svg>'
    )
