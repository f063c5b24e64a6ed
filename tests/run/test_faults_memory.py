"""Workers that are short of memory: runs that fit go on, those that do not are told as such."""

import json
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest

from contactlab.engines.engine import bytes_of_run
from contactlab.run.planned_runs import JOB_BYTES
from contactlab.store.verify_store import find_problems

# The last timestep makes runs of 300,000 steps.
SWEEP = """
version: 1
scene: ball_drop
duration: 0.3
seeds: 4
trace: none
axes:
  timestep: [1.0e-3, 2.0e-3, 3.0e-3, 1.0e-6]
"""
# The engine asks for this model's arena at once.
ARENA = """
<mujoco>
  <size memory="256M"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="ball" pos="0 0 .1"><freejoint/><geom name="ball" size=".05"/></body>
  </worldbody>
</mujoco>
"""
LARGE = set(range(12, 16))
# As NumPy and as MuJoCo put it: which of them asks first for what is not there differs.
OUT_OF_MEMORY = ("out of memory: Unable to allocate ", "out of memory: Could not allocate memory")
RUNS = 16


@pytest.fixture(scope="module")
def quiet(tmp_path_factory: pytest.TempPathFactory, make_sweeper: Callable[[Path], Any]) -> Any:
    """What comes of the runs that fit."""
    sweeper = make_sweeper(tmp_path_factory.mktemp("quiet"))
    with chdir(sweeper.folder):
        sweeper.run(SWEEP.replace(", 1.0e-6", ""))
    return sweeper.outcome()


@pytest.mark.night
def test_only_runs_that_do_not_fit_are_lost(
    command: Any, sweeper: Any, inject: Any, tmp_path: Path, quiet: Any, but: Any
) -> None:
    model = sweeper.ask(SWEEP).scene.base({}).model
    # What a run records does not fit; a job of the small runs, all that it needs and as much
    # again, does.
    spare = bytes_of_run(model, 300_000) * 4 // 5
    assert spare > 8 * 12 * bytes_of_run(model, 300)
    assert spare < JOB_BYTES * 3
    (tmp_path / "small.yaml").write_text(SWEEP)
    sweep = ("sweep", "small.yaml", "-o", "store", "--workers", "2", "--format", "json")
    code, out, err = command.run(*sweep, first=inject({}, spare))
    assert (code, err) == (4, "error: 4 of 16 runs crashed or timed out\n")
    assert json.loads(out)["statuses"] == {"ok": 12, "crashed": 4}
    table, _ = sweeper.outcome()
    for place in LARGE:
        assert table["label"][place] == "crashed"
        assert table["status_reason"][place].startswith(OUT_OF_MEMORY)
    found, _ = but(sweeper.outcome(), LARGE)
    assert found["trajectory_hash"] == quiet[0]["trajectory_hash"]
    assert found["label"] == quiet[0]["label"]
    assert find_problems(tmp_path / "store") == []


@pytest.mark.night
def test_workers_that_can_have_no_memory_end_the_sweep(
    command: Any, inject: Any, tmp_path: Path
) -> None:
    """Here the engine itself cannot have what it asks for."""
    (tmp_path / "arena.xml").write_text(ARENA)
    (tmp_path / "small.yaml").write_text(SWEEP.replace("ball_drop", "arena.xml"))
    sweep = ("sweep", "small.yaml", "-o", "store", "--workers", "1", "--format", "json")
    code, out, err = command.run(*sweep, "--limit", "3", first=inject({}, 0))
    assert (code, err) == (4, "error: 3 of 3 runs crashed or timed out\n")
    assert json.loads(out)["statuses"] == {"crashed": 3}
    shown = json.loads(command.run("show", "store", "--format", "json")[1])
    assert shown
    assert find_problems(tmp_path / "store") == []
