"""Runs the command line in this process, and offers a small store to look at."""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from contactlab.command_line import terminal
from contactlab.command_line.main import main

SWEEP = """
version: 1
scene: ball_drop
duration: 0.3
axes:
  timestep: [2.0e-3, 2.0e-2]
  drop_height: [0.02, 0.1]
expect:
  - {where: {timestep: 2.0e-3}, metrics: {penetration_max: {max: 1}}}
"""


class Result(NamedTuple):
    """What a command ended in."""

    code: int
    out: str
    err: str


Run = Callable[..., Result]


@pytest.fixture
def contactlab(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Run:
    """Run a command in an empty folder; however slow the machine is, without progress."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONSAFEPATH", "1")
    monkeypatch.setattr(terminal, "_QUIET_SECONDS", float("inf"))

    def run(*arguments: str) -> Result:
        monkeypatch.setattr(sys, "argv", ["contactlab", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        code = ended.value.code
        assert isinstance(code, int)
        out, err = capfd.readouterr()
        return Result(code, str(out), str(err))

    return run


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A sweep file of 4 runs."""
    path = tmp_path / "small.yaml"
    path.write_text(SWEEP)
    return path


@pytest.fixture(scope="session")
def _written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store that nobody may change."""
    folder = tmp_path_factory.mktemp("written")
    (folder / "small.yaml").write_text(SWEEP)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("PYTHONSAFEPATH", "1")  # which the command sets
        command = ["contactlab", "sweep", "small.yaml", "-o", "store", "--workers", "0"]
        patch.setattr(sys, "argv", command)
        with pytest.raises(SystemExit) as ended:
            main()
    assert ended.value.code == 0
    return folder / "store"


@pytest.fixture
def store(_written: Path, tmp_path: Path) -> Path:
    """A copy of a store of 4 runs, named as commands in `tmp_path` name it."""
    shutil.copytree(_written, tmp_path / "store")
    return Path("store")
