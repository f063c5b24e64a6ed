"""A robot of MuJoCo Menagerie is used as any other model, and its store needs it no more."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

Run = Callable[..., Any]
ROBOT = "menagerie:franka_emika_panda/panda"
# A finger above a block, which its servo holds open at the keyframe.
FINGER = """<mujoco>
  <worldbody>
    <geom name="block" type="box" size=".1 .1 .1"/>
    <body name="finger" pos="0 0 .2">
      <joint name="finger" type="slide" axis="0 0 1" range="-.1 .1" armature=".1" damping="1"/>
      <geom name="tip" type="mesh" mesh="tip"/>
    </body>
  </worldbody>
  <asset><mesh name="tip" file="assets/tip.obj"/></asset>
  <actuator><position name="servo" joint="finger" kp="500" kv="50"/></actuator>
  <keyframe><key name="home" qpos=".05" ctrl=".06"/></keyframe>
</mujoco>
"""
TIP = """v 0 0 0
v .05 0 0
v 0 .05 0
v 0 0 .05
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""
SWEEP = f"""version: 1
scene: {ROBOT}
duration: 0.05
axes: {{timestep: [1.0e-3, 2.0e-3], keyframe: [home, qpos0]}}
"""


@pytest.fixture
def robot(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put a robot of our own where the package looks for the Panda."""
    folder = tmp_path_factory.mktemp("menagerie")
    (folder / "franka_emika_panda/assets").mkdir(parents=True)
    (folder / "franka_emika_panda/panda.xml").write_text(FINGER)
    (folder / "franka_emika_panda/assets/tip.obj").write_text(TIP)
    monkeypatch.setenv("MENAGERIE_ROOT", str(folder))


def use(contactlab: Run, folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[EvidenceRecord]:
    """Use a robot in every way; return the records of a sweep."""
    code, out, err = contactlab("list", "axes", ROBOT)
    assert (code, err) == (0, "")
    assert "home, qpos0" in out
    code, out, _ = contactlab(ROBOT, "--section", "labels", "--workers", "0")
    assert code == 0, out
    assert (folder / "results/examine/panda/run/manifest.json").is_file()
    (folder / "robot.yaml").write_text(SWEEP)
    code, _, err = contactlab("sweep", "robot.yaml", "-o", "store", "--workers", "1")
    assert code == 0, err
    monkeypatch.setenv("MENAGERIE_ROOT", str(folder / "nowhere"))
    store = Store.open(folder / "store")
    records = [store.record(run) for run in store.table["run_id"].to_pylist()]
    assert {each.scene for each in records} == {"franka_emika_panda-panda"}
    assert find_problems(folder / "store") == []
    assert contactlab("show", "store")[0] == 0
    for each in records:
        assert contactlab("show", "store", each.run_id)[0] == 0
        assert contactlab("verify", "store", each.run_id)[0] == 0
    return records


@pytest.mark.night
@pytest.mark.usefixtures("robot")
def test_a_robot_is_used_as_any_model(
    contactlab: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    records = use(contactlab, tmp_path, monkeypatch)
    starts = {each.axes["keyframe"]: each.initial.qpos[0] for each in records}
    assert starts == {"home": pytest.approx(0.05, abs=1e-4), "qpos0": pytest.approx(0, abs=1e-4)}


@pytest.mark.long
@pytest.mark.usefixtures("robot")
def test_a_starter_file_of_a_robot_runs(contactlab: Run) -> None:
    assert contactlab("init", ROBOT)[0] == 0
    short = ("--set", "duration=0.02", "--limit", "3", "--workers", "0")
    assert contactlab("sweep", "sweep.yaml", *short)[0] == 0


def test_a_robot_that_is_not_there_is_a_message(
    contactlab: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    for words in (["list", "axes"], ["examine", "--section", "labels"], ["init"]):
        code, out, err = contactlab(*words, ROBOT)
        assert (code, out) == (2, "")
        assert "cannot get franka_emika_panda" in err
        assert "set MENAGERIE_ROOT" in err


@pytest.mark.night
@pytest.mark.skipif(
    "MENAGERIE_ROOT" not in os.environ,
    reason="MENAGERIE_ROOT names no folder with the robot's meshes",
)
def test_the_real_panda(contactlab: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At "home" its servos hold it still; its reference puts it beyond its limits."""
    for each in use(contactlab, tmp_path, monkeypatch):
        home = each.axes["keyframe"] == "home"
        assert (each.label == "stable") == home
        assert (each.initial.qpos[3] < -0.0698) == home
