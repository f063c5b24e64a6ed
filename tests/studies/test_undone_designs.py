"""Servos, suction cups, wheels and bodies that do nothing, by closed forms of their weight."""

from collections.abc import Iterator
from pathlib import Path

import mujoco
import pytest
from tests.studies.test_design_causes import motion_of

import contactlab
from contactlab.budget import Motion
from contactlab.studies.examine import undone_designs
from contactlab.studies.examine.standing_starts import step_first_seed
from contactlab.studies.examine.undone_designs import TaskEnds, list_idle_facts, list_undone_designs

HOIST = """<mujoco><worldbody><geom type="plane" size="2 2 .1"/>
  <body name="fork" pos="0 0 .1"><joint name="mast" type="slide" axis="0 0 1" damping="100"/>
    <geom type="box" size=".3 .3 .02" mass="2"/></body>
  <body name="crate" pos="0 0 .18"><freejoint/><geom type="box" size=".1 .1 .05" mass="8"/></body>
  </worldbody>
  <actuator><position joint="mast" kp="2000" forcerange="-{newtons} {newtons}"/></actuator>
  <keyframe><key ctrl=".3"/></keyframe></mujoco>"""

JAWS = """<mujoco><option gravity="0 0 {gravity}"/><worldbody>
  <body name="left" pos="0 -.1 0"><joint name="l" type="slide" axis="0 1 0" damping="20"/>
    <geom type="box" size=".02 .02 .02" mass=".2"/></body>
  <body name="right" pos="0 .1 0"><joint name="r" type="slide" axis="0 -1 0" damping="20"/>
    <geom type="box" size=".02 .02 .02" mass=".2"/></body>
  <body name="cube"><freejoint/><geom type="box" size=".02 .02 .02" mass=".05"/></body></worldbody>
  <actuator><position joint="l" kp="500" forcerange="-5 5"/>
    <position joint="r" kp="500" forcerange="-5 5"/></actuator>
  <keyframe><key ctrl=".1 .1"/></keyframe></mujoco>"""

CUP = """<mujoco><option cone="elliptic"/><worldbody><geom type="plane" size="1 1 .1"/>
  <body name="cup" pos="0 0 .0285"><joint name="z" type="slide" axis="0 0 1" damping="20"/>
    <geom type="cylinder" size=".03 .02" mass=".3" margin=".002"/></body>
  <body name="pane" pos="0 0 .004"><freejoint/><geom type="box" size=".1 .1 .004" mass="1"/></body>
  </worldbody>
  <actuator><position joint="z" kp="400" kv="60"/>
    <adhesion body="cup" gain="{pull}" ctrlrange="0 1"/></actuator>
  <keyframe><key ctrl=".1 1"/></keyframe></mujoco>"""

WHEEL = """<body pos="{place} 0"><joint name="axle{number}" axis="0 1 0" damping=".01"/>
  <geom size=".1" mass="1"/></body>"""
CART = (
    """<mujoco><default><geom condim="{condim}"/></default><worldbody>
  <geom type="plane" size="9 9 .1"/>
  <body name="cart" pos="0 0 .1"><freejoint/><geom type="box" size=".2 .1 .02" mass="5"/>"""
    + "".join(
        WHEEL.format(place=place, number=number)
        for number, place in enumerate(("-.2 .2", "-.2 -.2", ".2 .2", ".2 -.2"))
    )
    + """</body></worldbody><actuator><velocity joint="axle0" kv="2"/>
  <velocity joint="axle1" kv="2"/></actuator>
  <keyframe><key ctrl="{left} {right}"/></keyframe></mujoco>"""
)

PARCEL = """<mujoco><option density="{density}"/><worldbody><geom type="plane" size="2 2 .1"/>
  <body name="parcel" pos="0 0 {height}" gravcomp="{gravcomp}"><freejoint/>
    <geom type="box" size=".1 .1 .1" mass="{mass}" {masks}/></body></worldbody></mujoco>"""

ARM = """<mujoco><worldbody>
  <body name="column"><geom type="cylinder" size="{radius} .1"/>
    <body name="upper"><joint name="a" axis="0 0 1" damping="2"/>
      <geom type="capsule" fromto=".02 0 .3 .3 0 .3" size=".03" mass="1"/>
      <body name="fore" pos=".3 0 0"><joint name="b" axis="0 0 1" damping="2"/>
        <geom type="capsule" fromto="0 0 .07 .24 0 .07" size=".03" mass="1"/></body></body></body>
  </worldbody><actuator><position joint="b" kp="50" kv="2"/></actuator>
  <keyframe><key ctrl="2.9"/></keyframe></mujoco>"""


def causes_of(text: str, seconds: float = 2.0) -> list[str]:
    """Return the sentences of designs that do nothing."""
    return [cause.sentence for cause in list_undone_designs(TaskEnds(motion_of(text, seconds)))]


@pytest.mark.parametrize(("newtons", "lifts"), [(120, True), (90, False), (15, False)])
def test_a_hoist_stalls_below_the_weight_that_it_lifts(newtons: float, *, lifts: bool) -> None:
    """Fork and crate weigh 98 N, and the fork alone 20 N."""
    ends = TaskEnds(motion_of(HOIST.format(newtons=newtons), 4.0))
    assert list(list_undone_designs(ends)) == []  # its limit of force may be meant to yield
    found = list(list_idle_facts(ends))
    assert len(found) == (not lifts)
    for fact in found:
        assert fact.sentence.startswith("the servo of mast rests")
        assert f"at {newtons} N, its limit" in fact.sentence


@pytest.mark.parametrize("gravity", [0, -9.81])
def test_jaws_that_squeeze_with_all_their_force_do_not_stall(gravity: float) -> None:
    """Without gravity the object stops them, too."""
    assert list(list_idle_facts(TaskEnds(motion_of(JAWS.format(gravity=gravity))))) == []


@pytest.mark.parametrize(("pull", "holds"), [(60, True), (8, False)])
def test_a_cup_lets_go_of_what_weighs_more_than_its_pull(pull: float, *, holds: bool) -> None:
    """The pane weighs 9.81 N, and is lifted by 40 N with the cup of .3 kg."""
    found = causes_of(CUP.format(pull=pull))
    assert len(found) == (not holds)
    for sentence in found:
        assert sentence.startswith("cup lets go of pane")
        assert "pane weighs 9.81 N" in sentence


@pytest.mark.parametrize(
    ("condim", "left", "right", "drives"), [(1, 6, 6, False), (3, 6, 6, True), (3, 6, -6, True)]
)
def test_wheels_without_friction_spin_in_place(
    condim: int, left: float, right: float, *, drives: bool
) -> None:
    """A cart that turns on the spot does not move either, but its wheels roll."""
    found = causes_of(CART.format(condim=condim, left=left, right=right))
    assert len(found) == (not drives)
    for sentence in found:
        assert "the wheel of axle0 spins in place" in sentence
        assert "has no friction (condim 1)" in sentence


@pytest.mark.parametrize(
    ("changes", "hangs"),
    [
        ({}, True),
        ({"gravcomp": 0}, False),
        ({"gravcomp": 1.2}, False),  # it rises
        ({"masks": 'contype="0" conaffinity="0"'}, False),  # a marker
        ({"density": 1000}, False),  # it floats
    ],
)
def test_a_body_hangs_in_the_air_by_gravcomp_alone(
    changes: dict[str, object], *, hangs: bool
) -> None:
    values = {"density": 0, "height": 1, "gravcomp": 1, "mass": 2, "masks": ""} | changes
    ends = TaskEnds(motion_of(PARCEL.format(**values), 0.5))
    found = list(list_idle_facts(ends))
    assert len(found) == hangs
    assert all(fact.sentence.startswith("parcel hangs in the air") for fact in found)
    assert list(list_undone_designs(ends)) == []  # it may be a balloon


@pytest.mark.parametrize(("radius", "stops"), [(0.13, True), (0.02, False)])
def test_a_forearm_that_its_column_stops_is_told_with_the_angle(
    radius: float, *, stops: bool
) -> None:
    """At 2.9 rad, it would pass the axis of the column at 72 mm; the column and it are wider."""
    found = list(list_idle_facts(TaskEnds(motion_of(ARM.format(radius=radius), 3.0))))
    assert len(found) == stops
    for fact in found:
        assert "contact column - fore stops it" in fact.sentence


@pytest.mark.long
@pytest.mark.parametrize(("pull", "verdict"), [(60, "depends"), (8, "fails")])
def test_a_cup_that_lets_go_fails_by_its_design(pull: float, verdict: str, tmp_path: Path) -> None:
    path = tmp_path / "cup.xml"
    path.write_text(CUP.format(pull=pull), encoding="utf-8")
    report = contactlab.examine(path, section=["labels", "budget"], drive="none", duration="1 s")
    assert (report.verdict, report.passed) == (verdict, verdict == "depends")
    assert [cause.stage for cause in report.causes] == ["design"] * (verdict == "fails")


@pytest.mark.long
def test_a_hoist_that_stalls_is_told_before_all_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its rest is run once for causes and facts, and once more without its weight."""
    weights = list[float]()

    def step_counted(motion: Motion, data: mujoco.MjData) -> Iterator[int]:
        weights.append(float(motion.model.opt.gravity[2]))
        return step_first_seed(motion, data)

    monkeypatch.setattr(undone_designs, "step_first_seed", step_counted)
    path = tmp_path / "hoist.xml"
    path.write_text(HOIST.format(newtons=90), encoding="utf-8")
    sections = ["labels", "budget", "facts"]
    report = contactlab.examine(path, section=sections, drive="none", duration="3 s")
    assert report.passed
    assert report.why[0].startswith("the servo of mast rests")
    assert weights == [-9.81, 0.0]
