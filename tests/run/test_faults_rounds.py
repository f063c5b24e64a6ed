"""Twenty rounds of random faults in one sweep: every run once, with the label that it earned."""

import json
import os
import random
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from contactlab.store.verify_store import find_problems

SWEEP = """
version: 1
scene: ball_drop
duration: 0.1
seeds: 20
timeout: 1.5
axes:
  timestep: [1.0e-3, 1.5e-3, 2.0e-3, 3.0e-3]
  drop_height: [0.02, 0.05, 0.1, 0.2]
"""
ROUNDS = 20
# What hangs hangs for ever; a busy machine takes a few minutes [s].
LONGEST = 600
RUNS = 320
EACH = RUNS // ROUNDS
STATUS = {
    "segfault": "crashed",
    "kill": "crashed",
    "abort": "crashed",
    "exit 0": "crashed",
    "exit 3": "crashed",
    "memory": "crashed",
    "hang": "timeout",
    "engine error": "error",
    "huge": "ok",
}


def drawn(dice: random.Random) -> dict[int, str]:
    """Return the faults of all rounds: of 16 runs each, up to 3 fail; every kind comes up."""
    kinds = list(STATUS)
    picked = {
        EACH * number + place: dice.choice(kinds)
        for number in range(ROUNDS)
        for place in dice.sample(range(EACH), dice.randint(1, 3))
    }
    places = dice.sample(sorted(picked), len(kinds))
    return picked | dict(zip(places, kinds, strict=True))


def close(command: Any, process: Any, journal: Path, dice: random.Random) -> int:
    """Kill a worker at random moments, as runs finish; return how many were killed."""
    killed, threshold, deadline = 0, 0, time.monotonic() + LONGEST
    while process.poll() is None:
        assert time.monotonic() < deadline, "the sweep hangs"
        with suppress(subprocess.TimeoutExpired):
            process.wait(dice.uniform(0, 0.02))
        written = journal.read_bytes().count(b"\n") if journal.exists() else 0
        # Not among the last, where a run is by itself for the second time.
        if written <= threshold or written > RUNS * 2 // 3 or killed == ROUNDS:
            continue
        threshold = written + dice.randint(1, 4)
        workers = command.workers(process.pid)
        if workers:
            os.kill(dice.choice(workers), signal.SIGKILL)
            killed += 1
    return killed


@pytest.mark.night
def test_twenty_rounds_of_random_faults(
    command: Any, sweeper: Any, inject: Any, but: Callable[..., Any], tmp_path: Path, until: Any
) -> None:
    dice = random.Random(20)  # noqa: S311
    faults = drawn(dice)
    (tmp_path / "small.yaml").write_text(SWEEP)
    sweep = ("sweep", "small.yaml", "-o", "store", "--workers", "2", "--format", "json")
    process = command.start(*sweep, first=inject(faults))
    killed = close(command, process, tmp_path / "store" / "journal.jsonl", dice)
    out, err = process.communicate(timeout=120)
    assert killed >= ROUNDS // 4
    assert "Traceback" not in err
    assert process.returncode == 4, err
    assert sum(json.loads(out)["statuses"].values()) == RUNS
    table, _ = sweeper.outcome()
    assert table["index"] == list(range(RUNS))
    assert len(set(table["run_id"])) == RUNS
    expected = {place: STATUS[fault] for place, fault in faults.items()}
    assert {place: table["status"][place] for place in faults} == expected
    assert find_problems(tmp_path / "store") == []
    sweeper.run(SWEEP, "quiet")
    lost = {place for place, status in expected.items() if status != "ok"}
    assert but(sweeper.outcome(), lost) == but(sweeper.outcome("quiet"), lost)
    until(lambda: command.living(process.pid) == [])
