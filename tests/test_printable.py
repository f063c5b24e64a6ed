"""What data says is shown in every output, and obeyed by none."""

import json
import re
import unicodedata
from xml.etree import ElementTree as ET

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from contactlab.ci_output import annotations, junit, junit_case
from contactlab.printable import in_markdown, in_one_line, printable, visible
from contactlab.schema.comparison import JudgedCheck

TERMINAL = ("\n", "\r", " ", "\x1b[31m", "\x9b2J", "\u202e", "\u2066", "\u2028", "\ud800")
MARKUP = ("@admin", "#12", "https://evil.example", "|", "`", "<script>", "&#64;me", "%0A", "]]>")
SIGNS = st.sampled_from(("::error::x", "##[add-mask]y", *TERMINAL, *MARKUP))
ANY = st.text(st.characters(exclude_categories=[]), max_size=6)
HOSTILE = st.lists(SIGNS | ANY, max_size=8).map("".join)


def obeyed(text: str) -> list[str]:
    """Return the lines that GitHub takes for commands, by its own rule."""
    return [
        line
        for line in re.split("\r\n|\r|\n", text)
        if line.lstrip().startswith("::") or "##[" in line
    ]


@given(HOSTILE)
@example("a\n \u2003::error::x")
@example("###[[")
def test_terminals_and_ci_jobs_obey_nothing(text: str) -> None:
    shown = printable(text)
    assert obeyed(shown) == []
    kinds = {unicodedata.category(sign) for sign in shown.replace("\n", "").replace("\t", "")}
    assert kinds.isdisjoint({"Cc", "Cs", "Zl", "Zp"})
    assert not {unicodedata.bidirectional(sign) for sign in shown} & {
        "LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"
    }  # fmt: skip
    assert "\n" not in in_one_line(text)


@given(st.text("abc äöü漢字:#[]\\\"'\n\t.", max_size=20))
def test_other_text_stays(text: str) -> None:
    if not obeyed(text):
        assert printable(text) == text


@given(HOSTILE)
def test_json_keeps_its_meaning(text: str) -> None:
    written = printable(json.dumps({text: [text]}, ensure_ascii=False, indent=2))
    assert json.loads(written) == {text: [text]}


@given(HOSTILE)
def test_markdown_shows_text_in_one_cell(text: str) -> None:
    cell = in_markdown(text)
    assert "\n" not in cell
    bare = re.sub(r"\\.|@<!-- -->|#<!-- -->|:<!-- -->|&amp;|<!-- -->", "", cell)
    assert not set(bare) & set("|`<>@#&")
    assert "://" not in bare
    assert visible(cell) == cell


@given(HOSTILE)
def test_annotations_are_one_line_each(text: str) -> None:
    lines = annotations(text, [text], [text]).split("\n")
    assert [line.partition(" ")[0] for line in lines] == ["::error", "::warning", ""]
    assert len(obeyed("\n".join(lines))) == 2


@pytest.mark.parametrize("count", [0, 1, 9, 10, 25, 1_234])
def test_annotations_are_shown_or_counted(count: int) -> None:
    """A step shows ten of a kind: what is not shown is counted in the last."""
    messages = [f"message {number}" for number in range(count)]
    errors = [line for line in annotations("a", messages, []).splitlines() if "error" in line]
    assert len(errors) <= 10
    counted = [re.search(r"::and ([\d,]+) more", line) for line in errors]
    more = sum(int(found[1].replace(",", "")) for found in counted if found)
    shown = [line.rpartition("::")[2] for line in errors if "::and " not in line]
    assert shown == messages[: len(shown)]
    assert len(shown) + more == count


@given(HOSTILE)
def test_junit_is_xml(text: str) -> None:
    check = JudgedCheck(name=text, group=text, message=text, outcome="failed", failing=1)
    root = ET.fromstring(junit(text, [junit_case(check, [text], text, [text])]))  # noqa: S314
    assert len(list(root.iter("testcase"))) == 1
