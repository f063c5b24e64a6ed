"""Text, Markdown and HTML of any document say the same, within their width and escaped."""

import re
from collections.abc import Iterator
from html.parser import HTMLParser

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.rendering.document import (
    Bar,
    Block,
    Code,
    Column,
    Commands,
    Document,
    Facts,
    Headline,
    Items,
    Mark,
    Row,
    Section,
    Sentence,
    Table,
    document_of,
    table_of,
)
from contactlab.rendering.html import render_html
from contactlab.rendering.markdown import render_markdown
from contactlab.rendering.text import render_text

WORDS = st.text("abcxyz019", min_size=1, max_size=8)
TEXTS = st.lists(WORDS, min_size=1, max_size=12).map(" ".join)
HOSTILE = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12)
ASCII = st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1, max_size=12)


@st.composite
def tables(draw: st.DrawFn, cells: st.SearchStrategy[str] = TEXTS) -> Table:
    width = draw(st.integers(1, 5))
    columns = [
        Column(draw(WORDS), draw(st.sampled_from(("left", "right"))), breakable=draw(st.booleans()))
        for _ in range(width)
    ]
    # Numbers are aligned right, and short; texts are aligned left.
    kinds = [WORDS if column.align == "right" else cells for column in columns]
    rows = draw(st.lists(st.tuples(*kinds), min_size=1, max_size=5))
    groups = draw(st.lists(st.sampled_from(("", "alpha", "beta")), min_size=5, max_size=5))
    built = tuple(Row(row, group) for row, group in zip(rows, groups, strict=False))
    return Table(tuple(columns), built, draw(st.booleans()))


BLOCKS: st.SearchStrategy[Block] = st.one_of(
    TEXTS.map(Headline),
    TEXTS.map(Sentence),
    st.lists(st.tuples(WORDS, TEXTS), min_size=1, max_size=4).map(lambda all_: Facts((*all_,))),
    st.lists(TEXTS, min_size=1, max_size=4).map(lambda all_: Items((*all_,), "some")),
    TEXTS.map(lambda text: Sentence(text, Mark("FAIL", "FAIL"))),
    tables(),
)
DOCUMENTS = st.lists(
    st.builds(
        Section,
        st.lists(BLOCKS, min_size=1, max_size=3).map(tuple),
        title=TEXTS,
        folded=st.booleans(),
    ),
    max_size=3,
).map(lambda sections: Document((*sections,)))


def texts_of(document: Document) -> Iterator[str]:
    """Yield all that a document says."""
    for section in document.sections:
        yield section.title
        for block in section.blocks:
            match block:
                case Headline(text) | Sentence(text):
                    yield text
                case Facts(entries):
                    yield from (text for entry in entries for text in entry)
                case Items(texts, title):
                    yield from (title, *texts)
                case Code(lines):
                    yield from lines
                case Commands(entries):
                    yield from (text for entry in entries for text in entry)
                case Table():
                    yield from (column.name for column in block.columns)
                    for row in block.rows:
                        yield row.group
                        yield from (cell for cell in row.cells if isinstance(cell, str))


def words_of(text: str) -> set[str]:
    return set(re.findall(r"[a-z0-9]+", text))


class _Shown(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.text = ""

    def handle_data(self, data: str) -> None:
        self.text += f" {data}"


def shown_words(html: str) -> set[str]:
    parser = _Shown()
    parser.feed(html)
    return words_of(parser.text)


@given(DOCUMENTS, st.integers(30, 160))
def test_no_line_is_wider_than_the_width(document: Document, width: int) -> None:
    for line in render_text(document, width).split("\n"):
        assert len(line) <= width
        assert line == line.rstrip()


@given(st.text("abc", min_size=1, max_size=60), TEXTS, st.integers(30, 60))
def test_only_a_word_that_cannot_be_broken_is_wider(word: str, text: str, width: int) -> None:
    table = table_of(("name", "text"), [(word, text)])
    document = document_of([Sentence(f"{text} {word} {text}"), table])
    for line in render_text(document, width).split("\n"):
        assert len(line) <= width or line.split() == [word]


@given(DOCUMENTS, st.integers(30, 160))
def test_every_format_has_the_same_facts(document: Document, width: int) -> None:
    # A word of a name that is broken over two lines is in none of them.
    said = {word for text in texts_of(document) for word in words_of(text)}
    assert words_of(render_markdown(document)) - {"details", "summary"} == said
    assert shown_words(render_html(document)) == said
    assert words_of(render_text(document, width)) >= said - _breakable_words(document)


def _breakable_words(document: Document) -> set[str]:
    return {
        word
        for block in document.blocks
        if isinstance(block, Table)
        for row in block.rows
        for column, cell in zip(block.columns, row.cells, strict=True)
        if column.breakable and isinstance(cell, str)
        for word in words_of(cell)
    }


@given(tables(ASCII))
def test_a_table_in_markdown_reads_back(table: Table) -> None:
    head, _, *rows = render_markdown(document_of([table])).split("\n")
    assert _read_cells(head) == [column.name for column in table.columns]
    groups = [row.group for row in table.rows]
    pairs = zip(["", *groups], groups, strict=False)
    heads = [f"**{new}**" for old, new in pairs if new not in {"", old}]
    read = [_read_cells(row) for row in rows]
    assert [cells[0] for cells in read if cells[0].startswith("**")] == heads
    plain = [cells for cells in read if not cells[0].startswith("**")]
    assert plain == [[" ".join(str(cell).split()) for cell in row.cells] for row in table.rows]


def _read_cells(row: str) -> list[str]:
    """Return the cells of a row; references and escapes are undone."""
    cells = re.split(r"(?<!\\)(?:\\\\)*\|", row)[1:-1]
    plain = (re.sub(r"\\(.)", r"\1", cell.replace("<!-- -->", "").strip()) for cell in cells)
    return [cell.replace("&amp;", "&") for cell in plain]


@given(st.lists(HOSTILE, min_size=2, max_size=6))
def test_html_shows_data_and_obeys_none(texts: list[str]) -> None:
    blocks = (Sentence(texts[0]), Items((*texts,)), Code((*texts,)), table_of(texts, [texts]))
    html = render_html(document_of([*blocks]))
    tags = set(re.findall(r"</?([a-z]+)", html))
    assert tags <= {"p", "ul", "li", "pre", "div", "table", "thead", "tbody", "tr", "th", "td"}


def test_a_narrow_table_leaves_out_columns_and_says_so() -> None:
    columns = [Column("run"), Column("label"), Column("deepest", "right", droppable=True)]
    table = table_of(columns, [("0f3a", "stable", 0.25)])
    whole = render_text(document_of([table]), 80)
    assert whole == "run   label   deepest\n─────────────────────\n0f3a  stable     0.25"
    narrow = render_text(document_of([table]), 16)
    assert narrow.startswith("run   label\n")
    assert "not shown:\n" in narrow
    assert "deepest" in narrow


def test_rows_that_fit_no_width_are_shown_below_each_other() -> None:
    table = table_of(
        ("setting", "a long name", "value"), [("solver", "abcdefghijklmnop", "Newton")]
    )
    assert render_text(document_of([table]), 30).split("\n") == [
        "setting solver",
        "  a long name  abcdefghijklmnop",
        "  value        Newton",
    ]


@pytest.mark.parametrize(("part", "signs"), [(0.0, 0), (0.01, 1), (0.5, 4), (1.0, 8), (3.0, 8)])
def test_bars_grow_with_their_number(part: float, signs: int) -> None:
    table = table_of(("", "bar"), [("a", Bar(part, limit=0.5, exceeds=part > 0.5))])
    document = document_of([table])
    assert render_text(document).count("#") == signs
    assert render_markdown(document).count("█") == signs
    html = render_html(document)
    assert f'<rect width="{160 * min(1.0, part):.1f}"' in html
    assert ("over" in html) == (part > 0.5)


def test_marks_are_words_in_text_and_signs_in_markdown() -> None:
    document = document_of([table_of(("", "check"), [(Mark("FAIL", "❌"), "noise")])])
    assert "FAIL  noise" in render_text(document)
    assert "| ❌ | noise |" in render_markdown(document)
    assert "FAIL" in render_html(document)


def test_facts_of_one_name_follow_each_other() -> None:
    facts = Facts((("why", "one two"), ("", "three"), ("task", "four")), colon=True)
    document = document_of([facts])
    assert render_text(document, 12) == "why:  one\n      two\n      three\ntask: four"
    assert render_markdown(document) == "- **why** one two\n- **why** three\n- **task** four"


def test_a_document_gives_its_sections_by_name() -> None:
    first, second = Section((Sentence("a"),), "facts"), Section((Sentence("b"),), "fixes")
    document = document_of(first, second, Section((), "empty"))
    assert document.section("fixes") == Document((second,))
    assert document.section("budget") == Document()
    assert render_text(document.section("budget")) == render_html(Document()) == ""


def test_numbers_are_aligned_right_in_markdown() -> None:
    table = table_of(("name", "runs"), [("stable", 12), ("slip", 3)])
    _, rule, *_ = render_markdown(document_of([table])).split("\n")
    assert rule == "|---|---:|"


@given(
    st.lists(st.sampled_from(("12.3 mm", "0.5 %", "3 seeds", "a", "4 1/s")), min_size=1),
    st.integers(12, 80),
)
def test_no_line_ends_between_a_number_and_its_unit(words: list[str], width: int) -> None:
    text = render_text(document_of(Section((Sentence(" ".join(words)),))), width)
    assert re.sub(r"\s+", " ", text) == " ".join(words)
    assert not re.search(r"^\s*(?:mm|%|1/s)", text, re.MULTILINE)
