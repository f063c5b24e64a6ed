"""What commands print on small scenes: every head and every word of a table has a definition."""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.explain.printed_words import page_words, table_words

from contactlab.command_line import terminal
from contactlab.rendering.document import Document, Table
from contactlab.studies.explain.definitions import is_defined

Run = Callable[..., Any]
_RUN_ID = re.compile(r"[0-9a-f]{8}")
COMMANDS = (
    "sweep small.yaml --plan",
    "sweep small.yaml --workers 0 -o again",
    "show store",
    "show store {run}",
    "compare store again --match axes",
    "tradeoff store",
    "report store --figures list",
    "list",
    "list scenes",
    "list axes ball_drop",
    "list sweeps",
    "list metrics",
    "list labels",
    "list limits",
    "list engines",
)


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Collect the words of every table that is printed."""
    words = list[str]()
    original = terminal.print_document

    def spy(document: Document) -> None:
        for block in document.blocks:
            if isinstance(block, Table):
                heads = [column.name for column in block.columns]
                words.extend(table_words(heads, [row.cells for row in block.rows]))
        original(document)

    for module in [*sys.modules.values()]:
        if getattr(module, "print_document", None) is original:
            monkeypatch.setattr(module, "print_document", spy)
    return words


@pytest.mark.long
@pytest.mark.usefixtures("small", "store")
def test_every_printed_word_is_explained(contactlab: Run, printed: list[str]) -> None:
    run = ""
    for command in COMMANDS:
        before = len(printed)
        code, out, err = contactlab(*command.format(run=run).split())
        assert code in {0, 1}, err
        if command.startswith("compare"):
            printed += {
                line.split("  ")[0]
                for line in out.splitlines()
                if line[:1] not in {"", " "} and line[4:6] == "  "
            }
        run = run or next(filter(_RUN_ID.fullmatch, out.split()), "")
        assert len(printed) > before or command.startswith("show store {"), command
    assert {word for word in printed if not is_defined(word)} == set()


@pytest.mark.long
@pytest.mark.usefixtures("store")
def test_every_head_of_a_page_is_explained(contactlab: Run, tmp_path: Path) -> None:
    """Values of axes are heads of the map, and ids of runs those of rows."""
    assert contactlab("report", "store", "-o", "page.html").code == 0
    words = page_words((tmp_path / "page.html").read_text(encoding="utf-8"))
    known = [is_defined(word) or word[0].isdigit() or _RUN_ID.match(word) for word in words]
    assert [word for word, found in zip(words, known, strict=True) if not found] == []
