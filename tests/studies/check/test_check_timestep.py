"""The timestep against task, speed and stiffness; speeds against closed forms."""

from collections.abc import Callable, Mapping

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.scene.contact_pairs import MonitoredPair
from contactlab.scene.run_setup import actuated_limbs
from contactlab.schema.check_report import CheckReport, CheckResult, Measure
from contactlab.studies.check.check_runs import pair_speeds

One = Callable[..., CheckResult]
Checked = Callable[..., CheckReport]
Values = Callable[[CheckResult, str], Mapping[str | None, float | None]]
Missed = Callable[[CheckResult], list[Measure]]

LEG = """<body name="leg{0}" pos="{0} 0 0"><joint name="hip{0}" axis="0 1 0" damping="2"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02"/></body>"""
WALKER = """<mujoco>
  <option timestep="{timestep}"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="trunk" pos="0 0 .3">{root}<geom type="box" size=".3 .1 .05"/>{legs}</body>
  </worldbody>
  <actuator>{motors}</actuator>
</mujoco>"""


def walker(legs: int, motors: int, root: str = "<freejoint/>", timestep: float = 4e-3) -> str:
    return WALKER.format(
        root=root,
        timestep=timestep,
        legs="".join(LEG.format(number) for number in range(legs)),
        motors="".join(f'<motor joint="hip{number}"/>' for number in range(motors)),
    )


@pytest.mark.parametrize(
    ("model", "limbs"),
    [
        (walker(4, 4), {"trunk": 4}),
        (walker(4, 1), {"trunk": 1}),
        (walker(2, 0), {}),
        (walker(2, 2, root='<joint type="slide"/>'), {}),
    ],
)
def test_limbs_are_counted(model: str, limbs: dict[str, int]) -> None:
    assert actuated_limbs(mujoco.MjModel.from_xml_string(model)) == limbs


@pytest.mark.long
def test_the_kind_of_task_is_told_from_the_model(checked: Checked, missed: Missed) -> None:
    walking = checked(walker(4, 4), "timestep")
    assert (walking.kind, walking.passed) == ("locomotion", True)
    assert walking.kind_reason == "'trunk' is free and has 4 actuated limbs"
    standing = checked(walker(4, 1), "timestep")
    assert standing.kind == "manipulation"
    assert [each.name for each in missed(standing.checks[0])] == ["timestep"]
    (remedy,) = standing.remedies
    assert remedy.edits[0].lines == ('<option timestep="0.002"/>',)
    for model, kind, verdict in (
        (walker(4, 1), "locomotion", "pass"),
        (walker(4, 4), "manipulation", "warning"),
    ):
        (found,) = checked(model, "timestep", kind=kind, remedies=False).checks
        assert found.verdict == verdict


@pytest.mark.long
def test_a_fast_ball_and_a_thin_plate(
    checked: Checked, one: One, missed: Missed, values: Values
) -> None:
    """10 m/s times 2 ms is 20 mm, against half of 2 mm."""
    report = checked("thin_plate", "timestep")
    (found,) = report.checks
    assert not report.passed
    assert values(found, "travel")["plate-ball"] == pytest.approx(0.02, rel=1e-6)
    assert {each.of for each in missed(found)} == {"plate-ball"}
    (remedy,) = report.remedies
    # 1 mm at 10 m/s takes 0.1 ms.
    assert remedy.settings["timestep"] == pytest.approx(1e-4, rel=0.02)
    cured = one("thin_plate", "timestep", f"timestep={remedy.settings['timestep']}")
    assert cured.verdict == "pass"


@pytest.mark.long
@pytest.mark.parametrize(
    ("solref", "ratio", "timestep"),
    [
        # h / (tc dr)
        ("0.02 1", 0.1, None),
        ("0.02 0.05", 2.0, 8e-4),
        # Raised to two timesteps, 4 ms; what cures goes by the solref as written.
        ("0.001 0.5", 1.0, 4e-4),
        # Never raised: h sqrt K.
        ("-1e6 -2000", 2.0, 8e-4),
    ],
)
def test_stiffness_against_the_timestep(
    checked: Checked, one: One, values: Values, solref: str, ratio: float, timestep: float | None
) -> None:
    report = checked("gripping_pad", "timestep", assign=(f"solref={solref}",))
    (found,) = report.checks
    (measured,) = values(found, "step_ratio").values()
    assert measured == pytest.approx(ratio)
    assert (found.verdict == "pass") == (timestep is None)
    assert any("refsafe" in note for note in found.notes) == solref.startswith("0.001")
    if timestep is not None:
        # What bounces off so stiff a contact may ask for less still.
        assert float(str(report.remedies[0].settings["timestep"])) <= timestep
        cured = one("gripping_pad", "timestep", f"solref={solref}", f"timestep={timestep}")
        assert all(ratio <= 0.8001 for ratio in values(cured, "step_ratio").values() if ratio)


BODIES = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 .1"/>
  <body pos="0 0 1"><freejoint/><geom name="ball" size=".1"/></body>
  <body pos="0 0 2"><joint axis="0 1 0"/>
    <geom name="rod" type="capsule" fromto="0 0 0 1 0 0" size=".01"/></body>
</worldbody></mujoco>"""
BALL = MonitoredPair("floor-ball", ("floor", "ball"), False, ((0,), (1,)), 1)
ROD = MonitoredPair("floor-rod", ("floor", "rod"), False, ((0,), (2,)), 1)


@given(st.lists(st.floats(-10, 10), min_size=7, max_size=7))
def test_speeds_bound_those_of_surfaces(speeds: list[float]) -> None:
    model = mujoco.MjModel.from_xml_string(BODIES)
    data = mujoco.MjData(model)
    rows = np.array([[0.0] * 7, speeds])
    found = pair_speeds(model, (BALL, ROD), np.tile(data.qpos, (2, 1)), rows)
    # A ball's spin goes nowhere.
    assert found[0] == pytest.approx(float(np.linalg.norm(speeds[:3])), abs=1e-9)
    # The farthest that a ball inside the rod gets from the joint is 1 m.
    assert found[1] == pytest.approx(abs(speeds[6]), abs=1e-9)


def test_what_the_run_left_alone_is_said_once(checked: Checked) -> None:
    """An arm that nothing drives hangs still: its motor and its limits were not at work."""
    hanging = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
      <body pos="0 0 1"><joint name="a" axis="0 1 0" range="-90 90"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/></body></worldbody>
      <actuator><motor joint="a"/></actuator></mujoco>"""
    report = checked(hanging, "timestep", remedies=False, drive="none")
    assert set(report.not_exercised) == {
        "joints never moved: a",
        "limits never reached: a",
        "actuators never moved: actuator[0]",
        *(line for line in report.not_exercised if line.startswith("pairs never touched: ")),
    }
    assert not any("exercised" in line or "drive" in line for line in report.notes)
