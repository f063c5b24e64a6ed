"""Checks of shipped scenes and of small models of our own, run in this process."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.plan.task_options import TaskOptions
from contactlab.schema.check_report import CheckResult, Measure
from contactlab.schema.examination import Examination
from contactlab.studies.examine.examination import ExamineRequest, examine_model
from contactlab.tasks.session import Session

Checked = Callable[..., Examination]


@pytest.fixture(autouse=True)
def _outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work outside of any repository, whose state records would name."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def checked(tmp_path: Path) -> Checked:
    """Check a scene by name, or a model given as MJCF, into `tmp_path / "check"`."""

    def check(model: str, *only: str, assign: tuple[str, ...] = (), **task: Any) -> Examination:
        if model.lstrip().startswith("<"):
            (tmp_path / "own.xml").write_text(model)
            model = "own.xml"
        request = ExamineRequest(
            model, assign, TaskOptions(**task), sections=("checks",), checks=only
        )
        return examine_model(request, Session(tmp_path / "check"))

    return check


@pytest.fixture
def one(checked: Checked) -> Callable[..., CheckResult]:
    """Run one check, by name."""

    def check(model: str, name: str, *assign: str, **task: Any) -> CheckResult:
        (result,) = checked(model, name, assign=assign, **task).checks
        return result

    return check


@pytest.fixture(scope="session")
def missed() -> Callable[[CheckResult], list[Measure]]:
    """Give the measures of a check whose limit is not kept."""
    return lambda result: [measure for measure in result.measures if measure.holds is False]
