"""The study of hard cases as a function: one report, a line for each case, and names that exist."""

from pathlib import Path

import pytest

from contactlab.errors import SweepFileError
from contactlab.schema.check_report import StabilityReport
from contactlab.studies.session import Session
from contactlab.studies.stability_cases import StabilityRequest, find_cases, run


def test_every_case_is_reported_as_data(tmp_path: Path) -> None:
    lines: list[str] = []
    report = run(StabilityRequest(("free_fall",)), Session(tmp_path, notify=lines.append))
    assert lines == ["1/1 free_fall: ok"]
    assert report.passed
    (case,) = report.cases
    assert case.store == str(tmp_path / "free_fall")
    assert sum(case.labels.values()) == case.runs >= case.asked == case.met > 0
    assert StabilityReport.model_validate_json(report.model_dump_json()) == report


def test_an_unknown_case_is_refused_with_a_hint() -> None:
    with pytest.raises(SweepFileError, match="did you mean 'free_fall'"):
        find_cases(["fre_fall"])
