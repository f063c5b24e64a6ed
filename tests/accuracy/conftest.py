"""Small sweeps with passes after their runs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from contactlab.plan.sweep_file import read_sweep
from contactlab.run.sweep_request import SceneLoader, SweepRequest
from contactlab.run.sweep_runner import run_sweep

BALL = """
version: 1
scene: ball_drop
duration: 0.3
seeds: 3
axes:
  timestep: [1.0e-3, 2.0e-3, 3.0e-3]
  drop_height: [0.02, 0.1]
"""


class Sweeper:
    """Runs sweep texts into stores below one folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def run(self, text: str, name: str = "store", workers: int = 0) -> None:
        run_sweep(self.ask(text, name, workers), begin=lambda *_: None, progress=lambda _: None)

    def ask(self, text: str, name: str = "store", workers: int = 0) -> SweepRequest:
        scenes = SceneLoader(self.folder)
        read = read_sweep(text, scenes.vocabulary)
        return SweepRequest(
            plan=read.plan,
            scene=scenes.open(read.sweep.scene),
            name="small",
            source=text,
            overrides=(),
            store=self.folder / name,
            workers=workers,
        )

    def rows(self, name: str = "store") -> list[dict[str, Any]]:
        return pq.read_table(self.folder / name / "runs.parquet").to_pylist()


@pytest.fixture(autouse=True)
def _outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work outside of any repository, whose state records would name."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def sweeper(tmp_path: Path) -> Sweeper:
    return Sweeper(tmp_path)


@pytest.fixture(scope="session")
def make_sweeper() -> Callable[[Path], Sweeper]:
    """Return a maker of sweepers, for sweeps that several tests look at."""
    return Sweeper


@pytest.fixture(scope="session")
def ball() -> str:
    return BALL
