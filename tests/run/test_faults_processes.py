"""Processes of a sweep that are killed while a long run holds a worker: nothing stays behind."""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.store.verify_store import find_problems

Until = Callable[[Callable[[], bool]], None]

# One run of minutes, of whose steps no Python code sees any.
LONG = """
version: 1
scene: box_stack
duration: 60
timeout: 600
trace: none
axes:
  boxes: [10]
  solver: [PGS]
  iterations: [1000]
  tolerance: [0]
"""
SHORT = """
version: 1
scene: ball_drop
duration: 0.3
seeds: 40
axes:
  timestep: [1.0e-3, 1.5e-3, 2.0e-3, 3.0e-3]
  drop_height: [0.02, 0.1]
"""
# Far less than what is left of the run, far more than a process takes to end.
SOON = 10


@pytest.fixture
def steps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], bool]:
    """Return whether a worker makes steps: then its watchdog is set, and has a file to write to."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    return lambda: any(name.isdigit() for _, _, names in os.walk(folder) for name in names)


@pytest.mark.night
def test_a_long_run_ends_with_the_command(
    command: Any, tmp_path: Path, until: Until, steps: Callable[[], bool]
) -> None:
    (tmp_path / "long.yaml").write_text(LONG)
    process = command.start("sweep", "long.yaml", "-o", "store", "--workers", "1")
    until(steps)
    (worker,) = command.workers(process.pid)
    # Where memory runs out, the system ends this one first.
    assert Path(f"/proc/{worker}/oom_score_adj").read_text() == "1000\n"
    process.kill()
    killed = time.monotonic()
    process.communicate(timeout=60)
    until(lambda: command.living(process.pid) == [])
    assert time.monotonic() - killed < SOON


@pytest.mark.night
def test_a_hang_ends_with_the_command(
    command: Any, tmp_path: Path, until: Until, steps: Callable[[], bool], inject: Any
) -> None:
    """Python itself gets no turn while something else keeps the interpreter's lock."""
    (tmp_path / "small.yaml").write_text(f"{SHORT}timeout: 600\n")
    sweep = ("sweep", "small.yaml", "-o", "store", "--workers", "1", "--limit", "1")
    process = command.start(*sweep, first=inject({0: "hang"}))
    until(steps)
    process.kill()
    killed = time.monotonic()
    process.communicate(timeout=60)
    until(lambda: command.living(process.pid) == [])
    assert time.monotonic() - killed < SOON


@pytest.mark.night
def test_a_worker_that_is_killed_in_a_long_run_is_replaced(
    command: Any, tmp_path: Path, until: Until, steps: Callable[[], bool]
) -> None:
    (tmp_path / "long.yaml").write_text(LONG)
    process = command.start("sweep", "long.yaml", "-o", "store", "--workers", "1")
    killed: set[int] = set()

    def new() -> set[int]:
        return set(command.workers(process.pid)) - killed

    # In its job, then twice by itself.
    for _ in range(3):
        until(lambda: new() != set() and steps())
        (worker,) = new()
        os.kill(worker, signal.SIGKILL)
        killed.add(worker)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (4, "error: 1 of 1 run crashed or timed out\n")
    assert "crashed" in out
    assert find_problems(tmp_path / "store") == []


@pytest.mark.night
def test_killing_the_fork_server_loses_nothing(
    command: Any, sweeper: Any, tmp_path: Path, until: Until
) -> None:
    (tmp_path / "small.yaml").write_text(SHORT)
    journal = tmp_path / "store" / "journal.jsonl"
    process = command.start("sweep", "small.yaml", "-o", "store", "--workers", "2")
    until(lambda: journal.exists() and journal.stat().st_size > 0)
    (server,) = command.servers(process.pid)
    workers = command.workers(process.pid)
    os.kill(server, signal.SIGKILL)
    os.kill(workers[0], signal.SIGKILL)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert "Traceback" not in err
    sweeper.run(SHORT, "quiet")
    assert sweeper.outcome() == sweeper.outcome("quiet")
    until(lambda: command.living(process.pid) == [])
