"""An engine of MuJoCo itself, in a process of its own, in which a defect may be planted."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from contactlab.engines import ENGINES
from contactlab.engines.adapted_engine import AdaptedEngine
from contactlab.plan.overrides import Overrides
from contactlab.schema.comparison import ComparePolicy
from contactlab.studies.parity.panel import Panel
from contactlab.studies.parity.parity_report import ParityReport
from contactlab.studies.parity.sweep_parity import ParityRequest, compare_runs

ADAPTER = Path(__file__).with_name("stand_in.py")


class StandIn(AdaptedEngine):
    """It runs in this environment, which has MuJoCo."""

    @property
    def environment(self) -> Path:
        return Path(sys.prefix)


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], AdaptedEngine]:
    """Return what registers the stand-in with a defect."""

    def registered(defect: str) -> AdaptedEngine:
        monkeypatch.setenv("CONTACTLAB_DEFECT", defect)
        engine = StandIn(ADAPTER)
        monkeypatch.setitem(ENGINES, engine.name, engine)
        return engine

    return registered


@pytest.fixture
def parity(stand_in: Callable[[str], AdaptedEngine], tmp_path: Path) -> Callable[..., ParityReport]:
    """Return what compares the stand-in with MuJoCo in a sweep."""

    def compared(text: str, defect: str = "", *changes: str, **policy: object) -> ParityReport:
        file = tmp_path / "panel.yaml"
        file.write_text(text)
        engine = stand_in(defect)
        panel = Panel.read(file, engine.name, Overrides(), changes, None)
        rules = ComparePolicy.model_validate({"version": 1, **policy})
        request = ParityRequest(panel, engine, "", changes, rules)
        return compare_runs(request, lambda *_: None, lambda _: None)

    return compared
