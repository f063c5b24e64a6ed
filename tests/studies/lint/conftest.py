"""Models with one planted defect each, and their clean twins."""

from collections.abc import Callable
from pathlib import Path

import pytest

from contactlab.schema.finding import PlacedFinding
from contactlab.schema.lint_report import LintReport
from contactlab.studies.lint.linting import lint

Linted = Callable[[str], LintReport]


@pytest.fixture
def linted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Linted:
    """Lint a model that is given as text, in a folder that is the working directory."""
    monkeypatch.chdir(tmp_path)

    def run(text: str) -> LintReport:
        name = "robot.urdf" if "<robot" in text else "robot.xml"
        (tmp_path / name).write_text(text, encoding="utf-8")
        return lint([name])

    return run


def rules_of(report: LintReport) -> set[str]:
    """Return the rules that a report has findings of."""
    return {finding.name for finding in report.findings}


def only(report: LintReport, rule: str) -> PlacedFinding:
    """Return the one finding of a rule."""
    (found,) = (finding for finding in report.findings if finding.name == rule)
    return found
