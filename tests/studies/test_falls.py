"""A driven robot that falls from its start is a fact, unless its start is a known cause."""

from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.measure.run_integrity import stable_reason
from contactlab.schema.examination import Cause
from contactlab.studies.examine.facts import list_run_notes
from contactlab.studies.examine.standing_starts import list_falls, list_free_falls

# A trunk on two thin legs, which only a strong hip keeps below it.
_WALKER = """<mujoco><option timestep=".002"/><worldbody><geom type="plane" size="2 2 .1"/>
<body name="trunk" pos="0 0 .5"><freejoint/><geom type="box" size=".1 .1 .05" mass="5"/>
<body pos="0 0 -.05"><joint name="hip" axis="0 1 0" stiffness="{stiffness}" damping="5"/>
<geom type="box" pos="0 0 -.2" size=".{foot} .1 .24" mass="1"/></body></body></worldbody>
<actuator><motor joint="hip"/></actuator></mujoco>"""


def make_motion(foot: str, stiffness: float) -> Motion:
    model = mujoco.MjModel.from_xml_string(_WALKER.format(foot=foot, stiffness=stiffness))
    data = mujoco.MjData(model)
    data.qpos[7] = 0.0 if stiffness else 0.2
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    start = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, start, kind)
    return Motion(model, start[None], np.zeros((1, 1000, model.nu)))


@pytest.mark.parametrize(("foot", "stiffness", "falls"), [("02", 0, True), ("2", 1e4, False)])
def test_a_fall_is_a_fact(foot: str, stiffness: float, falls: bool) -> None:
    motion = make_motion(foot, stiffness)
    found = list(list_falls(motion, []))
    assert [fact.kind for fact in found] == ["fall"] * falls
    assert all(fact.place == "trunk" and fact.value > 0.1 for fact in found)
    assert not list(list_falls(motion, [Cause(stage="start", sentence="it begins in the air")]))


_HOPPER = """<mujoco><worldbody>{floor}<body name="trunk" pos="0 0 1"><freejoint/>
<geom size=".1"/><body pos="0 0 -.3"><joint name="hip" axis="0 1 0"/><geom size=".05"/>
</body></body></worldbody>{motor}</mujoco>"""


@pytest.mark.parametrize("floor", ["", '<geom type="plane" size="1 1 .1"/>'])
@pytest.mark.parametrize("motor", ["", '<actuator><motor joint="hip"/></actuator>'])
def test_a_robot_without_floor_and_actuators_falls_freely(floor: str, motor: str) -> None:
    """With a motor, a rule of lint says so; without a joint it is a thrown body."""
    model = mujoco.MjModel.from_xml_string(_HOPPER.format(floor=floor, motor=motor))
    found = [(fact.place, fact.value) for fact in list_free_falls(model)]
    assert found == [("trunk", 1.0)] * (not floor and not motor)
    thrown = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
    )
    assert not list(list_free_falls(thrown))


def test_notes_of_stable_runs_are_facts_once() -> None:
    """Of two seeds with the same notes; the values are those of their metrics."""
    fall, limit = "ball falls at the end, 4 mm below all", "the limit of jaw is off by 5 mm"
    examined: Any = SimpleNamespace(has_run=True, runs=[])
    for reason in (stable_reason("a - b is deep", [fall, limit]), stable_reason(None, [fall])):
        label = SimpleNamespace(reason=reason)
        record = SimpleNamespace(labels=[label], metrics={"drop": 2, "constraint_violation": 0.3})
        examined.runs.append(SimpleNamespace(record=record))
    found = [
        (fact.kind, fact.place, fact.value, fact.sentence) for fact in list_run_notes(examined)
    ]
    assert found == [("fall", "ball", 2.0, fall), ("limit", "jaw", 0.3, limit)]
