"""Limits and equalities that give way are seen, and by how much is that of the closed form."""

import re
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.contact.contact_laws import rest_penetration
from contactlab.scene.run_setup import find_mechanism

MASS, GRAVITY, SOLIMP = 2.0, 9.81, (0.9, 0.95, 0.001, 0.5, 2.0)
# A mass that gravity pulls against the end of its slide, or from the point that it is tied to.
LIMIT = """
<mujoco>
  <worldbody><body><joint name="lift" type="slide" axis="0 0 1" range="0 .3" limited="true"
    solreflimit="{timeconst} 1"/><geom size=".05" mass="2"/></body></worldbody>
</mujoco>
"""
TIED = """
<mujoco>
  <worldbody><body name="load"><joint type="slide" axis="0 0 1"/><geom size=".05" mass="2"/></body>
  </worldbody>
  <equality><connect body1="load" anchor="0 0 0" solref="{timeconst} 1"/></equality>
</mujoco>
"""
SWEEP = "version: 1\nscene: model.xml\nduration: 6\ndrive: none\nseeds: 1\ntrace: none\naxes: {}\n"


def row_of(sweeper: Any, model: str) -> dict[str, Any]:
    (sweeper.folder / "model.xml").write_text(model)
    sweeper.run(SWEEP)
    return sweeper.rows()[0]


@pytest.mark.parametrize(
    ("model", "scale"), [(LIMIT, 0.3), (TIED, 0.05)], ids=["limit", "equality"]
)
@pytest.mark.parametrize(("timeconst", "violated"), [(0.02, False), (0.4, True)])
def test_what_gives_way_gives_as_the_law_says(
    sweeper: Any, model: str, scale: float, timeconst: float, violated: bool
) -> None:
    """At rest a constraint bears the weight where its spring, as MuJoCo states it, does."""
    row = row_of(sweeper, model.format(timeconst=timeconst))
    load = MASS * GRAVITY
    expected = float(rest_penetration(load, 1 / MASS, (timeconst, 1.0), SOLIMP))
    # Both settle with a time constant of 0.4 s at most, so within 4.5 s to exp(-11).
    assert row["constraint_violation_rest"] == pytest.approx(expected / scale, rel=2e-3)
    assert ("constraint_violated" in row["labels"]) == (expected / scale > 0.1) == violated


def test_a_limit_that_is_off_is_not_violated(sweeper: Any) -> None:
    model = LIMIT.format(timeconst=0.2).replace(
        "<worldbody>", '<option><flag limit="disable"/></option><worldbody>'
    )
    row = row_of(sweeper, model)
    assert row["constraint_violation"] == 0
    assert row["labels"] == ["stable"]


def test_what_a_limit_was_violated_by_at_the_start_does_not_count(sweeper: Any) -> None:
    model = LIMIT.format(timeconst=0.02).replace(
        "</mujoco>", '<keyframe><key qpos="-.2"/></keyframe></mujoco>'
    )
    row = row_of(sweeper, model)
    assert row["constraint_violation"] == 0
    assert np.isclose(row["constraint_violation_rest"], 0)


def test_what_starts_apart_and_closes_gives_way_nowhere(sweeper: Any) -> None:
    model = TIED.format(timeconst=0.02).replace(
        "</mujoco>", '<keyframe><key qpos="-.2"/></keyframe></mujoco>'
    )
    row = row_of(sweeper, model)
    assert row["constraint_violation"] == 0
    assert row["labels"] == ["stable"]


@pytest.mark.parametrize(("margin", "violated"), [(0.12, True), (0.002, False)])
def test_a_limit_that_acts_ahead_of_its_end_keeps_off_it(
    sweeper: Any, margin: float, violated: bool
) -> None:
    """It bears the weight a rest penetration into its margin, which is .2 mm."""
    model = LIMIT.format(timeconst=0.02).replace('range="0 .3"', f'range="0 .3" margin="{margin}"')
    model = model.replace("</mujoco>", '<keyframe><key qpos=".2"/></keyframe></mujoco>')
    row = row_of(sweeper, model)
    sag = float(rest_penetration(MASS * GRAVITY, 1 / MASS, (0.02, 1.0), SOLIMP))
    assert row["constraint_violation_rest"] == pytest.approx((margin - sag) / 0.3, rel=2e-3)
    assert ("constraint_violated" in row["labels"]) == violated


@pytest.mark.parametrize(("timestep", "violated"), [(0.03, True), (0.002, False)])
def test_what_flies_through_a_stop_by_its_step_is_found(
    sweeper: Any, timestep: float, violated: bool
) -> None:
    """A stop at speed v gives way by v tc / e, and tc is at least two steps: .13 or .009 m."""
    model = LIMIT.format(timeconst=0.002).replace(
        "<worldbody>", f'<option timestep="{timestep}" gravity="0 0 0"/><worldbody>'
    )
    model = model.replace("</mujoco>", '<keyframe><key qpos=".2" qvel="-6"/></keyframe></mujoco>')
    assert ("constraint_violated" in row_of(sweeper, model)["labels"]) == violated


SWUNG = """
<mujoco>
  <worldbody><body name="door"><joint name="door" axis="0 0 1" range="-120 30" limited="true"
    damping=".02" solreflimit="{timeconst} {dampratio}"/>
    <geom type="box" size=".4 .02 .9" pos=".4 0 0" mass="5"/></body></worldbody>
  <keyframe><key qvel="{speed}" qpos=".5"/></keyframe>
</mujoco>
"""


@pytest.mark.parametrize("duration", [1, 2, 5])
@pytest.mark.parametrize(
    ("timeconst", "dampratio", "speed"), [(0.5, 1, 2.0), (0.5, 0.3, 2.0), (2, 1, 1.5)]
)
def test_a_door_that_swings_back_from_its_stop_rests_on_none(
    sweeper: Any, timeconst: float, dampratio: float, speed: float, duration: float
) -> None:
    """Nothing holds it beyond, so that at any duration the limit yields nowhere at rest."""
    (sweeper.folder / "model.xml").write_text(
        SWUNG.format(timeconst=timeconst, dampratio=dampratio, speed=speed)
    )
    sweeper.run(SWEEP.replace("duration: 6", f"duration: {duration}"))
    (row,) = sweeper.rows()
    assert row["constraint_violation"] > 0.1
    assert row["constraint_violation_rest"] < 0.05


@pytest.mark.parametrize("duration", [1, 2, 5])
@pytest.mark.parametrize(("timeconst", "violated"), [(0.1, False), (0.4, True)])
def test_a_limit_under_load_is_the_same_at_any_duration(
    sweeper: Any, timeconst: float, violated: bool, duration: float
) -> None:
    """At rest it gives way by 2 and 26 % of its range; in a second, the latter by half of that."""
    (sweeper.folder / "model.xml").write_text(LIMIT.format(timeconst=timeconst))
    sweeper.run(SWEEP.replace("duration: 6", f"duration: {duration}"))
    (row,) = sweeper.rows()
    assert ("constraint_violated" in row["labels"]) == violated


@pytest.mark.parametrize(("speed", "is_noted"), [(-2.5, True), (-0.8, False)])
def test_a_slide_far_out_of_its_range_is_noted(sweeper: Any, speed: float, is_noted: bool) -> None:
    """A stop at speed v gives way by v tc / e: 46 or 15 mm of a range of 36 mm.

    The label has a limit of 50 mm, half of the reach of the body.
    """
    model = LIMIT.format(timeconst=0.05).replace(
        "<worldbody>", '<option gravity="0 0 0" timestep=".001"/><worldbody>'
    )
    model = model.replace('range="0 .3"', 'range="0 .036"').replace('size=".05"', 'size=".1"')
    model = model.replace("</mujoco>", f'<keyframe><key qvel="{speed}"/></keyframe></mujoco>')
    row = row_of(sweeper, model)
    peak = -speed * 0.05 / np.e
    assert row["constraint_violation"] == pytest.approx(peak / 0.1, rel=0.03)
    assert row["labels"] == ["stable"]
    found = re.search(r"limit of lift is off by (\S+) mm, (\d+) % of its", row["label_reason"])
    assert bool(found) == is_noted
    if found:
        assert float(found[1]) == pytest.approx(1e3 * peak, rel=0.03)
        assert float(found[2]) == pytest.approx(100 * peak / 0.036, rel=0.03)


@pytest.mark.parametrize(("lead", "violated"), [("mocap='true'", False), ("", True)])
def test_what_a_mocap_body_leads_may_stay_behind(sweeper: Any, lead: str, violated: bool) -> None:
    """A cart that a stop holds 3 m from what draws it softly: a servo out of reach, or a lost tie.

    The stop is (1 s / 4 ms)^2 times as stiff, so that it gives way by less than .1 mm.
    """
    row = row_of(
        sweeper,
        f"""<mujoco><option gravity="0 0 0"/><worldbody><body name="hand" {lead} pos="3 0 0"/>
        <body name="cart"><joint type="slide" axis="1 0 0" range="-.1 .1" limited="true"
        solreflimit=".004 1"/><geom size=".05"/></body></worldbody><equality>
        <weld body1="hand" body2="cart" relpose="0 0 0 1 0 0 0" solref="1 1"/></equality>
        </mujoco>""",
    )
    assert ("constraint_violated" in row["labels"]) == violated


def test_a_belt_is_judged_by_what_it_moves() -> None:
    """A cart that reaches .05 m, and a pulley .02 m round: .031 m in a quarter turn."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><joint name="cart" type="slide"/><geom size=".05"/></body>
        <body><joint name="pulley"/><geom size=".02"/></body></worldbody><tendon>
        <fixed name="belt"><joint joint="cart" coef="1"/><joint joint="pulley" coef="-.02"/></fixed>
        <fixed name="cord"><joint joint="pulley" coef="-.02"/></fixed></tendon><equality>
        <tendon tendon1="belt"/><tendon tendon1="cord"/></equality></mujoco>"""
    )
    belt, cord = find_mechanism(model).equalities
    assert (belt.scale, cord.scale) == pytest.approx((0.05, 0.02 * np.pi / 2))


TURN = """
<mujoco>
  <option gravity="0 0 0" timestep="0.002"/>
  <worldbody><body>
    <joint name="turn" type="{kind}" axis="0 1 0" range="0 1" limited="true"
      solreflimit="0.05 0.5"/>
    <geom type="box" size=".1 .1 .1" mass="1" pos="0 0 0" contype="0" conaffinity="0"/></body>
  </worldbody>
  <keyframe><key qvel="{speed}"/></keyframe>
</mujoco>
"""


@pytest.mark.parametrize("speed", [8.0, 14.0])
def test_a_ball_joint_is_turned_as_far_as_a_hinge(sweeper: Any, speed: float) -> None:
    """A cube turns alike about every axis, so that both go beyond the same limit by one angle.

    The hinge's is its coordinate; only rounding of quaternions parts them.
    """
    found = list[dict[str, Any]]()
    for kind, qvel in (("hinge", f"{speed}"), ("ball", f"0 {speed} 0")):
        (sweeper.folder / "model.xml").write_text(TURN.format(kind=kind, speed=qvel))
        sweeper.run(SWEEP.replace("duration: 6", "duration: 0.5"), kind)
        found += sweeper.rows(kind)
    assert found[0]["constraint_violation"] > 0.05
    for name in ("constraint_violation", "constraint_violation_rest"):
        assert found[1][name] == pytest.approx(found[0][name], rel=1e-6, abs=1e-9)
