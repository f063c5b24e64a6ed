"""What is written can be read back by those who it is for."""

import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import jsonschema
import pytest
import xmlschema
from hypothesis import given
from hypothesis import strategies as st

from contactlab.command_line.judgements import files_to_write, publish
from contactlab.comparison.compare_stores import compare_stores, unreadable_report
from contactlab.comparison.report import report_of
from contactlab.errors import OutputError, StoreError
from contactlab.printable import visible
from contactlab.schema.comparison import ComparePolicy, ComparisonReport, PairCounts
from contactlab.schema.finding import Finding, RunPair
from contactlab.schema.json_schemas import json_schemas
from contactlab.writers import as_annotations, as_junit, as_markdown, as_text
from contactlab.writers.github import write_annotations

XSD = xmlschema.XMLSchema(Path(__file__).with_name("junit.xsd"))
Runs = Callable[[], Any]
Stored = Callable[..., Path]
PAIR = RunPair(baseline_run="a", candidate_run="b", axes={}, baseline="x", candidate=1.0)
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)


@pytest.fixture
def worse(baseline: Path, runs: Runs, stored: Stored) -> ComparisonReport:
    """A report with failed, warned, noted, skipped and passed checks."""
    given_runs = runs()
    given_runs.measure(0, depth=2e-3, grip=11.0)
    given_runs.label(1, "chatter")
    given_runs.versions["slip"] = 2
    host = given_runs.provenance.host.model_copy(update={"cpu_model": "another"})
    given_runs.provenance = given_runs.provenance.model_copy(update={"host": host})
    return compare_stores(baseline, stored("worse", given_runs))


@pytest.fixture
def same(baseline: Path, runs: Runs, stored: Stored) -> ComparisonReport:
    return compare_stores(baseline, stored("same", runs()))


def check_of(text: str, number: int = 0, **changes: Any) -> Finding:
    plain: dict[str, Any] = {
        "name": f"check {number} {text}".strip(),
        "kind": "metrics",
        "group": text,
        "level": "gate",
        "outcome": "failed",
        "verdict": "worse",
        "judged": 1,
        "failing": 1,
        "counts": {"worse": 1},
        "message": text,
        "worst": (PAIR.model_copy(update={"axes": {"x": text}, "baseline": text}),),
    }
    return Finding(**{**plain, **changes})


def failing(same: ComparisonReport, *checks: Finding) -> ComparisonReport:
    return same.model_copy(update={"findings": checks, "exit_code": 1})


@pytest.mark.long
def test_json_fits_its_schema(worse: ComparisonReport) -> None:
    data = json.loads(worse.model_dump_json())
    jsonschema.validate(data, json_schemas()["comparison.schema.json"])
    assert ComparisonReport.model_validate(data) == worse


def test_junit_fits_its_schema(worse: ComparisonReport, same: ComparisonReport) -> None:
    error = unreadable_report(StoreError("no store at x"), ComparePolicy(version=1))
    for report in (worse, same, error):
        XSD.validate(as_junit(report_of(report)))


def test_junit_has_a_case_for_each_check(worse: ComparisonReport) -> None:
    suite = ET.fromstring(as_junit(report_of(worse))).find("testsuite")  # noqa: S314 - our own
    assert suite is not None
    cases = suite.findall("testcase")
    marks = {"failed": "failure", "warned": "system-out", "noted": "system-out"}
    for case, check in zip(cases, worse.findings, strict=True):
        mark = {**marks, "skipped": "skipped"}.get(check.outcome)
        assert [child.tag for child in case] == ([mark] if mark else [])
    outcomes = [check.outcome for check in worse.findings]
    assert {"failed", "warned", "noted", "skipped", "passed"} == set(outcomes)
    assert suite.get("failures") == str(outcomes.count("failed"))
    assert suite.get("skipped") == str(outcomes.count("skipped"))
    (failure,) = suite.findall(".//testcase[@name='depth no worse']/failure")
    assert failure.get("message") == "worse: 1 of 8 runs worse"
    assert "1 -> 2 mm (+100 %) at cone=elliptic timestep=0.001" in (failure.text or "")


def test_junit_names_are_unique_and_the_same_every_time(
    worse: ComparisonReport, same: ComparisonReport
) -> None:
    names = [
        [(case.get("classname"), case.get("name")) for case in ET.fromstring(text).iter("testcase")]  # noqa: S314
        for text in (as_junit(report_of(worse)), as_junit(report_of(same)))
    ]
    assert names[0] == names[1]
    assert len(set(names[0])) == len(names[0])
    assert ("contactlab.tried.labels", "no new chatter") in names[0]


@given(text=TEXTS)
def test_junit_holds_any_text(text: str) -> None:
    report = unreadable_report(StoreError(text), ComparePolicy(version=1))
    XSD.validate(as_junit(report_of(report)))


ANNOTATION = re.compile(r"::(error|warning) title=([^:,\n\r]*)::([^\n\r]*)")


@given(texts=st.lists(TEXTS, max_size=30))
def test_annotations_are_read_back(texts: list[str]) -> None:
    """As GitHub reads them: commands at the start of lines, three escapes undone."""
    checks = [check_of("", number, message=text, worst=()) for number, text in enumerate(texts)]
    report = MADE.model_copy(update={"findings": tuple(checks)})
    lines = as_annotations(report_of(report)).split("\n")
    assert lines.pop() == ""
    found = [ANNOTATION.fullmatch(line) for line in lines]
    messages = [unescaped(match[3]) for match in found if match]
    assert len(messages) == len(lines) == min(len(texts), 10)
    for number, (message, text) in enumerate(zip(messages[:9], texts, strict=False)):
        assert message == visible(f"check {number}: {text}")
    if len(texts) > 9:
        assert messages[9] == f"and {len(texts) - 9} more; see the summary"


def unescaped(text: str) -> str:
    return text.replace("%0A", "\n").replace("%0D", "\r").replace("%25", "%")


def test_errors_and_warnings_are_annotated(worse: ComparisonReport) -> None:
    lines = as_annotations(report_of(worse)).splitlines()
    assert "::error title=contactlab tried::no new chatter: 1 of 8 runs newly chatter" in lines[0]
    assert any("slip" in line and line.startswith("::error") for line in lines)
    assert any("cpu_model" in line and line.startswith("::warning") for line in lines)


class Cells(HTMLParser):
    """Collects the tags of an HTML fragment."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:  # noqa: ARG002
        self.tags.append(tag)


def rows_of(markdown: str) -> list[list[str]]:
    """Return the cells of every table row, escapes undone."""
    markdown = markdown.replace("<!-- -->", "").replace("&amp;", "&")
    rows = [line for line in markdown.splitlines() if line.startswith("| ")]
    cells = [re.split(r"(?<!\\)(?:\\\\)*\|", row)[1:-1] for row in rows]
    return [[re.sub(r"\\(.)", r"\1", cell.strip()) for cell in row] for row in cells]


def test_markdown_tells_the_worst_first(worse: ComparisonReport) -> None:
    text = as_markdown(report_of(worse))
    assert text.startswith("### ❌ worse: 2 of ")
    header, _, first, *_ = (line for line in text.splitlines() if line.startswith("|"))
    assert header == "|  | check | result | worst | where |"
    sign, name, found, values, where = rows_of(first)[0]
    assert (sign, name, found) == ("❌", "no new chatter", "1 of 8 runs newly chatter")
    assert values == "stable -> chatter"
    assert where == "cone=elliptic timestep=0.002 [00000000]"
    assert text.count("<details>") == text.count("</details>") == 2


@given(text=TEXTS)
def test_markdown_shows_any_text_as_it_is(text: str) -> None:
    report = MADE.model_copy(update={"findings": (check_of("", message=text, worst=()),)})
    markdown = as_markdown(report_of(report))
    (row,) = [row for row in rows_of(markdown) if len(row) > 1 and row[1].startswith("check 0")]
    assert len(row) == 5
    assert row[2] == " ".join(visible(text).split())
    parser = Cells()
    parser.feed(re.sub(r"\\<", "", markdown))
    assert set(parser.tags) <= {"details", "summary"}


@pytest.mark.parametrize("character", ["x", "é", "語"])
def test_markdown_stays_below_what_a_job_summary_holds(
    same: ComparisonReport, character: str
) -> None:
    """In bytes, of which a character may take several."""
    checks = [check_of(2_000 * character, number) for number in range(600)]
    text = as_markdown(report_of(failing(same, *checks)))
    assert 100_000 < len(text.encode()) < 900_000
    assert "The rest is left out" in text


def test_text_of_many_failures_stays_readable(same: ComparisonReport) -> None:
    checks = [check_of("", number, worst=(), kind="labels") for number in range(100)]
    lines = as_text(report_of(failing(same, *checks))).splitlines()
    assert sum(line.startswith("FAIL") for line in lines) == 26
    assert [line[:19] for line in lines if " more" in line] == ["FAIL  and 75 more ("]


def test_text_joins_metrics_that_fail_in_fewer_runs(same: ComparisonReport) -> None:
    checks = [check_of("", number, worst=(), judged=10, failing=number) for number in range(10)]
    named = [check.model_copy(update={"name": f"m{check.failing} no worse"}) for check in checks]
    lines = as_text(report_of(failing(same, *named))).splitlines()
    failed = [line.split()[1] for line in lines if line.startswith("FAIL")]
    assert failed == ["m9", "m8", "m7", "m6", "m5", "m4", "4"]
    assert any("4 more metrics" in line and "m3, m2, m1, m0" in line for line in lines)


def test_text_of_what_cannot_be_compared() -> None:
    report = unreadable_report(StoreError("no store at x"), ComparePolicy(version=1))
    text = "not comparable: no store at x\n\nFAIL  stores can be compared  no store at x\n"
    assert as_text(report_of(report)).startswith(text)
    assert report.exit_code == 3
    expected = "::error title=contactlab compare::stores can be compared: no store at x\n"
    assert as_annotations(report_of(report)) == expected


def _made() -> ComparisonReport:
    side: dict[str, Any] = {
        "store": "s",
        "sweep": "tried",
        "runs": 1,
        "engine": "mujoco 4.0.0",
        "contactlab": "0.1.0",
        "git_revision": "abc",
        "cpu_model": "cpu",
        "finished": "2026-01-01T00:00:00",
    }
    counts = dict.fromkeys(PairCounts.model_fields, 1)
    return ComparisonReport.model_validate(
        {
            "verdict": "worse",
            "exit_code": 1,
            "headline": "worse",
            "baseline": side,
            "candidate": side,
            "match": "id",
            "pairs": counts,
            "differences": (),
            "transitions": (),
            "findings": (),
            "advice": (),
        }
    )


MADE = _made()


@pytest.mark.parametrize("name", ["report.json", "report.md", "report.xml", "report.txt"])
def test_a_report_that_cannot_be_written_is_an_error(
    same: ComparisonReport, tmp_path: Path, name: str
) -> None:
    """A file is no folder, and a folder no file; both errors name the place."""
    (tmp_path / "file").write_text("")
    (tmp_path / name).mkdir()
    for path in (tmp_path / "file" / name, tmp_path / name):
        with pytest.raises(OutputError, match=rf"cannot write .*(file|{name})"):
            publish(same, files_to_write([path]))
    publish(same, files_to_write([tmp_path / "new" / name]))
    assert "same" in (tmp_path / "new" / name).read_text(encoding="utf-8")


def test_a_title_ends_no_property_of_an_annotation() -> None:
    """GitHub splits properties at commas, and names from values at colons."""
    assert write_annotations("a, b: 5 %", ["50 %, of: it"], []) == (
        "::error title=a%2C b%3A 5 %25::50 %25, of: it\n"
    )
