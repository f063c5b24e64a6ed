"""The process that times stored runs on command."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from contactlab.run.stored_runs import MAX_STEPS, timed_run
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store

pytestmark = pytest.mark.long

SERVE = "from contactlab.run.stored_runs import main; main()"
SWEEP = """\
version: 1
scene: ball_drop
duration: 0.1
trace: none
axes: {timestep: [1.0e-3, 2.0e-3]}
"""


def test_it_times_runs_and_says_what_it_cannot(tmp_path: Path) -> None:
    ask = read_request(SWEEP, "tried", tmp_path / "store", folder=tmp_path, workers=0)
    run_sweep(ask, lambda *_: None, lambda _finished: None)
    store = Store.open(tmp_path / "store")
    ids = store.table["run_id"].to_pylist()
    asked = [{"run": run, "repeats": 3} for run in (*ids, "nothing", ids[0])]
    done = subprocess.run(
        [sys.executable, "-c", SERVE, str(store.path)],
        input="".join(json.dumps(line) + "\n" for line in asked),
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    greeting, *answers = map(json.loads, done.stdout.splitlines())
    assert greeting["engine"].startswith("mujoco ")
    assert [each.get("steps") for each in answers] == [300, 150, None, 300]
    assert all(each["seconds"] > 0 for each in answers if "seconds" in each)
    assert "no run in" in answers[2]["error"]


def test_it_starts_where_the_run_went(tmp_path: Path) -> None:
    ask = read_request(SWEEP, "tried", tmp_path / "store", folder=tmp_path, workers=0)
    run_sweep(ask, lambda *_: None, lambda _finished: None)
    store = Store.open(tmp_path / "store")
    record = next(store.records())
    _, segments = timed_run(store, record.run_id)
    assert segments.work.steps == record.steps
    assert sum(segments.lengths(MAX_STEPS)) == record.steps
    assert segments.model.opt.timestep == record.settings["timestep"]


def test_no_store(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SERVE, str(tmp_path)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("error: ")
