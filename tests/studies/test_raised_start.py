"""A robot that begins in the floor is raised by its own overlap, and by nothing else."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.studies.test_start_fixes import scene_of

import contactlab
from contactlab.budget.motion import INTEGRATION
from contactlab.scene.closed_start import OPEN_TOLERANCE
from contactlab.scene.model_writer import write_model
from contactlab.scene.raised_start import deepest_overlap, raised_start
from contactlab.studies.examine.start_fixes import moved_starts
from contactlab.tasks.task_motions import task_motions

# A trunk on two legs of 300 mm, whose feet reach 320 mm below it, and a ball that floats nearby.
LEGGED = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="2 2 .1"/>{more}
  <body name="trunk" pos="0 0 {height}">{root}<geom type="box" size=".2 .1 .05"/>
    <body pos=".15 0 0"><joint name="fore" axis="0 1 0"/>
      <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3"/></body>
    <body pos="-.15 0 0"><joint name="hind" axis="0 1 0"/>
      <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3"/></body></body>
  <body name="ball" pos="1 0 .5"><freejoint/><geom size=".1"/></body>
  </worldbody>{key}</mujoco>"""
REACH = 0.32
ROOTS = {
    "free": "<freejoint/>",
    "slide": '<joint type="slide" axis="0 0 1"/>',
    "downward slide": '<joint type="slide" axis="0 0 -1"/>',
}


def start_of(model: mujoco.MjModel) -> np.ndarray:
    data = mujoco.MjData(model)
    start = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, data, start, INTEGRATION)
    return start


def placed(model: mujoco.MjModel, positions: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = positions
    mujoco.mj_forward(model, data)
    return data


def compiled(root: str = "free", **keys: Any) -> mujoco.MjModel:
    values = {"more": "", "key": "", "height": 0.25, **keys}
    return mujoco.MjModel.from_xml_string(LEGGED.format(root=ROOTS[root], **values))


@pytest.mark.parametrize("root", ROOTS)
@given(depth=st.floats(0.02, 1.5))
def test_a_root_rises_by_its_overlap_and_nothing_else_moves(root: str, depth: float) -> None:
    """The height is rounded up to five digits: by less than a unit of the fifth."""
    model = compiled(root, height=REACH - depth)
    raised = raised_start(model, start_of(model), INTEGRATION)
    assert raised is not None
    data = placed(model, raised)
    assert deepest_overlap(data) < 1e-9
    assert data.body("trunk").xpos[2] == pytest.approx(REACH, abs=1e-4)
    joint = int(model.body("trunk").jntadr[0])
    moved = np.flatnonzero(raised != model.qpos0)
    assert moved.tolist() == [model.jnt_qposadr[joint] + (2 if root == "free" else 0)]


def test_the_world_may_be_turned() -> None:
    """Gravity along -x and a wall below: the root rises along x."""
    turned = compiled(
        more='<geom type="plane" size="2 2 .1" pos="-.1 0 .5" zaxis="1 0 0"/>', height=0.6
    )
    turned.opt.gravity[:] = (-9.81, 0, 0)
    raised = raised_start(turned, start_of(turned), INTEGRATION)
    assert raised is not None
    assert placed(turned, raised).body("trunk").xpos[0] == pytest.approx(0.1, abs=1e-4)


@pytest.mark.parametrize(
    "keys",
    [
        {"height": REACH},
        {"height": REACH - OPEN_TOLERANCE / 10},
        {"more": '<geom type="box" size="1 1 .1" pos="0 0 .37"/>'},
        {"more": '<geom type="plane" size="1 1 .1" pos=".1 0 0" zaxis="1 0 0"/>', "height": 1},
    ],
    ids=["on the floor", "barely in it", "below a ceiling", "in a wall"],
)
def test_what_is_not_too_low_is_not_raised(keys: dict[str, Any]) -> None:
    model = compiled(**keys)
    assert raised_start(model, start_of(model), INTEGRATION) is None


def test_a_fixed_robot_is_not_raised() -> None:
    model = compiled("free", height=0.25)
    text = LEGGED.format(more="", key="", height=0.25, root="")
    fixed = mujoco.MjModel.from_xml_string(text)
    assert raised_start(model, start_of(model), INTEGRATION) is not None
    assert raised_start(fixed, start_of(fixed), INTEGRATION) is None


def test_the_raised_start_is_the_only_line_that_is_written(tmp_path: Path) -> None:
    key = '<keyframe><key name="home" qpos="0 0 0.25 1 0 0 0 0 0 1 0 0.5 1 0 0 0"/></keyframe>'
    text = LEGGED.format(more="", key=key, height=0.4, root=ROOTS["free"])
    scene = scene_of(text, tmp_path)
    motions = task_motions(scene, {}, scene.task({}, 0.01))
    (start,) = moved_starts(scene, {}, motions[0])
    assert start.apply == "raise"
    assert start.sentence == "its start overlaps by 70 mm at contact world - body[2]"
    assert start.name == "a start raised out of an overlap of 70 mm"
    (line,) = write_model(scene, start.edits, tmp_path / "new").lines
    assert line.endswith('<key name="home" qpos="0 0 0.32 1 0 0 0 0 0 1 0 0.5 1 0 0 0"/>')


@pytest.mark.parametrize("root", ROOTS)
def test_a_start_without_a_keyframe_is_written_as_the_place_of_a_body(
    root: str, tmp_path: Path
) -> None:
    scene = scene_of(LEGGED.format(more="", key="", height=0.25, root=ROOTS[root]), tmp_path)
    motions = task_motions(scene, {}, scene.task({}, 0.01))
    (start,) = moved_starts(scene, {}, motions[0])
    written = write_model(scene, start.edits, tmp_path / "new")
    (line,) = written.lines
    assert line.endswith('<body name="trunk" pos="0 0 0.32">')
    assert mujoco.MjModel.from_xml_path(str(written.path)).nkey == 0


def test_a_body_whose_place_an_anchor_is_read_from_gets_a_keyframe(tmp_path: Path) -> None:
    """MuJoCo reads the anchor of a weld from the reference pose, and another pose moves it."""
    weld = '<equality><weld body1="ball" body2="trunk"/></equality>'
    text = LEGGED.format(more="", key=weld, height=0.25, root=ROOTS["free"])
    scene = scene_of(text, tmp_path)
    motions = task_motions(scene, {}, scene.task({}, 0.01))
    for start in moved_starts(scene, {}, motions[0]):
        (line,) = write_model(scene, start.edits, tmp_path / start.apply).lines
        assert "<keyframe>" in line


SUNK = """<mujoco><worldbody><geom name="floor" type="plane" size="2 2 .1"/>
  <body name="box" pos="0 0 {height}"><freejoint/>
    <geom type="box" size=".1 .1 .05" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.long
def test_a_sunk_box_is_told_of_its_start_and_the_written_model_is_ok(tmp_path: Path) -> None:
    path, new = tmp_path / "box.xml", tmp_path / "new/box.xml"
    path.write_text(SUNK.format(height=0.02))
    report = contactlab.examine(path, output=tmp_path / "box.json", write=new, apply=["raise"])
    headline = "fails: its start overlaps by 30 mm at contact world - box"
    (cause,) = report.causes
    assert (cause.stage, cause.verdict) == ("start", "ok")
    assert cause.remainder in report.fix
    assert not report.why  # the headline and the fix say all of it
    assert (report.headline, report.fixes[0].apply) == (headline, "raise")
    assert report.fixes[0].verification is not None
    assert report.fixes[0].verification.passed
    assert contactlab.examine(new, section=["checks"], output=tmp_path / "new.json").verdict == "ok"


DOUBLED = """<mujoco><worldbody><geom name="floor" type="plane" size="2 2 .1"/>
  <body name="box" pos="0 0 .05"><freejoint/>
    <geom name="seen" type="box" size=".1 .1 .05" mass="0"/>
    <geom name="solid" type="box" size=".1 .1 .05" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.long
def test_the_rest_is_judged_with_the_file_and_the_start_repaired(tmp_path: Path) -> None:
    """A sunk box that collides twice: each repair is listed, and what is left is the headline."""
    path = tmp_path / "box.xml"
    path.write_text(DOUBLED.replace('pos="0 0 .05"', 'pos="0 0 .02"'))
    report = contactlab.examine(path, output=tmp_path / "box.json")
    assert report.verdict == "fails"
    assert report.headline.startswith("fails: geoms seen and solid are equal")
    assert [cause.stage for cause in report.causes] == ["file", "start"]
    assert [cause.verdict for cause in report.causes] == ["fails", "ok"]
    assert [fix.apply for fix in report.fixes] == ["single", "raise"]
    assert report.fixes[1].masked_geoms == ("solid",)
    assert report.fixes[1].moved_bodies == (("box", (0.0, 0.0, 0.05)),)
