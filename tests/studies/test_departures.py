"""A body that slides off its support is a fact, with the friction that it lacks."""

import math

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.schema.examination import Cause
from contactlab.schema.task import QPOS0
from contactlab.studies.examine.departures import list_departures

STAND = """<mujoco><option timestep=".002" cone="elliptic"/><worldbody>
  <geom name="stand" type="box" size="2 .5 .1" euler="0 {angle} 0" {belt}/>
  <body name="phone" pos="{place}" euler="0 {angle} 0"><freejoint/>
    <geom type="box" size=".05 .03 .01" friction="{friction}"/></body>{more}</worldbody></mujoco>"""


def make_motion(
    angle: float, friction: float, gap: float = -1e-4, belt: str = "", more: str = ""
) -> Motion:
    height, turn = 0.11 + gap, math.radians(angle)
    text = STAND.format(
        angle=angle, friction=friction, belt=f'friction="{friction}" {belt}', more=more,
        place=f"{height * math.sin(turn)} 0 {height * math.cos(turn)}",
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(text)
    start = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, mujoco.MjData(model), start, INTEGRATION)
    return Motion(model, start[None], np.zeros((1, 500, model.nu)), name="rest")


@pytest.mark.parametrize(("friction", "stays"), [(0.2, False), (0.5, True)])
def test_a_body_that_slides_off_names_the_friction_it_lacks(friction: float, stays: bool) -> None:
    """Coulomb: it stays on a slope of 20 degrees above tan 20 = 0.36."""
    facts = list(list_departures(make_motion(20, friction), "resting", []))
    assert len(facts) == (not stays)
    for fact in facts:
        way = 9.81 * (math.sin(math.radians(20)) - friction * math.cos(math.radians(20))) / 2
        assert fact.value == pytest.approx(way, rel=0.1)
        assert "where keyframe resting puts it" in fact.sentence
        assert fact.sentence.endswith(
            "on stand, at 20 degrees, it stays with friction above 0.36, not 0.2"
        )


def test_a_known_cause_of_the_start_is_told_alone() -> None:
    cause = Cause(stage="start", sentence="it begins in the stand")
    assert not list(list_departures(make_motion(20, 0.2), QPOS0, [cause]))


@pytest.mark.parametrize(
    "changed",
    [
        {"angle": 0.0, "belt": 'surfacevel=".5 0 0"'},
        {"angle": 20.0, "gap": 0.05},  # dropped on purpose
        {
            "angle": 20.0,
            "more": '<body pos="-.05 0 .15"><joint type="slide" axis="1 0 0"/>'
            '<geom size=".06"/></body>',
        },
        {
            "angle": 0.0,
            "more": '<body pos="-.2 0 .15"><joint type="slide" axis="1 0 0" springref="1" '
            'stiffness="300"/><geom size=".04"/></body>',
        },
    ],
    ids=["belt", "dropped", "touched", "hit"],
)
def test_a_body_that_is_moved_or_dropped_has_no_fact(changed: dict[str, object]) -> None:
    motion = make_motion(friction=0.2, **changed)  # pyright: ignore[reportArgumentType]
    assert not list(list_departures(motion, QPOS0, []))
