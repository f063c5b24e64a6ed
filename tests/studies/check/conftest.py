"""Checks of shipped scenes and of small models of our own, run in this process."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from contactlab.plan.task_options import TaskOptions
from contactlab.schema.check_report import CheckReport, CheckResult, Measure
from contactlab.schema.drive import Drive
from contactlab.studies.check.model_check import CheckRequest, run
from contactlab.studies.session import Session

Checked = Callable[..., CheckReport]


@pytest.fixture(autouse=True)
def _outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work outside of any repository, whose state records would name."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def checked(tmp_path: Path) -> Checked:
    """Check a scene by name, or a model given as MJCF, into `tmp_path / "check"`."""

    def check(
        model: str,
        *only: str,
        assign: tuple[str, ...] = (),
        drive: Drive | None = None,
        limits: dict[str, float] | None = None,
        **options: Any,
    ) -> CheckReport:
        if model.lstrip().startswith("<"):
            (tmp_path / "own.xml").write_text(model)
            model = "own.xml"
        task = TaskOptions(drive=drive, limits=limits or {})
        request = CheckRequest(model, assign, only, task=task, **options)
        return run(request, Session(tmp_path / "check"))

    return check


@pytest.fixture
def one(checked: Checked) -> Callable[..., CheckResult]:
    """Run one check, by name, without remedies."""

    def check(model: str, name: str, *assign: str, **options: Any) -> CheckResult:
        (result,) = checked(model, name, assign=assign, remedies=False, **options).checks
        return result

    return check


@pytest.fixture(scope="session")
def values() -> Callable[[CheckResult, str], Mapping[str | None, float | None]]:
    """Give the values of a check's measures of one name, by what they belong to."""

    def pick(result: CheckResult, name: str) -> Mapping[str | None, float | None]:
        return {each.of: each.value for each in result.measures if each.name == name}

    return pick


@pytest.fixture(scope="session")
def missed() -> Callable[[CheckResult], list[Measure]]:
    """Give the measures of a check whose limit is not kept."""
    return lambda result: [each for each in result.measures if each.holds is False]
