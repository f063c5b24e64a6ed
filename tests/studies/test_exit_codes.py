"""The exit code of an examination follows from its verdict, in every format."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.studies.test_examination import LABEL, examined
from tests.verdicts.corpus import FOLDER, read_part

import contactlab
from contactlab.page.examination_view import ExaminationView
from contactlab.page.header_films import Films
from contactlab.rendering.text import render_text
from contactlab.reporting.examination_document import (
    describe_examination,
    findings_of_examination,
)
from contactlab.schema.error_budget import BudgetReason
from contactlab.schema.examination import Examination
from contactlab.schema.finding import Finding, Waiver
from contactlab.studies.examine.conclusion import conclude
from contactlab.writers.junit import as_junit

PASSING = {"ok", "depends"}
REASONS = {
    "numerical error": "inaccurate",
    "warning": "inaccurate",
    "energy": "inaccurate",
    "reference": "undecided",
    "cone": "depends",
}
CHECKS = {
    "numerical_error": "task",
    "energy_drift": "task",
    "failure_labels": "task",
    "impossible_bodies": "inertia",
    "trajectories_differ": "repeat",
}
QUICK = {"a flywheel that an implicit integrator brakes"}
ENERGY_ALONE = "a spinning plate whose energy grows with the step"


def finding(name: str, outcome: str) -> Finding:
    return Finding.model_validate(
        {
            "name": name,
            "kind": CHECKS[name],
            "level": "gate",
            "outcome": "noted" if outcome == "waived" else outcome,
            "verdict": "met" if outcome == "passed" else "unmet",
            "judged": 1,
            "failing": int(outcome != "passed"),
            "message": name,
            "waived": "a reason" if outcome == "waived" else None,
        }
    )


@st.composite
def reports(draw: st.DrawFn) -> Examination:
    """Draw an examination with any reasons, labels, and results of any selected checks."""
    rows = draw(st.lists(st.sampled_from([*REASONS]), unique=True))
    where: Any = {"body": "mug", "place": "floor - mug", "time": 0.2, "sentence": "a sentence"}
    order = ["inaccurate", "undecided", "depends"]
    reasons = sorted(
        (
            BudgetReason.model_validate(
                {"verdict": REASONS[row], "phase": "held", "row": row, "error": 0.4, **where}
            )
            for row in rows
        ),
        key=lambda reason: order.index(reason.verdict),
    )
    outcomes = st.sampled_from(["passed", "failed", "waived"])
    selected = draw(st.lists(st.sampled_from([*CHECKS]), unique=True))
    report = examined("ok")
    assert report.budget
    word = reasons[0].verdict if reasons else "ok"
    budget = report.budget.model_copy(update={"reasons": tuple(reasons), "verdict": word})
    updates = {
        "budget": budget,
        "labels": draw(st.sampled_from([(), (LABEL,)])),
        "findings": tuple(finding(name, draw(outcomes)) for name in selected),
    }
    return conclude(report.model_copy(update=updates))


def assert_formats_agree(report: Examination) -> None:
    """Assert that verdict, exit code, headline and each format pass or fail together."""
    passes = report.verdict in PASSING
    assert report.passed == passes
    assert (not report.problem) == passes
    assert render_text(describe_examination(report)).startswith(str(report.verdict))
    assert Examination.model_validate_json(report.model_dump_json()).passed == passes
    written = findings_of_examination(report)
    assert written.passed == passes
    page = ExaminationView(report, Films([]), None, describe_examination(report), "")
    assert (page.verdict != "unmet") == passes
    suite = ET.fromstring(as_junit(written)).find("testsuite")  # noqa: S314 - our own
    assert suite is not None
    assert (suite.get("failures") == "0") == passes


@given(report=reports())
def test_the_exit_code_is_zero_exactly_for_ok_and_depends(report: Examination) -> None:
    assert_formats_agree(report)
    if report.findings:
        assert report.passed == all(one.outcome != "failed" for one in report.findings)


def test_a_choice_that_passes_explains_no_failed_check() -> None:
    report = examined("depends")
    assert report.passed
    failed = (finding("numerical_error", "failed"),)
    again = conclude(report.model_copy(update={"findings": failed}))
    assert again.verdict == "fails"
    assert_formats_agree(again)


@given(report=reports())
def test_a_waived_failure_does_not_fail_the_verdict(report: Examination) -> None:
    waived = [
        one.model_copy(update={"outcome": "noted", "waived": "a reason"})
        if one.outcome == "failed"
        else one
        for one in report.findings
    ]
    if waived:
        assert_formats_agree(
            again := conclude(report.model_copy(update={"findings": tuple(waived)}))
        )
        assert again.verdict in PASSING


def judged(case: Any, path: Path, *, healthy: bool, **options: Any) -> Examination:
    path.write_text(case.text(healthy=healthy), encoding="utf-8")
    duration = f"{case.duration} s"
    out = path.with_suffix(".json")
    out.unlink(missing_ok=True)
    return contactlab.examine(
        path, section=["checks"], drive="none", duration=duration, output=out, **options
    )


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=() if case.name in QUICK else pytest.mark.night, id=case.name)
        for case in read_part(FOLDER / "open").cases
    ],
)
def test_a_model_of_the_corpus_has_one_verdict_in_every_format(case: Any, tmp_path: Path) -> None:
    for healthy in case.told:
        report = judged(case, tmp_path / "model.xml", healthy=healthy)
        assert_formats_agree(report)
        assert report.passed == all(one.outcome != "failed" for one in report.findings)


@pytest.mark.long
def test_energy_alone_fails_unless_it_is_waived(tmp_path: Path) -> None:
    """Its numerical error is within the tolerance, and its energy is not."""
    (case,) = (one for one in read_part(FOLDER / "open").cases if one.name == ENERGY_ALONE)
    path, task = tmp_path / "plate.xml", {"check": ["task"], "tolerance": ["failure_labels=9"]}
    report = judged(case, path, healthy=False, **task)
    assert [one.name for one in report.findings if one.outcome == "failed"] == ["energy_drift"]
    assert (report.verdict, report.passed) == ("inaccurate", False)
    waiver = Waiver(check="energy_drift", max=2, reason="the plate is a toy")
    waived = judged(case, path, healthy=False, waive=[waiver], **task)
    assert (waived.verdict, waived.headline) == ("ok", "ok: energy_drift waived")
    assert_formats_agree(waived)
    inertia = judged(case, path, healthy=False, check=["inertia"])
    assert (inertia.verdict, inertia.headline) == ("ok", "ok: no check failed (inertia)")
