"""Hands are found by what actuators move, whatever parts are called and however they are driven."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import pytest
from tests.grip.grippers import claw

from contactlab.errors import SceneError
from contactlab.rendering.text import render_text
from contactlab.scene.model_names import name_by_address
from contactlab.schema.grip import GripReport
from contactlab.studies.grip.fingers import find_hand
from contactlab.studies.grip.grip_document import describe_grip
from contactlab.studies.grip.grip_fixture import add_object, mount_hand
from contactlab.studies.grip.gripped_object import DEFAULT_OBJECT
from contactlab.studies.grip.gripping import GripRequest, judge_grip

ARM = """
<mujoco>
  <worldbody>
    <geom type="plane" size="2 2 .1"/>
    <body name="cup" pos=".5 .5 .1"><freejoint/><geom type="sphere" size=".05"/></body>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" range="-90 90"/>
      <geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass="1"/>
      <body name="fore" pos=".3 0 0">
        <joint name="elbow" axis="0 1 0" range="-120 120"/>
        <geom type="capsule" size=".03" fromto="0 0 0 .25 0 0" mass=".6"/>
        <body name="palm" pos=".28 0 0">
          <geom type="box" size=".01 .06 .02" mass=".2"/>
          {fingers}
        </body>
      </body>
    </body>
  </worldbody>
  {coupling}
  <actuator>
    <position joint="shoulder" kp="100" kv="3" ctrlrange="-1 1"/>
    <position joint="elbow" kp="100" kv="3" ctrlrange="-1 1"/>
    {driven}
  </actuator>
</mujoco>
"""
SLIDES = """
<body name="x" pos=".05 .03 0">
  <joint name="x" type="slide" axis="0 -1 0" range="0 .03" damping="3" armature=".05"/>
  <geom type="box" size=".03 .005 .01" mass=".05"/>
</body>
<body name="y" pos=".05 -.03 0">
  <joint name="y" type="slide" axis="0 1 0" range="0 .03" damping="3" armature=".05"/>
  <geom type="box" size=".03 .005 .01" mass=".05"/>
</body>
"""
JAW = """
<geom name="jaw" type="box" size=".03 .005 .01" pos=".05 -.03 0" mass=".05"/>
<body name="x" pos=".05 .03 0">
  <joint name="x" type="slide" axis="0 -1 0" range="0 .05" damping="3" armature=".05"/>
  <geom type="box" size=".03 .005 .01" mass=".05"/>
</body>
"""
TENDON = """
<tendon><fixed name="t"><joint joint="x" coef=".5"/><joint joint="y" coef=".5"/></fixed></tendon>
"""
# Jaws on parallelograms: a crank that is driven and an idle one carry each, joined by a connect.
SIDE = """
<body name="{x} crank" pos="0 {y} 0">
  <joint name="{x}" axis="0 0 {sign}" range="-40 40" damping=".5" armature=".002"/>
  <geom type="capsule" size=".004" fromto="0 0 0 .05 0 0" mass=".02"/>
  <body name="{x}" pos=".05 0 0">
    <joint axis="0 0 1" damping=".02" armature=".002"/>
    <geom name="{x} pad" type="box" size=".02 .005 .01" pos=".03 0 0" mass=".03"/>
  </body>
</body>
<body name="{x} idle" pos=".02 {y} 0">
  <joint axis="0 0 1" damping=".02" armature=".002"/>
  <geom type="capsule" size=".004" fromto="0 0 0 .05 0 0" mass=".02" contype="0" conaffinity="0"/>
</body>
"""
LINKAGE = SIDE.format(x="x", y=".03", sign="-1") + SIDE.format(x="y", y="-.03", sign="1")
JOINED = """<equality><joint joint1="x" joint2="y"/>
<connect body1="x idle" body2="x" anchor=".05 0 0"/>
<connect body1="y idle" body2="y" anchor=".05 0 0"/></equality>"""
EQUAL = '<equality><joint joint1="x" joint2="y"/></equality>'
HANDS = {
    "each finger": (
        SLIDES,
        "",
        '<motor joint="x" ctrlrange="0 10"/><motor joint="y" ctrlrange="0 10"/>',
    ),
    "a tendon": (SLIDES, TENDON + EQUAL, '<motor tendon="t" ctrlrange="0 20"/>'),
    "an equality": (SLIDES, EQUAL, '<motor joint="x" ctrlrange="0 20"/>'),
    "a servo": (SLIDES, EQUAL, '<position joint="x" kp="800" ctrlrange="-.03 .03"/>'),
    "linkages": (LINKAGE, JOINED, '<motor joint="x" ctrlrange="-.3 .3"/>'),
    "a fixed jaw": (JAW, "", '<motor joint="x" ctrlrange="0 10"/>'),
}


def arm(hand: str) -> str:
    fingers, coupling, driven = HANDS[hand]
    return ARM.format(fingers=fingers, coupling=coupling, driven=driven)


@pytest.mark.parametrize("hand", HANDS)
def test_the_hand_of_an_arm_is_found(hand: str) -> None:
    """Shoulder and elbow move the whole hand; what closes is carried by the palm."""
    model = mujoco.MjModel.from_xml_string(arm(hand))
    found = find_hand(model)
    assert model.body(found.base).name == "palm"
    roots = {model.body(finger[0]).name for finger in found.fingers}
    assert roots <= {"x", "y", "x crank", "y crank"}
    assert len(roots) == len(found.fingers)
    # Those of the arm are none of the hand's.
    assert not {0, 1} & set(found.actuators)


QUICK_HANDS = {"a tendon"}
"""One whose fingers share an actuator."""


@pytest.mark.parametrize(
    "hand",
    [pytest.param(hand, marks=() if hand in QUICK_HANDS else pytest.mark.long) for hand in HANDS],
)
def test_it_grips_by_its_own_actuators(hand: str, tmp_path: Path) -> None:
    """Both sides press alike: nothing else bears their force."""
    (tmp_path / "arm.xml").write_text(arm(hand), encoding="utf-8")
    request = GripRequest(str(tmp_path / "arm.xml"), held_body="box:30x40x20mm,50g", fixes=False)
    report = judge_grip(request)
    forces = [each.force for each in report.fingers if each.force > 0]
    assert len(forces) == 2
    assert forces[0] == pytest.approx(forces[1], rel=1e-3)
    assert {each.name for each in report.controls} <= {"actuator[2]", "actuator[3]"}
    told = " against " if hand == "a fixed jaw" else ", "
    sides = told.join(f"{each.body} {each.force:.3g} N" for each in report.fingers)
    assert sides in " ".join(render_text(describe_grip(report)).split())


def test_what_a_string_drags_is_no_finger() -> None:
    """A ball that hangs from a cup moves with it; neither cup nor floor closes on the other."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <geom type="plane" size="1 1 .1"/>
      <body name="cup" pos="0 0 .5"><joint name="x" type="slide" axis="1 0 0" range="-.3 .3"/>
        <geom size=".05"/><site name="cup"/></body>
      <body name="ball" pos="0 0 .2"><joint type="slide" axis="1 0 0"/>
        <joint type="slide" axis="0 0 1"/><geom size=".02"/><site name="ball"/></body>
    </worldbody>
    <tendon><spatial range="0 .25" limited="true"><site site="cup"/><site site="ball"/></spatial>
    </tendon><actuator><motor joint="x" ctrlrange="-1 1" gear="5"/></actuator></mujoco>""")
    with pytest.raises(SceneError, match="no actuator moves two bodies towards each other"):
        find_hand(model)


def test_a_wrist_that_turns_wholly_and_a_start_beyond_limits_change_nothing(tmp_path: Path) -> None:
    """Both ends of a whole turn are one pose; the base's own joint is held on the mounted hand.

    At qpos0, 0, pads are 50 mm apart and 50 mm beyond the ranges, by which they are never there.
    """
    wrist = '<joint name="wrist" axis="1 0 0" range="-180 180" damping=".1"/>'
    servo = '<position name="wrist" joint="wrist" kp="5" ctrlrange="-3.14159 3.14159"/>'
    text = claw(range="-.03 -.005").replace('quat="1 0 0 0">', f'quat="1 0 0 0">{wrist}')
    text = text.replace("<actuator>", f"<actuator>{servo}").replace(
        'axis="1 0 0" range="-.03 .03"', 'axis="1 0 0" range="-.03 -.005"'
    )
    (tmp_path / "claw.xml").write_text(text, encoding="utf-8")
    report = judge_grip(
        GripRequest(str(tmp_path / "claw.xml"), fixes=False, held_body="box:70x40x40mm")
    )
    assert {each.name for each in report.controls} == {"a", "b"}
    assert [each.force for each in report.fingers] == pytest.approx([20, 20], rel=1e-3)


def test_the_bench_has_the_hand_alone_and_filters_as_the_arm_did() -> None:
    """The arm's joints and the cup are gone; base and first links do not collide with each other.

    Deleted joints leave masses and inertias as they were.
    """
    spec = mujoco.MjSpec.from_string(arm("each finger"))
    for kind in ("geoms", "joints", "actuators", "bodies"):
        for place, element in enumerate(getattr(spec, kind)):
            element.name = element.name or f"{kind}[{place}]"
    model = spec.compile()
    hand = find_hand(model)
    fixture = add_object(mount_hand(spec, model, hand), DEFAULT_OBJECT)
    names = [fixture.model.joint(joint).name for joint in range(fixture.model.njnt)]
    assert names == ["x", "y", "contactlab/object/free"]
    assert fixture.model.nu == 2
    assert fixture.model.nexclude == 2
    assert "cup" not in [fixture.model.body(body).name for body in range(fixture.model.nbody)]
    for name in ("palm", "x", "y"):
        one, other = model.body(name), fixture.model.body(name)
        assert other.mass == pytest.approx(one.mass, rel=1e-12)
        assert other.inertia == pytest.approx(one.inertia, rel=1e-12)


def test_what_looks_at_an_object_that_is_gone_looks_straight_on() -> None:
    """Lights and cameras may aim at a free body, which the mounted hand has not."""
    views = '<light mode="targetbody" target="cup"/><camera mode="targetbody" target="cup"/>'
    spec = mujoco.MjSpec.from_string(
        arm("each finger").replace("<worldbody>", f"<worldbody>{views}")
    )
    name_by_address(spec)
    model = spec.compile()
    fixture = add_object(mount_hand(spec, model, find_hand(model)), DEFAULT_OBJECT)
    assert "cup" not in [fixture.model.body(body).name for body in range(fixture.model.nbody)]
    assert fixture.model.light_targetbodyid.tolist() == [-1]
    assert fixture.model.cam_targetbodyid.tolist() == [-1]


@pytest.mark.parametrize(
    "break_it",
    [
        lambda text: text.replace('ctrlrange="-20 20"', 'gear="0"'),
        lambda text: text.replace(
            'type="slide" axis="-1 0 0"', 'type="slide" axis="0 1 0"'
        ).replace('type="slide" axis="1 0 0"', 'type="slide" axis="0 1 0"'),
    ],
    ids=["actuators without a gear", "fingers that move alike"],
)
def test_what_never_closes_is_refused(break_it: Callable[[str], str], tmp_path: Path) -> None:
    (tmp_path / "claw.xml").write_text(break_it(claw()), encoding="utf-8")
    with pytest.raises(SceneError, match="--keyframe"):
        judge_grip(GripRequest(str(tmp_path / "claw.xml"), fixes=False))


def test_the_usual_object_fits_the_hand(tmp_path: Path) -> None:
    (tmp_path / "claw.xml").write_text(claw(), encoding="utf-8")
    report: GripReport = judge_grip(GripRequest(str(tmp_path / "claw.xml"), fixes=False))
    assert report.object == "a box of 30x40x40 mm and 0.1 kg"
    assert report.opening is not None
    # Two pads 25 mm from the middle, that go 30 mm each.
    assert report.opening == pytest.approx(0.1 + 0.01, abs=0.011)
