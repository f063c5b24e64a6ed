"""Killing a sweep from outside, at any moment, costs nothing but time."""

import os
import random
import signal
import time
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


# Spawned workers import everything again; forked ones have it.
SPAWNED = """
import sys
if any(each.endswith("contactlab") for each in sys.orig_argv):
    import multiprocessing
    import contactlab.run.fork_server as fork_server
    import contactlab.run.worker_pool as worker_pool
    worker_pool.CONTEXT = multiprocessing.get_context("spawn")
"""
SHARDS = ("1/2", "2/2")


@pytest.mark.night
@pytest.mark.parametrize("kind", ["forked", "spawned", "shards"])
def test_killed_forty_times(
    command: Any, tmp_path: Path, outcome: Callable[[Path], Any], kind: str
) -> None:
    """At random times, from the start of Python on; stores that get finished are begun again."""
    dice = random.Random(kind)  # noqa: S311
    sweep, first = ("sweep", "long.yaml", "--workers", "2"), None
    if kind == "spawned":
        first = tmp_path / "first"
        first.mkdir()
        (first / "sitecustomize.py").write_text(SPAWNED)
    began = time.monotonic()
    assert command.run(*sweep, "-o", "whole", first=first)[0] == 0
    takes = time.monotonic() - began
    whole, killed, lives = outcome(tmp_path / "whole"), 0, 0
    while killed < 40:
        lives += 1
        parts = SHARDS if kind == "shards" else ("",)
        places = [f"store{lives}-{number}" for number in range(len(parts))]
        for part, place in zip(parts, places, strict=True):
            shard = ("--shard", part) if part else ()
            killed += command.finish_under_kills(
                *sweep, *shard, "-o", place, first=first, dice=dice, longest=takes
            )
        store = places[0]
        if kind == "shards":
            store = f"merged{lives}"
            assert command.run("sweep", *places, "--merge", "-o", store)[0] == 0
        assert outcome(tmp_path / store) == whole, (killed, lives)
        assert find_problems(tmp_path / store) == []


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
