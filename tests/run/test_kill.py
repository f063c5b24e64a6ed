"""Killing a sweep from outside, at any moment, costs nothing but time."""

import os
import random
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.store.verify_store import find_problems

Until = Callable[[Callable[[], bool]], None]

LONG = """
version: 1
scene: ball_drop
duration: 0.5
seeds: 24
axes:
  timestep: [1.0e-3, 1.5e-3, 2.0e-3, 3.0e-3]
  drop_height: [0.1, 0.2, 0.3]
  cone: [pyramidal, elliptic]
"""
RUNS = 576


@pytest.fixture(autouse=True)
def _long(tmp_path: Path) -> None:
    (tmp_path / "long.yaml").write_text(LONG)


def size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


@pytest.mark.night
def test_killed_five_times(
    command: Any, tmp_path: Path, until: Until, outcome: Callable[[Path], Any]
) -> None:
    """At random moments; test_killed_writes.py kills at every write in turn."""
    dice = random.Random(10)  # noqa: S311
    store, journal = tmp_path / "store", tmp_path / "store" / "journal.jsonl"
    for _ in range(5):
        enough = size(journal) + dice.randrange(1, 40_000)
        process = command.start("sweep", "long.yaml", "-o", "store", "--workers", "2")
        until(lambda enough=enough: size(journal) > enough)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        assert not (store / "manifest.json").exists(), "the sweep is too short for this test"
    code, _, err = command.run("sweep", "long.yaml", "-o", "store", "--workers", "2")
    table, traces = outcome(store)
    assert set(table["status_reason"]) == {None}
    assert code == 0, err
    assert f"of {RUNS:,} runs are stored already" in err
    assert find_problems(store) == []
    assert command.run("sweep", "long.yaml", "-o", "whole", "--workers", "2")[0] == 0
    assert (table, traces) == outcome(tmp_path / "whole")


@pytest.mark.night
@pytest.mark.parametrize(
    "begun", [pytest.param("store", marks=pytest.mark.night), "servers", "workers"]
)
def test_interrupted_while_workers_start(
    command: Any, tmp_path: Path, until: Until, begun: str
) -> None:
    """Ctrl-C reaches every process of the terminal, also those that are only just starting."""
    process = command.start("sweep", "long.yaml", "-o", "store", "--workers", "2")
    if begun == "store":
        until((tmp_path / "store").exists)
    else:
        until(lambda: len(getattr(command, begun)(process.pid)) > 0)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    until(lambda: command.living(process.pid) == [])


@pytest.mark.long
def test_interrupted_and_resumed(command: Any, tmp_path: Path, until: Until) -> None:
    limit = ("--limit", "100", "--workers", "2", "-o", "store")
    process = command.start("sweep", "long.yaml", *limit)
    until(lambda: size(tmp_path / "store" / "journal.jsonl") > 0)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, "")
    assert (
        err.splitlines()[-1]
        == "interrupted; finished runs are kept: run the same command again to resume"
    )
    assert "Traceback" not in err
    until(lambda: command.living(process.pid) == [])
    code, out, err = command.run("sweep", "long.yaml", *limit)
    assert code == 0, err
    assert "of 100 runs are stored already" in err
    assert find_problems(tmp_path / "store") == []


@pytest.mark.night
def test_workers_end_with_their_parent(command: Any, tmp_path: Path, until: Until) -> None:
    process = command.start("sweep", "long.yaml", "-o", "store", "--workers", "2")
    until(lambda: size(tmp_path / "store" / "journal.jsonl") > 0)
    assert len(command.living(process.pid)) >= 4
    process.kill()
    process.communicate(timeout=60)
    until(lambda: command.living(process.pid) == [])
