"""Cases of the catalogue, run as shipped or with a fault planted in their scene."""

import shutil
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from contactlab import resources
from contactlab.plan.overrides import Overrides
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep

# What a version of the engine changes is for `compare` to say; here it is held to one.
MAJOR = 4
NEWER = int(version("mujoco").partition(".")[0]) >= MAJOR

Rows = list[dict[str, Any]]
FOLDER = resources.SWEEPS / "stability"


UNCHECKED = "isotropy", "rest_penetration"
"""Cases whose outcomes no check changes, as a test of the night says; checks take most of them."""

BY_DAY = {"incline": ("rock=0",)}
"""Values of an axis that show a case's law alone."""


def swept(sweep: Path, store: Path, *settings: str, only: Sequence[str] = ()) -> Rows:
    """Run a sweep in this process, without traces, and return its table."""
    overrides = Overrides(("trace=none", *settings), only)
    ask = read_request(
        sweep, sweep.stem, store, folder=sweep.parent, workers=0, overrides=overrides
    )
    run_sweep(ask, lambda *_: None, lambda _finished: None)
    return pq.read_table(store / "runs.parquet").to_pylist()


@pytest.fixture(scope="session")
def case(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., Rows]:
    """Return the rows of a case that have the given values; each case runs once.

    A test of the night runs those of all seeds (`test_whole_cases.py`); by day the first will do,
    and of some cases a part.
    """
    tables: dict[str, Rows] = {}
    by_day = "not night" in request.config.option.markexpr

    def rows(name: str, **values: object) -> Rows:
        if name not in tables:
            store = tmp_path_factory.mktemp(name) / "store"
            settings = [*["seeds=1"] * by_day, *["checks=none"] * (name in UNCHECKED)]
            only = BY_DAY.get(name, ()) if by_day else ()
            tables[name] = swept(FOLDER / f"{name}.yaml", store, *settings, only=only)
        picked = [row for row in tables[name] if all(row[key] == values[key] for key in values)]
        assert picked
        return picked

    return rows


@pytest.fixture(scope="session")
def assert_expected() -> Callable[[Rows], None]:
    """Some runs hold, some fail with the label that they must get, and none is otherwise."""

    def check(rows: Rows) -> None:
        assert {row["status"] for row in rows} <= {"ok", "stopped"}
        assert [row["expectation_reason"] for row in rows if row["expectation_met"] is False] == []
        judged = [row for row in rows if row["expectation_met"]]
        assert any(row["label"] == "stable" for row in judged)
        assert any("stable" not in (row["expected"] or ["stable"]) for row in judged)

    return check


@pytest.fixture
def planted(tmp_path: Path) -> Callable[..., Rows]:
    """Run some of a case on a copy of its scene in which one text is replaced."""

    def rows(name: str, old: str, new: str, *only: str) -> Rows:
        text = (FOLDER / f"{name}.yaml").read_text()
        scene = next(line for line in text.splitlines() if line.startswith("scene: "))[7:]
        shutil.copytree(resources.MODELS / scene, tmp_path / scene)
        model = tmp_path / scene / "scene.xml"
        assert old in model.read_text()
        model.write_text(model.read_text().replace(old, new))
        copy = tmp_path / "copy.yaml"
        copy.write_text(text.replace(f"scene: {scene}", f"scene: ./{scene}"))
        return swept(copy, tmp_path / "store", only=only)

    return rows


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip the catalogue on engines that it was not measured on."""
    reason = f"the catalogue's numbers are those of MuJoCo {MAJOR}"
    here = Path(__file__).parent
    for item in items:
        if not NEWER and item.path.is_relative_to(here):
            item.add_marker(pytest.mark.skip(reason=reason))
