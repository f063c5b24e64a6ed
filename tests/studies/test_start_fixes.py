"""Pairs that a model presses into each other: which may be excluded, and which never are."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.budget_reasons import budget_reason

from contactlab.budget import Verdict
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import write_model
from contactlab.studies.examine.start_fixes import moved_starts, separate_links
from contactlab.tasks.task_motions import task_motions

# The base's ball of 60 mm is in the upper arm, which a joint holds there, and 50 mm in the floor,
# which is no link. A box lies 20 mm in the forearm: it is no link either.
ARM = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 .1" pos="0 0 -.05"/>
  <geom name="base" size=".06" pos="0 0 .05"/>
  <body name="upper" pos="0 0 .1"><joint name="shoulder" axis="0 1 0" damping="1"/>
    <geom type="capsule" size=".04" fromto="0 0 0 .3 0 0"/>
    <body name="fore" pos=".4 0 0"><joint name="elbow" axis="0 1 0" damping="1"/>
      <geom type="capsule" size=".03" fromto="0 0 0 .2 0 0"/></body></body>
  <body name="box" pos=".5 0 .05"><freejoint/><geom type="box" size=".04 .04 .04"/></body>
  </worldbody>
  <actuator><position name="knee" joint="elbow" kp="10" kv="1"/>
    <velocity name="brake" joint="shoulder" kv="2"/></actuator></mujoco>
"""


def scene_of(text: str, folder: Path):  # noqa: ANN201 - a scene
    path = folder / "arm.xml"
    path.write_text(text)
    return SceneLoader(Path()).open(str(path)).with_effects("all")


def verdict_of(place: str) -> Verdict:
    return Verdict("inaccurate", 0.1, (budget_reason("inaccurate", "", "run", 1, "", place),))


def excluded(text: str, folder: Path, place: str) -> list[tuple[str, str]]:
    scene = scene_of(text, folder)
    motions = task_motions(scene, {}, scene.task({}, 0.01))
    return [
        pair
        for candidate in separate_links(scene, {}, motions, verdict_of(place))
        for pair in candidate.edits.excluded
    ]


def test_links_that_a_joint_holds_in_each_other_are_excluded(tmp_path: Path) -> None:
    assert excluded(ARM, tmp_path, "joint elbow") == [("world", "upper")]


@pytest.mark.parametrize("place", ["contact fore - box", "contact world - box"])
def test_what_holds_or_carries_a_body_is_not(tmp_path: Path, place: str) -> None:
    """The box is in the floor and in the forearm, which carries it by no joint."""
    assert excluded(ARM, tmp_path, place) == [("world", "upper")]
    free = ARM.replace('<geom name="base" size=".06" pos="0 0 .05"/>', "")
    assert excluded(free, tmp_path, place) == []


def test_fingers_that_close_on_each_other_may_touch(tmp_path: Path) -> None:
    fingers = "".join(
        f"""<body name="{name}" pos=".3 {y} 0"><joint type="slide" axis="0 1 0"/>
        <geom type="box" size=".03 .01 .03"/></body>"""
        for name, y in (("left", 0.009), ("right", -0.009))
    )
    gripper = ARM.replace('<body name="fore"', f'{fingers}<body name="fore"')
    assert excluded(gripper, tmp_path, "contact left - right") == [("world", "upper")]


# Balls of 400 mm on anchors 200 mm apart, each of which it turns about by 100 mm.
HELD = """<mujoco><worldbody>
  <body name="left" pos=".1 0 1"><joint type="ball" pos=".1 0 0"/><geom size=".4"/></body>
  <body name="right" pos="-.1 0 1"><joint axis="0 1 0" pos="-.1 0 0"/><geom size=".4"/></body>
  {more}</worldbody></mujoco>"""


def test_what_joints_hold_in_each_other_is_excluded_and_what_floats_is_not(tmp_path: Path) -> None:
    """No start parts the two; a third that floats is flung, and may begin elsewhere."""
    assert excluded(HELD.format(more=""), tmp_path, "") == [("left", "right")]
    floats = '<body name="third" pos="0 0 1.1"><freejoint/><geom size=".1"/></body>'
    assert excluded(HELD.format(more=floats), tmp_path, "") == [("left", "right")]
    apart = HELD.format(more="").replace('pos="-.1 0 1"', 'pos="-.8 0 1"')
    assert excluded(apart, tmp_path, "") == []


LEGGED = """<robot name="legged">
  <link name="base"><inertial><mass value="2"/>
    <inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size=".2 .2 .1"/></geometry></collision></link>
  <link name="plate"><inertial><mass value="0.5"/>
    <inertia ixx=".001" iyy=".001" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size=".02 .02 .02"/></geometry></collision></link>
  <joint name="glue" type="fixed"><parent link="base"/><child link="plate"/>
    <origin xyz="0 0 .06"/></joint>
  {legs}
</robot>
"""
LEG = """<link name="leg{number}"><inertial><origin xyz="0 0 -.1"/><mass value=".5"/>
    <inertia ixx=".001" iyy=".001" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 -.1"/><geometry><box size=".05 .05 .24"/></geometry></collision>
  </link>
  <joint name="hip{number}" type="revolute"><parent link="base"/><child link="leg{number}"/>
    <origin xyz="{x} {y} -.05"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="10" velocity="5"/></joint>"""
CORNERS = ((0.08, 0.08), (0.08, -0.08), (-0.08, 0.08), (-0.08, -0.08))


def save_legged(folder: Path, count: int) -> Path:
    """Save a plate on legs at its first corners."""
    legs = [LEG.format(number=number, x=x, y=y) for number, (x, y) in enumerate(CORNERS[:count], 1)]
    path = folder / "legged.urdf"
    path.write_text(LEGGED.format(legs="".join(legs)))
    return path


def test_the_root_of_a_urdf_gets_a_free_joint(tmp_path: Path) -> None:
    """Its mass moves then, and nothing touches: base and leg are parent and child."""
    path = save_legged(tmp_path, 4)
    scene = SceneLoader(Path()).open(str(path)).with_effects("all")
    motions = task_motions(scene, {}, scene.task({}, 0.01))
    exclude, free = separate_links(scene, {}, motions, verdict_of("joint hip1"))
    assert (exclude.apply, free.apply) == ("exclude", "freejoint")
    assert (exclude.same_states, free.same_states) == (True, False)
    assert free.edits.freed == ("base",)

    made = write_model(scene, free.edits, tmp_path / "new")
    model = mujoco.MjModel.from_xml_path(str(made.path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert (model.nv, data.ncon) == (10, 0)
    assert model.body_subtreemass[model.body("base").id] == pytest.approx(4.5, rel=1e-12)
    # The centre of mass is where the welded model has it: nothing but the joint is new.
    welded = mujoco.MjModel.from_xml_path(str(path))
    still = mujoco.MjData(welded)
    mujoco.mj_forward(welded, still)
    leg = [each.body("leg1").xipos for each in (data, still)]
    np.testing.assert_allclose(leg[0], leg[1], atol=1e-12)


def test_the_root_of_a_urdf_that_stands_on_no_limbs_stays_fixed(tmp_path: Path) -> None:
    """One leaf that turns in its frame is a door as well as a leg."""
    scene = SceneLoader(Path()).open(str(save_legged(tmp_path, 1))).with_effects("all")
    motions = task_motions(scene, {}, scene.task({}, 0.01))
    words = [each.apply for each in separate_links(scene, {}, motions, verdict_of("joint hip1"))]
    assert words == ["exclude"]


def test_a_base_that_mjcf_welds_is_meant(tmp_path: Path) -> None:
    scene = scene_of(ARM, tmp_path)
    motions = task_motions(scene, {}, scene.task({}, 0.01))
    words = [each.apply for each in separate_links(scene, {}, motions, verdict_of("joint elbow"))]
    assert words == ["exclude"]


def test_the_changed_model_is_the_one_that_is_written(tmp_path: Path) -> None:
    scene = scene_of(ARM, tmp_path)
    motions = task_motions(scene, {}, scene.task({}, 0.01))
    (candidate,) = separate_links(scene, {}, motions, verdict_of("joint elbow"))
    made = write_model(scene, candidate.edits, tmp_path / "new")
    assert made.lines == ('arm.xml:11: <contact><exclude body1="world" body2="upper"/></contact>',)
    assert candidate.compiled is not None
    assert candidate.compiled.nexclude == 1
    assert candidate.compiled.body_mass.tolist() == motions[0].model.body_mass.tolist()


def test_bodies_without_a_name_are_named_where_they_are_excluded(tmp_path: Path) -> None:
    """Plain MuJoCo finds them by it."""
    scene = scene_of(HELD.format(more="").replace(' name="right"', ""), tmp_path)
    edits = ModelEdits(excluded=(("left", "body[2]"),))
    made = mujoco.MjModel.from_xml_path(str(write_model(scene, edits, tmp_path / "apart").path))
    assert (made.nexclude, made.body(2).name) == (1, "body[2]")


def test_gains_are_written_as_their_actuator_has_them(tmp_path: Path) -> None:
    """A position servo has kp and kv, a velocity servo kv: gainprm and biasprm follow from them."""
    settings = {
        "actuator_gainprm[knee,0]": 5.0,
        "actuator_biasprm[knee,1]": -5.0,
        "actuator_biasprm[knee,2]": -0.5,
        "actuator_gainprm[brake,0]": 1.0,
        "actuator_biasprm[brake,2]": -1.0,
    }
    made = write_model(scene_of(ARM, tmp_path), ModelEdits(settings), tmp_path / "new")
    assert made.lines == (
        'arm.xml:10: <position name="knee" joint="elbow" kp="5" kv="0.5"/>',
        'arm.xml:11: <velocity name="brake" joint="shoulder" kv="1"/>',
    )


def test_armature_is_written_with_what_follows_from_it(tmp_path: Path) -> None:
    """The mean inertia is that of the written model: no bit differs, or it would be refused."""
    edits = ModelEdits({"dof_armature[elbow]": 0.25})
    made = write_model(scene_of(ARM, tmp_path), edits, tmp_path / "new")
    assert made.lines == (
        'arm.xml:6: <joint name="elbow" axis="0 1 0" damping="1" armature="0.25"/>',
    )


CART = """<mujoco><worldbody><body name="cart"><joint type="slide" axis="1 0 0"/><geom size=".1"/>
  <site name="eye" pos=".2 0 0"/></body><site name="pin" pos=".7 0 0"/></worldbody>
  <equality><connect site1="eye" site2="pin"/></equality>{}</mujoco>"""


@pytest.mark.parametrize("keyframes", ["", '<keyframe><key qvel="1"/></keyframe>'])
def test_a_run_may_begin_where_its_equality_holds(tmp_path: Path, keyframes: str) -> None:
    """The keyframe that it starts from is written, or one is added; its speeds stay."""
    scene = scene_of(CART.format(keyframes), tmp_path)
    motions = task_motions(scene, {}, scene.task({}, 0.01))
    (start,) = moved_starts(scene, {}, motions[0])
    assert start.apply == "start"
    made = write_model(scene, start.edits, tmp_path / "new")
    model = mujoco.MjModel.from_xml_path(str(made.path))
    assert model.nkey == 1
    assert model.key_qpos[0] == pytest.approx([0.5], abs=1e-5)
    assert model.key_qvel[0] == [bool(keyframes)]
