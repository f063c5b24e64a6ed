"""Facts of what no contact tells of: bodies that masks let pass, and mistakes of the file."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.windows import replay_motion
from contactlab.scene.scene_source import find_scene
from contactlab.schema.examination import Fact
from contactlab.schema.task import QPOS0
from contactlab.studies.examine.facts import list_facts
from contactlab.studies.examine.linted_file import lint_file
from contactlab.studies.examine.masked_passages import MaskedPassages

_STEP, _RADIUS, _BEGIN = 0.002, 0.02, 1.5
# Lowest points of the balls are 0.1 m above the middle of a plate 10 mm thick.
BALLS = """<mujoco><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="5 5 .1" pos="0 0 -1" contype="7" conaffinity="7"/>
  <body name="plate"><geom type="box" size=".2 .2 .005" contype="{plate}" conaffinity="{plate}"/>
  </body>
  <body name="ball" pos="0 0 .12"><freejoint/><geom size=".02" contype="1" conaffinity="1"/></body>
  <body name="drop" pos=".1 0 .12"><freejoint/>
    <geom size=".02" contype="{drop}" conaffinity="{drop}"/></body>
  </worldbody><contact>{exclude}</contact></mujoco>"""


def passing(plate: int = 2, drop: int = 2, exclude: str = "") -> list[Fact]:
    """Return the facts of half a second in which two balls fall on a plate, or through it."""
    model = mujoco.MjModel.from_xml_string(BALLS.format(plate=plate, drop=drop, exclude=exclude))
    data = mujoco.MjData(model)
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, data, start[0], INTEGRATION)
    motion, masked = Motion(model, start, np.empty((1, 250, 0))), MaskedPassages(model)
    masked.enter(motion, replay_motion(motion, 0.01, 1), _BEGIN)
    return list(masked.facts())


def test_a_ball_that_its_mask_lets_through_a_plate_is_told_when_it_is_in_it() -> None:
    (fact,) = passing()
    assert (fact.place, fact.kind) == ("contact plate - ball", "masks")
    # Half of the plate, the thinner one, is filled once the ball has fallen 0.1 m, at the free
    # fall's sqrt(2 s / g); states are looked at every 20 ms, and one before the run's end.
    falls = _BEGIN + float(np.sqrt(2 * 0.1 / 9.81))
    told = float(fact.sentence.partition(" mm at ")[2].partition(" s")[0])
    assert falls - 0.005 <= told <= falls + 0.02 + 0.005
    assert "another pair" not in fact.sentence


def test_others_that_pass_are_counted() -> None:
    (fact,) = passing(drop=4)
    assert fact.sentence.endswith("so does another pair")


@pytest.mark.parametrize(
    ("plate", "exclude"),
    [
        (3, ""),  # the masks meet
        (2, '<exclude body1="plate" body2="ball"/>'),  # written on purpose
        (0, ""),  # drawn, and collides with nothing
    ],
)
def test_what_meets_or_is_left_out_on_purpose_is_no_passage(plate: int, exclude: str) -> None:
    assert passing(plate=plate, exclude=exclude) == []


def test_the_first_mistakes_of_a_file_are_told_with_their_lines(tmp_path: Path) -> None:
    file = tmp_path / "leg.xml"
    text = """<mujoco>
<compiler angle="{angle}"/>
<worldbody><body name="a"><joint name="hip" range="-60 120" limited="true"/><geom size=".1"/>
<body pos="0 0 .5"><joint name="knee" range="-90 0" limited="true"/><geom size=".1"/></body>
</body></worldbody></mujoco>"""
    file.write_text(text.format(angle="radian"), encoding="utf-8")
    (fact,) = lint_file(find_scene(str(file)), str(file), QPOS0).facts
    assert fact.place.startswith(str(file))
    assert "[degrees-as-radians]" in fact.sentence
    file.write_text(text.format(angle="degree"), encoding="utf-8")
    assert lint_file(find_scene(str(file)), str(file), QPOS0).facts == ()


def test_a_file_whose_runs_mislead_has_faults(tmp_path: Path) -> None:
    """A keyframe with a wrong count is one for runs from it, doubled geoms are one for all."""
    file, geom = tmp_path / "box.xml", '<geom type="box" size=".1 .1 .1"/>'
    text = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/>
<body name="box"><freejoint/>{}</body></worldbody>
<keyframe><key name="short" qpos="0 0 1"/><key name="whole" qpos="0 0 1 1 0 0 0"/></keyframe>
</mujoco>"""
    file.write_text(text.format(geom), encoding="utf-8")
    (fault,) = lint_file(find_scene(str(file)), str(file), "short").faults
    assert (fault.rule, fault.is_of_start) == ("keyframe-length", True)
    assert "write 7 numbers in qpos of keyframe short (box.xml:3)" in fault.fix
    assert lint_file(find_scene(str(file)), str(file), "whole").faults == ()
    file.write_text(text.format(2 * geom), encoding="utf-8")
    (fault,) = lint_file(find_scene(str(file)), str(file), "whole").faults
    assert (fault.rule, fault.is_of_start) == ("coincident-geoms", False)


def test_motors_that_get_positions_are_a_fact_and_no_cause(tmp_path: Path) -> None:
    """Small torques of a keyframe move a robot hardly, and its numerics may be right."""
    file = tmp_path / "arm.xml"
    link = '<body pos="0 0 .3"><joint name="{}" axis="0 1 0"/><geom size=".1"/>{}</body>'
    file.write_text(
        f"""<mujoco><worldbody>{link.format("one", link.format("two", ""))}</worldbody>
<actuator><motor joint="one"/><motor joint="two"/></actuator><keyframe>
<key name="bent" qpos=".2 .5" ctrl=".2 .5"/>
<key name="still" qpos=".2 .5"/></keyframe></mujoco>""",
        encoding="utf-8",
    )
    source, reference = find_scene(str(file)), str(file)
    file = lint_file(source, reference, "bent")
    assert file.faults == ()
    kinds = [fact.kind for fact in file.facts if "gives 2 motors the positions" in fact.sentence]
    assert kinds == ["limp"]
    other = lint_file(source, reference, "still")
    kinds = [fact.kind for fact in other.facts if "gives 2 motors the positions" in fact.sentence]
    assert kinds == ["file"]


JAMMED = """<mujoco><worldbody><geom type="plane" size="2 2 .1"/>
  <body name="cart" pos="0 0 .12"><freejoint/><geom type="box" size=".2 .1 .02" mass="1"/>
    <body name="wheel" pos="0 .14 0"><joint axis="0 1 0" damping=".01"/>
      <geom type="sphere" size=".03" mass=".3"/></body>
    <body name="bar" pos="0 {place} 0">{joint}<geom type="box" size=".1 .03 .05" mass=".2"/>
    </body></body></worldbody></mujoco>"""
_HINGE = '<joint axis="0 1 0" damping=".01"/>'
_SPRING = '<joint type="slide" axis="0 1 0" stiffness="5e4" springref="-.02" damping="50"/>'


@pytest.mark.parametrize(
    ("place", "joint", "is_jammed"),
    [(0.18, _HINGE, True), (0.203, _HINGE, False), (0.203, _SPRING, False)],
    ids=["jam", "apart", "spring"],
)
def test_bodies_that_joints_press_on_each_other_at_rest_are_a_fact(
    place: float, joint: str, is_jammed: bool
) -> None:
    """No gravity, motor or spring makes that force: two hinges hold the bodies in each other."""
    model = mujoco.MjModel.from_xml_string(JAMMED.format(place=place, joint=joint))
    data = mujoco.MjData(model)
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, data, start[0], INTEGRATION)
    found = list_facts([Motion(model, start, np.empty((1, 500, 0)), name="rest")], [0.0])
    pressing = [fact for fact in found if fact.kind == "force"]
    assert bool(pressing) == is_jammed
    if is_jammed:
        assert pressing[0].place == "contact wheel - bar"


def test_the_gap_of_a_soft_connect_is_the_distance_that_its_body_sinks() -> None:
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body name="bob" pos="0 0 1">
      <freejoint/><geom size=".05"/></body></worldbody><equality>
      <connect name="cord" body1="bob" anchor="0 0 0" solref="1 1"/></equality></mujoco>""")
    data = mujoco.MjData(model)
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, data, start[0], INTEGRATION)
    (fact,) = (
        one
        for one in list_facts([Motion(model, start, np.empty((1, 250, 0)))], [0.0])
        if one.kind == "equality"
    )
    mujoco.mj_step(model, data, 250)
    # It sinks until the end; states are looked at every 10 ms.
    speed = abs(float(data.qvel[2]))
    assert fact.value == pytest.approx(1 - float(data.qpos[2]), abs=0.02 * speed)
    assert fact.sentence.startswith("the ends of equality cord come ")
