"""What data says is shown in every output, and obeyed by none."""

import json
import re
import unicodedata
import warnings
from xml.etree import ElementTree as ET

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from contactlab.printable import in_markdown, in_one_line, printable, shorten_warnings, visible
from contactlab.schema.finding import Finding, RunPair
from contactlab.temporary_folders import names_temporary_file, temporary_root
from contactlab.writers import WRITERS, Report, Section, as_text
from contactlab.writers.github import write_annotations

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


def test_a_warning_about_a_copy_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """A user cannot edit a temporary file, and the same warning about the model was shown."""
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    shorten_warnings(names_temporary_file)
    copy = temporary_root() / "copy.obj"
    shown = [
        warnings.formatwarning(f"no texture in '{file}'", UserWarning, "", 0)
        for file in (copy, "model.obj")
    ]
    assert shown == ["", "warning: no texture in 'model.obj'\n"]


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


def hostile_report(text: str) -> Report:
    """A report that has a text in each of its parts."""
    pair = RunPair(
        baseline_run=text, candidate_run=text, axes={text: text}, baseline=text, candidate=text
    )
    failed = Finding(
        name=text, kind=text, group=text, level="gate", outcome="failed", verdict="unmet",
        judged=1, failing=1, message=text, unit=text, waived=text, worst=(pair,),
    )  # fmt: skip
    outcomes = ("failed", "warned", "noted", "skipped", "passed")
    findings = tuple(failed.model_copy(update={"outcome": outcome}) for outcome in outcomes)
    return Report(
        title=text,
        place=(text, text),
        headline=text,
        passed=False,
        record=findings[0],
        facts=(("", text), (text, text)),
        findings=findings,
        sections=(Section(text, (text,), (text, text), ((text, text),), (text,)),),
        notes=(text,),
        commands=((text, text),),
    )


@pytest.mark.parametrize("count", [0, 1, 9, 10, 25, 1_234])
def test_annotations_are_shown_or_counted(count: int) -> None:
    """A step shows ten of a kind: what is not shown is counted in the last."""
    messages = [f"message {number}" for number in range(count)]
    errors = [line for line in write_annotations("a", messages, []).splitlines() if "error" in line]
    assert len(errors) <= 10
    counted = [re.search(r"::and ([\d,]+) more", line) for line in errors]
    more = sum(int(found[1].replace(",", "")) for found in counted if found)
    shown = [line.rpartition("::")[2] for line in errors if "::and " not in line]
    assert shown == messages[: len(shown)]
    assert len(shown) + more == count


def commands_of(written: str, form: str) -> int:
    """Return how many commands a CI job may take from a format: annotations are its only ones."""
    lines = written.splitlines()
    errors = sum(line.startswith("::error ") for line in lines)
    warnings = sum(line.startswith("::warning ") for line in lines)
    return errors + warnings if form == "github" else 0


@pytest.mark.parametrize("form", WRITERS)
@given(text=HOSTILE)
@example(text="\n::error::x")
@example(text="##[add-mask]y\r\n::stop-commands::z")
@example(text="```\n</details>\n<script>")
def test_no_writer_lets_data_be_obeyed(form: str, text: str) -> None:
    written = WRITERS[form](hostile_report(text))
    assert len(obeyed(written)) == commands_of(written, form) == (3 if form == "github" else 0)
    shown = written.replace("\n", "").replace("\t", "")
    # Pictures and joiners of ours and of words are no controls; those of direction are gone.
    assert {unicodedata.category(sign) for sign in shown}.isdisjoint({"Cc", "Cs", "Zl", "Zp"})
    assert not set(shown) & set("\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067")


@given(text=HOSTILE, width=st.integers(10, 60))
@example(text="ab ::error::x", width=10)
@example(text="a b c d ##[add-mask]y", width=10)
def test_lines_that_wrap_are_not_obeyed(text: str, width: int) -> None:
    assert obeyed(as_text(hostile_report(text), width)) == []


@given(text=HOSTILE)
def test_formats_stay_what_they_are(text: str) -> None:
    """JSON keeps its data, JUnit its cases; Markdown has no markup but the writer's own."""
    report = hostile_report(text)
    assert json.loads(WRITERS["json"](report)) == report.record.model_dump(mode="json")
    root = ET.fromstring(WRITERS["junit"](report))  # noqa: S314 - our own
    tags = [[child.tag for child in case] for case in root.iter("testcase")]
    assert tags == [["failure"], ["system-out"], ["system-out"], ["skipped"], []]
    parts = re.split("^```.*$", WRITERS["markdown"](report), flags=re.MULTILINE)
    assert len(parts) == 5  # two blocks of code, in which markup is none
    lines = "".join(parts[::2]).splitlines()
    assert [line for line in lines if line.startswith("<")] == [
        "<details><summary>commands</summary>",
        "</details>",
    ]
