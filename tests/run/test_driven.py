"""Runs whose inputs change over time: replayed, checked, resumed and told apart like any other."""

import shutil
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from contactlab import resources
from contactlab.errors import SceneError
from contactlab.run.stored_runs import replay_run
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store

SWEEP = """\
version: 1
scene: {scene}
checks: all
knife_edge: true
axes: {{timestep: [2.0e-3, 4.0e-3], close_time: [0.15, 0.21]}}
"""


def swept(
    folder: Path, name: str, scene: str = "grasp_mug", workers: int = 0
) -> list[dict[str, Any]]:
    text = SWEEP.format(scene=scene)
    ask = read_request(text, name, folder / name, folder=folder, workers=workers)
    run_sweep(ask, lambda *_: None, lambda _finished: None)
    return pq.read_table(folder / name / "runs.parquet").to_pylist()


@pytest.mark.long
def test_a_driven_run_repeats_from_its_store_alone(tmp_path: Path) -> None:
    rows = swept(tmp_path, "store")
    assert [row["label"] for row in rows] == ["stable"] * 4
    assert all(row["repeats"] == 1 for row in rows)
    assert all(row["jacobian_difference"] < 1e-6 for row in rows)
    assert all(row["knife_edge"] is False for row in rows)
    store = Store.open(tmp_path / "store")
    for row in rows:
        again = replay_run(store, row["run_id"])
        assert again.equal
        assert again.step is None


@pytest.mark.long
def test_the_programme_decides_the_run(tmp_path: Path) -> None:
    rows = swept(tmp_path, "store")
    assert len({row["trajectory_hash"] for row in rows}) == 4
    copy = tmp_path / "copy"
    shutil.copytree(resources.MODELS / "grasp_mug", copy)
    text = (copy / "scene.yaml").read_text()
    assert "to: [0, lift]}" in text
    (copy / "scene.yaml").write_text(text.replace("to: [0, lift]}", "to: [0, lift + 0.01]}"))
    changed = swept(tmp_path, "changed", scene="./copy")
    for one, other in zip(rows, changed, strict=True):
        assert one["run_id"] != other["run_id"]
        assert one["trajectory_hash"] != other["trajectory_hash"]


@pytest.mark.long
def test_workers_change_nothing(tmp_path: Path) -> None:
    one, two = (swept(tmp_path, str(workers), workers=workers) for workers in (0, 2))
    assert [row["trajectory_hash"] for row in one] == [row["trajectory_hash"] for row in two]


def test_a_programme_that_goes_back_in_time_is_said_before_anything_runs(tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(resources.MODELS / "grasp_mug", copy)
    text = (copy / "scene.yaml").read_text()
    text = text.replace("at: [0, close_time]", "at: [0.1, close_time]")
    (copy / "scene.yaml").write_text(text)
    sweep = SWEEP.format(scene="./copy").replace("0.15", "0.05")
    ask = read_request(sweep, "store", tmp_path / "store", folder=tmp_path, workers=0)
    with pytest.raises(SceneError, match=r"copy/scene.yaml: control grip.ctrl: times must not"):
        run_sweep(ask, lambda *_: None, lambda _finished: None)
    assert not (tmp_path / "store").exists()
