"""How a hand closes: which fingers meet, and what becomes of an object that they come to."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.grip.grippers import TENDON_JAWS, claw

from contactlab.scene.model_names import name_by_address
from contactlab.studies.grip.closing import (
    close_at,
    contact_frame,
    find_closing,
    fit_object,
    squeeze_object,
)
from contactlab.studies.grip.fingers import find_hand
from contactlab.studies.grip.grip_fixture import GripFixture, add_object, mount_hand
from contactlab.studies.grip.gripped_object import DEFAULT_OBJECT
from contactlab.studies.grip.gripping import GripRequest, judge_grip
from contactlab.studies.grip.rollouts import body_frames

# Three fingers beside each other, one of which spreads too, and a thumb against them.
_FINGER = """<body name="{name}" pos="{x} {y} 0"><joint name="{name}" type="slide" axis="{way} 0 0"
  range="0 .04" damping="5" armature=".1"/>{more}
  <geom name="{name}" type="box" size=".005 .008 .01" mass=".05"/></body>"""
_SPREAD = '<joint name="spread" type="slide" axis="0 1 0" range="0 .02" damping="5" armature=".1"/>'
_MOTOR = '<motor name="{0}" joint="{0}" ctrlrange="-{1} {1}"/>'
NAMES = ("a", "b", "c", "thumb")


def hand() -> str:
    places = zip(NAMES, (-0.04, -0.04, -0.04, 0.04), (-0.03, 0.0, 0.03, 0.0), strict=True)
    fingers = [
        _FINGER.format(name=name, x=x, y=y, way=-np.sign(x), more=_SPREAD if name == "c" else "")
        for name, x, y in places
    ]
    motors = [_MOTOR.format(name, 20 if name == "thumb" else 7) for name in (*NAMES, "spread")]
    return (
        '<mujoco><worldbody><body name="palm"><geom type="box" size=".05 .05 .01" pos="0 0 -.03"/>'
        f"{''.join(fingers)}</body></worldbody><actuator>{''.join(motors)}</actuator></mujoco>"
    )


def rig_of(text: str) -> GripFixture:
    spec = mujoco.MjSpec.from_string(text)
    name_by_address(spec)
    model = spec.compile()
    return add_object(mount_hand(spec, model, find_hand(model)), DEFAULT_OBJECT)


def test_a_thumb_meets_the_fingers_and_they_never_each_other() -> None:
    """That a finger spreads from its neighbours makes it no thumb."""
    fixture = rig_of(hand())
    closing = find_closing(fixture)
    pairs = [{fixture.model.geom(geom).name for geom in pair} for pair in closing.pairs]
    assert pairs == [{name, "thumb"} for name in ("a", "b", "c")]
    names = [fixture.model.actuator(each).name for each in range(fixture.model.nu)]
    closed = dict(zip(names, closing.closed_controls.tolist(), strict=True))
    assert [closed[name] for name in NAMES] == [7, 7, 7, 20]


def test_an_object_that_is_held_still_stays_and_is_pressed_as_any() -> None:
    """While fingers close, 20 N on 1e5 kg for at most 4.5 s move it by less than 2.1 mm.

    Let go between two sides that press alike, it is where it would be without that.
    """
    fixture = rig_of(claw())
    closing = find_closing(fixture)
    free = squeeze_object(fixture, closing)
    assert free.approach is not None
    still = close_at(
        fixture, closing, replace(free.approach, is_still=True), closing.closed_controls
    )
    assert still.forces == pytest.approx(free.forces, rel=1e-3)
    way = body_frames(fixture.model, still.path, fixture.body, fixture.base)
    assert np.linalg.norm(way - way[0], axis=1).max() < 0.5 * 20 / 1e5 * 4.5**2


def test_pads_that_give_way_with_an_object_do_not_lose_it(tmp_path: Path) -> None:
    """Springs of 16 N/m lower pads and box by half of .1 kg g / 16 N/m, 31 mm, over its 20 mm."""
    spring = '<joint type="slide" axis="0 0 1" stiffness="16" damping="3"/>'
    text = claw(cone="elliptic", impratio="100").replace(
        'armature=".1"/>', f'armature=".1"/>{spring}'
    )
    (tmp_path / "claw.xml").write_text(text, encoding="utf-8")
    held = "box:30x40x40mm,.1kg"
    request = GripRequest(str(tmp_path / "claw.xml"), held, fixes=False, placements=False)
    report = judge_grip(request)
    assert "lost" not in {drift.trend for drift in report.drifts}


def test_ranges_in_the_wrong_unit_are_told(tmp_path: Path) -> None:
    arms = "".join(
        f'<body pos="1 {y} 0"><joint axis="0 1 0" range="-1 1"/><geom size=".1"/></body>'
        for y in (0, 1)
    )
    for unit, told in (("degree", True), ("radian", False)):
        text = claw(more=arms).replace("<option", f'<compiler angle="{unit}"/><option')
        (tmp_path / "claw.xml").write_text(text, encoding="utf-8")
        report = judge_grip(GripRequest(str(tmp_path / "claw.xml"), fixes=False, placements=False))
        assert any("these numbers are radians" in note for note in report.notes) == told


def test_flat_pads_hold_their_object_in_their_middle() -> None:
    """Their nearest points are any of the pads: MuJoCo takes a corner."""
    fixture = rig_of(TENDON_JAWS["coupled"])
    point, turn = contact_frame(fixture, find_closing(fixture))
    palm, pad = 0.3, -0.02 - 0.05
    assert point == pytest.approx([0, 0, palm + pad], abs=1e-3)
    assert np.abs(turn.T @ [0, 0, 1]) == pytest.approx([0, 0, 1], abs=1e-3)


def test_the_default_object_is_as_long_on_wide_pads() -> None:
    """It overhangs fingers beside each other, but not one pad."""
    text = TENDON_JAWS["coupled"].replace('size=".015 .006 .05"', 'size=".04 .006 .05"')
    fixture = rig_of(text)
    size = fit_object(fixture, find_closing(fixture)).size
    assert size == pytest.approx(DEFAULT_OBJECT.size)
