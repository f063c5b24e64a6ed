"""Whether a run's label survives a start a millionth away."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.scene.scene import Scene

SWEEP = """\
version: 1
scene: ball_drop
seeds: 16
trace: none
knife_edge: {asked}
axes: {{restitution: [0.6], timestep: [2.0e-3]}}
"""


def swept(folder: Path, asked: str) -> list[dict[str, Any]]:
    text = SWEEP.format(asked=asked)
    ask = read_request(text, asked, folder / asked, folder=folder, workers=0)
    run_sweep(ask, lambda *_: None, lambda _finished: None)
    return pq.read_table(folder / asked / "runs.parquet").to_pylist()


@pytest.mark.long
def test_the_twin_changes_nothing_but_the_answer(tmp_path: Path) -> None:
    plain, asked = swept(tmp_path, "false"), swept(tmp_path, "true")
    assert {row["knife_edge"] for row in plain} == {None}
    assert {row["knife_edge"] for row in asked} <= {True, False}
    for name in ("run_id", "trajectory_hash", "label", "oracle_measured"):
        assert [row[name] for row in plain] == [row[name] for row in asked]


def test_a_nudge_is_a_millionth_and_turns_nothing() -> None:
    scene = Scene.open("box_slide")
    runs = [scene.resolve({}, seed, None) for seed in range(8)]
    starts = scene.initial_states(runs)
    moved = scene.nudged_states(starts, runs).qpos - starts.qpos
    assert (np.abs(moved[:, :3]) <= 1e-6 + 1e-16).all()
    assert moved[:, :3].any(axis=1).all()
    assert not moved[:, 3:].any()
    assert (scene.nudged_states(starts, runs).qpos == scene.nudged_states(starts, runs).qpos).all()
