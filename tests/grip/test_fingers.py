"""Hands are found by what actuators move, whatever parts are called and however they are driven."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import pytest
from tests.grip.grippers import claw

from contactlab.errors import SceneError
from contactlab.schema.grip import GripReport
from contactlab.studies.grip.bench import cut_free, with_object
from contactlab.studies.grip.fingers import find_hand
from contactlab.studies.grip.gripped_object import USUAL
from contactlab.studies.grip.gripping import GripRequest, run

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
    <position joint="shoulder" kp="100" kv="10" ctrlrange="-1 1"/>
    <position joint="elbow" kp="100" kv="10" ctrlrange="-1 1"/>
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
    assert {model.body(finger[0]).name for finger in found.fingers} <= {"x", "y"}
    # Those of the arm are none of the hand's.
    assert not {0, 1} & set(found.actuators)


@pytest.mark.parametrize("hand", HANDS)
def test_it_grips_by_its_own_actuators(hand: str, tmp_path: Path) -> None:
    """Both sides press alike: nothing else bears their force."""
    (tmp_path / "arm.xml").write_text(arm(hand), encoding="utf-8")
    request = GripRequest(str(tmp_path / "arm.xml"), held="box:30x40x20mm,50g", remedies=False)
    report = run(request)
    forces = [each.force for each in report.fingers if each.force > 0]
    assert len(forces) == 2
    assert forces[0] == pytest.approx(forces[1], rel=1e-3)
    assert {each.name for each in report.controls} <= {"actuator[2]", "actuator[3]"}


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
    rig = with_object(cut_free(spec, model, hand), USUAL)
    names = [rig.model.joint(joint).name for joint in range(rig.model.njnt)]
    assert names == ["x", "y", "contactlab/object/free"]
    assert rig.model.nu == 2
    assert rig.model.nexclude == 2
    assert "cup" not in [rig.model.body(body).name for body in range(rig.model.nbody)]
    for name in ("palm", "x", "y"):
        one, other = model.body(name), rig.model.body(name)
        assert other.mass == pytest.approx(one.mass, rel=1e-12)
        assert other.inertia == pytest.approx(one.inertia, rel=1e-12)


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
        run(GripRequest(str(tmp_path / "claw.xml"), remedies=False))


def test_the_usual_object_fits_the_hand(tmp_path: Path) -> None:
    (tmp_path / "claw.xml").write_text(claw(), encoding="utf-8")
    report: GripReport = run(GripRequest(str(tmp_path / "claw.xml"), remedies=False))
    assert report.held == "a box of 30x40x40 mm and 0.1 kg"
    assert report.opening is not None
    # Two pads 25 mm from the middle, that go 30 mm each.
    assert report.opening == pytest.approx(0.1 + 0.01, abs=0.011)
