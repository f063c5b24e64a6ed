"""What is changed is found, one change at a time; what is not changed is not."""

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.rendering.markdown import render_markdown
from contactlab.rendering.text import render_text
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_names import name_by_address
from contactlab.scene.model_writer import write_model
from contactlab.scene.scene import Scene
from contactlab.studies.diff.compare_models import (
    describe_diff,
    diff_models,
    find_differences,
    summarize_changes,
)
from contactlab.studies.diff.matching import match_parts
from contactlab.studies.diff.motion_change import motion_change

ROBOT = """<mujoco model="robot">
  <option timestep="0.002"/>
  <asset><mesh name="wedge" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="base" pos="0 0 1">
      <freejoint name="root"/>
      <inertial pos=".01 .02 .03" mass="2" fullinertia=".02 .03 .04 .001 .002 .003"/>
      <geom name="hull" type="mesh" mesh="wedge"/>
      <body name="leg" pos=".3 0 0" euler="10 20 30">
        <joint name="hip" axis="0 1 0" range="-30 30" damping=".5" armature=".01"/>
        <geom name="leg" type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/>
        <geom type="box" size=".03 .02 .01" pos="0 0 -.3"/>
        <body pos="0 0 -.4">
          <joint axis="0 1 0" stiffness="3" springref="10"/>
          <geom name="foot" size=".04" friction=".8"/>
        </body>
      </body>
      <body name="arm" pos="-.3 0 0">
        <joint name="shoulder" axis="1 0 0" frictionloss=".1"/>
        <geom name="arm" type="cylinder" size=".02 .1"/>
      </body>
    </body>
  </worldbody>
  <contact><exclude body1="leg" body2="arm"/><pair geom1="foot" geom2="arm" condim="4"/></contact>
  <tendon><fixed name="cable" damping="1"><joint joint="hip" coef="1"/></fixed></tendon>
  <equality><joint name="mimic" joint1="hip" joint2="shoulder"/></equality>
  <actuator>
    <position name="hip" joint="hip" kp="20" ctrlrange="-1 1" forcerange="-5 5"/>
    <motor joint="shoulder" gear="3"/>
  </actuator>
  <keyframe><key name="home" qpos="0 0 1 1 0 0 0 .1 0 0" ctrl=".1 0"/></keyframe>
</mujoco>
"""
STONE = """<mujoco><worldbody>
<body name="stone"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
Change = tuple[str, str]
# What is replaced by what, and the kinds and quantities of all that differs then.
CHANGES: Mapping[str, tuple[Change, set[tuple[str, str]]]] = {
    "mass": (('mass="2"', 'mass="2.01"'), {("body", "mass")}),
    "centre of mass": (('pos=".01 .02 .03"', 'pos=".01 .02 .031"'), {("body", "com")}),
    "inertia": (('fullinertia=".02', 'fullinertia=".0202'), {("body", "inertia")}),
    "turned inertia": ((".001 .002 .003", "-.001 .002 .003"), {("body", "inertia")}),
    "place of a body": (('pos="-.3 0 0"', 'pos="-.301 0 0"'), {("body", "pos")}),
    "turn of a body": (('euler="10 20 30"', 'euler="10 20 31"'), {("body", "quat")}),
    "axis": (('name="hip" axis="0 1 0"', 'name="hip" axis="0 1 .01"'), {("joint", "axis")}),
    "anchor": (('name="hip" axis', 'name="hip" pos="0 0 .01" axis'), {("joint", "pos")}),
    "range": (('range="-30 30"', 'range="-30 31"'), {("joint", "range")}),
    "no range": (('range="-30 30"', ""), {("joint", "range")}),
    "damping": (('damping=".5"', 'damping=".51"'), {("joint", "damping")}),
    "armature": (('armature=".01"', 'armature=".02"'), {("joint", "armature")}),
    "frictionloss": (('frictionloss=".1"', ""), {("joint", "frictionloss")}),
    "stiffness": (('stiffness="3"', 'stiffness="4"'), {("joint", "stiffness")}),
    "gain": (('kp="20"', 'kp="21"'), {("actuator", "gainprm"), ("actuator", "biasprm")}),
    "control range": (('ctrlrange="-1 1"', 'ctrlrange="-1 2"'), {("actuator", "ctrlrange")}),
    "force range": (('forcerange="-5 5"', 'forcerange="-5 6"'), {("actuator", "forcerange")}),
    "gear": (('gear="3"', 'gear="-3"'), {("actuator", "gear")}),
    "friction": (('friction=".8"', 'friction=".9"'), {("geom", "friction")}),
    "solref": (('size=".02 .1"', 'size=".02 .1" solref=".01 1"'), {("geom", "solref")}),
    "condim of a pair": (('condim="4"', 'condim="3"'), {("pair", "condim")}),
    "exclude": (
        ('<exclude body1="leg" body2="arm"/>', ""),
        {("exclude", "bodies"), ("filter", "bodies")},
    ),
    "timestep": (('timestep="0.002"', 'timestep="0.001"'), {("option", "timestep")}),
    "cone": (('timestep="0.002"', 'timestep="0.002" cone="elliptic"'), {("option", "cone")}),
    "flag": (
        ("<asset>", '<option><flag eulerdamp="disable"/></option><asset>'),
        {("flag", "eulerdamp")},
    ),
    "tendon": (('damping="1"', 'damping="2"'), {("tendon", "damping")}),
    "equality": (
        ('name="mimic" joint1', 'name="mimic" polycoef="0 2 0 0 0" joint1'),
        {("equality", "data")},
    ),
    "keyframe": (('.1 0 0" ctrl', '.2 0 0" ctrl'), {("key", "qpos")}),
    "mesh": (
        ('0 0 .1"/></asset>', '0 0 .11"/></asset>'),
        {("geom", "size"), ("geom", "volume"), ("geom", "pos"), ("geom", "quat")},
    ),
}


def compiled(text: str) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(text)
    name_by_address(spec)
    return spec.compile()


def found(one: mujoco.MjModel, other: mujoco.MjModel) -> set[tuple[str, str]]:
    return {(each.kind, each.quantity) for each in find_differences(one, other)}


@pytest.mark.parametrize("change", CHANGES)
def test_each_planted_change_is_all_that_is_found(change: str) -> None:
    (old, new), expected = CHANGES[change]
    assert old in ROBOT
    one, other = compiled(ROBOT), compiled(ROBOT.replace(old, new))
    assert found(one, other) == found(other, one) == expected


def test_nothing_differs_between_a_model_and_its_round_trip(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(ROBOT)
    mujoco.mj_saveLastXML(str(tmp_path / "again.xml"), model)
    again = compiled((tmp_path / "again.xml").read_text())
    assert list(find_differences(compiled(ROBOT), again)) == []


@pytest.mark.parametrize("place", range(3))
def test_one_number_of_a_friction_changes_by_its_own_share(place: int) -> None:
    """Sliding and rolling friction have other units; 1e-4 m twice as large is no .01 % of both."""
    ball = (
        '<mujoco><worldbody><body><geom size=".1" friction="{} {} {}"/></body></worldbody></mujoco>'
    )
    friction = [1.0, 5e-3, 1e-4]
    changed = [1.5 * value if index == place else value for index, value in enumerate(friction)]
    (only,) = find_differences(compiled(ball.format(*friction)), compiled(ball.format(*changed)))
    assert only.quantity == "friction"
    assert only.relative_change == pytest.approx(0.5, rel=1e-9)


def test_a_renamed_body_is_the_same_body() -> None:
    one, other = (
        compiled(ROBOT),
        compiled(
            ROBOT.replace('body name="arm"', 'body name="limb"').replace(
                'body2="arm"', 'body2="limb"'
            )
        ),
    )
    names = {(each.kind, each.quantity, each.after) for each in find_differences(one, other)}
    # The exclude is of the names that it lists, and a geom's and a joint's body is named too.
    assert ("body", "name", "limb") in names
    assert not {kind for kind, quantity, _ in names if quantity in ("mass", "pos", "inertia")}


def test_a_new_part_and_one_that_is_gone_are_told() -> None:
    one = compiled(ROBOT)
    other = compiled(
        ROBOT.replace('<motor joint="shoulder" gear="3"/>', "").replace('ctrl=".1 0"', "")
    )
    gone = [each for each in find_differences(one, other) if each.kind == "actuator"]
    assert [(each.name, each.after) for each in gone] == [("actuator[1]", "")]
    new = [each for each in find_differences(other, one) if each.kind == "actuator"]
    assert [(each.name, each.before) for each in new] == [("actuator[1]", "")]


_LINK = """<robot name="r"><link name="base"/><joint name="j" type="revolute">
<parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="9" velocity="9"/></joint><link name="arm"><inertial>
<origin xyz=".1 0 0" rpy="{}"/><mass value="1"/>
<inertia ixx=".01" iyy=".02" izz=".025" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


def test_a_urdf_inertia_whose_frame_is_not_turned_differs_by_the_law_of_rotation() -> None:
    # An importer that leaves out the frame's rpy has the diagonal itself; MuJoCo has R I R'.
    angle = 0.4
    turned, plain = compiled(_LINK.format(f"0 0 {angle}")), compiled(_LINK.format("0 0 0"))
    (only,) = find_differences(turned, plain)
    assert (only.kind, only.name, only.quantity) == ("body", "arm", "inertia")
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    inertia = np.diag([0.01, 0.02, 0.025])
    expected = turn @ inertia @ turn.T
    share = np.linalg.norm(expected - inertia) / np.linalg.norm(inertia)
    assert only.relative_change == pytest.approx(share, rel=1e-6)


# _LINK with rpy "0.3 0.4 0.5", as MuJoCo 3.12.0 loads and saves it: the frame's turn is lost.
_SAVED_BY_3_12 = """<mujoco model="r">
  <compiler angle="radian"/>
  <worldbody>
    <body name="arm">
      <inertial pos="0.1 0 0" quat="0 0.707107 0 0.707107" mass="1" diaginertia="0.025 0.02 0.01"/>
      <joint name="j" range="-1 1" actuatorfrcrange="-9 9" axis="0 1 0"/>
    </body>
  </worldbody>
</mujoco>"""


def test_an_older_release_that_lost_a_turned_inertia_is_told() -> None:
    (only,) = find_differences(compiled(_LINK.format("0.3 0.4 0.5")), compiled(_SAVED_BY_3_12))
    assert (only.kind, only.name, only.quantity) == ("body", "arm", "inertia")
    lost = [float(number) for number in only.after.split()]
    assert lost == pytest.approx(np.diag([0.01, 0.02, 0.025]).ravel(), abs=1e-9)


@pytest.mark.parametrize(
    ("edits", "expected"),
    [
        (ModelEdits({"timestep": 0.001}), {("option", "timestep")}),
        (
            ModelEdits({"cone": "elliptic", "impratio": 10.0}),
            {("option", "cone"), ("option", "impratio")},
        ),
        (ModelEdits({"warmstart": False}), {("flag", "warmstart")}),
        (ModelEdits(excluded=(("base", "arm"),)), {("exclude", "bodies")}),
        (
            ModelEdits(masked=("leg",)),
            {("geom", "contype"), ("geom", "conaffinity")},
        ),
        (ModelEdits({"dof_damping[hip]": 1.0}), {("joint", "damping")}),
        (ModelEdits({"geom_friction[foot]": (1.0, 0.1, 0.1)}), {("geom", "friction")}),
    ],
)
def test_a_model_that_is_written_differs_in_what_was_asked_for_alone(
    edits: ModelEdits, expected: set[tuple[str, str]], tmp_path: Path
) -> None:
    # All that writes a model, examine, tune and effects, does it by write_model.
    (tmp_path / "robot.xml").write_text(ROBOT)
    scene = Scene.open(str(tmp_path / "robot.xml"))
    written = write_model(scene, edits, tmp_path / "out")
    again = Scene.open(str(written.path))
    assert found(scene.base({}).model, again.base({}).model) == expected


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    path = tmp_path_factory.mktemp("motion") / "robot.xml"
    path.write_text(ROBOT)
    return Scene.open(str(path)).with_drive("auto", path.parent).with_effects("all")


def test_a_model_moves_as_itself_to_the_last_bit(scene: Scene) -> None:
    model = scene.base({}).model
    change, _ = motion_change(scene, model, model, match_parts(model, model))
    assert change is not None
    assert change.error == 0


@pytest.mark.parametrize("step", [0.015, 0.012, 0.05, 0.0007])
def test_what_falls_falls_alike_at_any_step(scene: Scene, step: float) -> None:
    """Its velocity is straight in time, so that a step of any length leaves rounding alone."""
    path = scene.source.path.parent / "stone.xml"
    path.write_text(STONE)
    fall = Scene.open(str(path)).with_drive("none", path.parent).with_effects("all")
    coarse = STONE.replace("<worldbody>", f'<option timestep="{step}"/><worldbody>')
    models = [compiled(each) for each in (STONE, coarse)]
    change, _ = motion_change(fall, models[0], models[1], match_parts(*models))
    assert change is not None
    assert change.error < 1e-8


def test_half_the_gravity_is_half_the_force_that_acts_on_what_falls(scene: Scene) -> None:
    # In free flight, velocities part by (g - g/2) T in windows whose path is g T, to which comes a
    # tenth of g T that counts as real: 1/2 / 1.1. The wedge falls from rest, without contacts.
    light = STONE.replace("<worldbody>", '<option gravity="0 0 -4.905"/><worldbody>')
    models = [compiled(each) for each in (STONE, light)]
    path = scene.source.path.parent / "stone.xml"
    path.write_text(STONE)
    fall = Scene.open(str(path)).with_drive("none", path.parent).with_effects("all")
    change, _ = motion_change(fall, models[0], models[1], match_parts(*models))
    assert change is not None
    # The slack of one step of 2 ms both ways forgives 1 / 20 of a window of 40 ms.
    assert change.error == pytest.approx(0.5 / 1.1, rel=0.06)
    assert change.body == "stone"


def test_the_motion_is_the_last_line_of_words_and_markdown(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(ROBOT)
    (tmp_path / "b.xml").write_text(ROBOT.replace('mass="2"', 'mass="4"'))
    report = diff_models(str(tmp_path / "a.xml"), str(tmp_path / "b.xml"))
    document = describe_diff(report)
    for text in (render_text(document, 1000), render_markdown(document)):
        lines = [line for line in text.splitlines() if line]
        assert "motion: the second model needs a residual force" in lines[-1]
    assert report.motion is not None
    assert report.motion.error > 0


def test_a_summary_joins_changes_by_one_factor_and_names_new_sensors(tmp_path: Path) -> None:
    """Every mass grows by 1 %, two sensors are new, and one friction is another."""
    text = """<mujoco><worldbody>{}</worldbody><sensor>{}</sensor></mujoco>"""
    bodies = "".join(
        f'<body name="b{mass}"><freejoint/><geom size=".1" mass="{{}}" friction="{{}}"/></body>'
        for mass in (1, 2, 3)
    )
    sensors = '<framepos name="p" objtype="body" objname="b1"/><clock name="t"/>'
    for name, factor, friction, added in (("one", 1, 1, ""), ("other", 1.01, 0.5, sensors)):
        values = (1 * factor, 1, 2 * factor, friction, 3 * factor, 1)
        (tmp_path / f"{name}.xml").write_text(text.format(bodies.format(*values), added))
    halved, unchanged = (
        "1 0.005 0.0001 -> 0.5 0.005 0.0001 (50 %)",
        "1, as before, by the other geom",
    )
    said, quantities = summarize_changes(*(str(tmp_path / f"{n}.xml") for n in ("one", "other")))
    assert said == [
        "3 bodies: mass x1.01",
        "3 bodies: inertia x1.01",
        f"geom 'geom[1]': friction {halved}; sliding friction in contact: {unchanged}",
        "2 sensors are new: p, t",
    ]
    assert quantities == {"mass", "inertia", "friction", "type"}


@pytest.mark.parametrize(
    ("floor", "foot", "said"),
    [
        # The larger friction of two geoms acts, or that of the higher priority.
        ('friction="1"', 'friction="1.03"', ": 1 -> 1.03"),
        ('friction="2"', 'friction="1.03"', ": 2, as before, by the other geom"),
        ('friction="2" priority="1"', 'friction="1.03"', ": 2, as before, by the other geom"),
        ('friction="2" priority="-1"', 'friction="1.03"', None),
        ('friction=".5"', 'friction="1.03"', None),
    ],
)
def test_a_change_of_friction_is_that_of_contacts(
    tmp_path: Path, floor: str, foot: str, said: str | None
) -> None:
    text = (
        '<mujoco><worldbody><geom type="plane" size="1 1 .1" {}/>'
        '<body><freejoint/><geom name="foot" size=".1" {}/></body></worldbody></mujoco>'
    )
    for name, own in (("one", 'friction=".8"'), ("other", foot)):
        (tmp_path / f"{name}.xml").write_text(text.format(floor, own))
    (sentence,), _ = summarize_changes(*(str(tmp_path / f"{n}.xml") for n in ("one", "other")))
    of_geom, _, in_contact = sentence.partition("; sliding friction in contact")
    assert of_geom.endswith("0.8 0.005 0.0001 -> 1.03 0.005 0.0001 (29 %)")
    assert in_contact == (said or "")


def test_the_order_of_unnamed_geoms_changes_nothing() -> None:
    """A geom for looks and one for contacts of equal shape, and another pair, in any order."""
    geoms = [
        f'<geom size=".1" pos="{place} 0 0" contype="{bit}" conaffinity="{bit}"/>'
        for place in (0, 1)
        for bit in (0, 1)
    ]
    one, other = (
        mujoco.MjModel.from_xml_string(
            f"<mujoco><worldbody><body><freejoint/>{''.join(listed)}</body></worldbody></mujoco>"
        )
        for listed in (geoms, geoms[::-1])
    )
    assert not [*find_differences(one, other)]
