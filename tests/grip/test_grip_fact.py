"""The grip that an examination tells: of what a keyframe holds, or a hand that an arm carries."""

from pathlib import Path

import mujoco
import pytest
from tests.grip.grippers import TENDON_JAWS, claw, claw_with_bar
from tests.grip.test_fingers import arm

from contactlab.schema.examination import Fact
from contactlab.schema.task import QPOS0
from contactlab.studies.grip.grip_fact import describe_grip, find_grip
from contactlab.studies.grip.grip_fixes import Grip
from contactlab.studies.grip.gripping import GripRequest, judge_grip

DOG = """<mujoco><worldbody><body name="trunk" pos="0 0 .4"><freejoint/>
  <geom type="box" size=".2 .1 .05" mass="5"/>
  <body name="left" pos="0 .1 0"><joint name="left" axis="1 0 0" range="-60 60"/>
    <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3" mass="1"/></body>
  <body name="right" pos="0 -.1 0"><joint name="right" axis="1 0 0" range="-60 60"/>
    <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3" mass="1"/></body>
  </body></worldbody>
  <actuator><motor joint="left" ctrlrange="-5 5"/><motor joint="right" ctrlrange="-5 5"/></actuator>
</mujoco>"""


def saved(folder: Path, text: str) -> tuple[str, mujoco.MjModel]:
    path = folder / "robot.xml"
    path.write_text(text, encoding="utf-8")
    return str(path), mujoco.MjModel.from_xml_path(str(path))


def describe_fact(reference: str, model: mujoco.MjModel, start: str) -> Fact:
    grip = find_grip(reference, model, start)
    assert grip is not None
    return describe_grip(grip)


def test_a_start_that_holds_an_object_is_judged_as_it_is(tmp_path: Path) -> None:
    """The number is that of `contactlab grip --keyframe`; no change is run for it."""
    reference, model = saved(tmp_path, claw_with_bar(8, 0.1))
    fact = describe_fact(reference, model, "held")
    speeds = judge_grip(GripRequest(reference, keyframe="held", fixes=False)).drifts
    assert fact.value == pytest.approx(max(drift.speed or 0 for drift in speeds), rel=1e-9)
    assert fact.sentence.startswith("keyframe held (claw) creeps: body bar moves at")


def test_the_hand_of_an_arm_is_judged(tmp_path: Path) -> None:
    reference, model = saved(tmp_path, arm("each finger"))
    fact = describe_fact(reference, model, QPOS0)
    assert fact.place == "palm"
    assert fact.unit == "m/s"


@pytest.mark.parametrize(("start", "bodies"), [("held", {"bar"}), (QPOS0, {"contactlab/object"})])
def test_a_film_is_of_the_reported_grip(tmp_path: Path, start: str, bodies: set[str]) -> None:
    """Of the bar in its keyframe; without one, of the usual object on a mounted hand."""
    filmed = list[Grip]()
    assert find_grip(*saved(tmp_path, claw_with_bar(8, 0.1)), start, filmed.append) is not None
    assert {grip.fixture.model.body(grip.fixture.body).name for grip in filmed} == bodies


def test_no_grip_is_filmed_without_a_hand(tmp_path: Path) -> None:
    cup = '<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
    filmed = list[Grip]()
    assert find_grip(*saved(tmp_path, cup), QPOS0, filmed.append) is None
    assert not filmed


@pytest.mark.parametrize("dog", [DOG, DOG.replace("<freejoint/>", "")])
def test_legs_are_no_hand(dog: str, tmp_path: Path) -> None:
    assert find_grip(*saved(tmp_path, dog), QPOS0) is None


def test_a_hand_that_stands_alone_is_judged(tmp_path: Path) -> None:
    fact = describe_fact(*saved(tmp_path, claw()), QPOS0)
    assert fact.sentence.startswith("its hand (claw) creeps")


@pytest.mark.parametrize("kind", TENDON_JAWS)
def test_jaws_that_one_tendon_closes_are_a_hand(kind: str, tmp_path: Path) -> None:
    fact = describe_fact(*saved(tmp_path, TENDON_JAWS[kind]), QPOS0)
    assert fact.sentence.startswith("its hand (palm) creeps: a box of 30x40x40 mm")
    assert fact.value < 5e-3


ROW = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/>{tiles}</worldbody>
  <keyframe><key name="pressed" qvel="{speeds}"/></keyframe></mujoco>"""
TILE = """<body name="tile{0}" pos="{1} 0 .024"><freejoint/>
  <geom type="box" size=".0037 .012 .024" mass=".01"/></body>"""
LIFT = """<mujoco><worldbody><body name="rail"><geom type="box" size=".7 .04 .04"/>
  <body name="carriage" pos="0 0 .073"><joint name="way" type="slide" axis="1 0 0" range="0 1"/>
    <geom type="box" size=".08 .06 .03" mass="4"/>
    <body name="tool" pos="0 0 .03"><joint name="lift" type="slide" axis="0 0 1" range="0 .2"/>
      <geom type="cylinder" size=".03 .05" pos="0 0 .05" mass="1"/></body></body></body></worldbody>
  <actuator><position joint="way" kp="9000" kv="700"/><position joint="lift" kp="4000" kv="120"/>
  </actuator></mujoco>"""


def test_objects_that_press_on_each_other_hold_nothing(tmp_path: Path) -> None:
    """Tiles that touch in a row, and are shoved together, are no fingers of each other."""
    tiles = "".join(TILE.format(place, 0.0075 * place) for place in range(4))
    shove = " ".join(["1 0 0 0 0 0", *["0 0 0 0 0 0"] * 3])
    assert find_grip(*saved(tmp_path, ROW.format(tiles=tiles, speeds=shove)), "pressed") is None


def test_a_lift_is_no_hand_that_fails(tmp_path: Path) -> None:
    """A tool that comes down on its carriage closes on a box, but its model need not be a hand."""
    reference, model = saved(tmp_path, LIFT)
    assert not judge_grip(GripRequest(reference, fixes=False, placements=False)).holds
    assert find_grip(reference, model, QPOS0) is None
