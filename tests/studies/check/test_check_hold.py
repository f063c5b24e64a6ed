"""What is held is judged by its pairs, and the remedy that is named is the one that cures."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from contactlab.plan.task_options import TaskOptions
from contactlab.schema.check_report import CheckResult, Measure
from contactlab.studies.check.check_runs import held_pairs
from contactlab.studies.check.checked_model import CheckedModel
from contactlab.studies.check.model_check import CheckRequest, open_model
from contactlab.studies.session import Session

One = Callable[..., CheckResult]
Values = Callable[[CheckResult, str], Mapping[str | None, float | None]]
Missed = Callable[[CheckResult], list[Measure]]

STIFF = """<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="box" pos="0 0 .06"><freejoint/><geom type="box" size=".05 .05 .05"/></body>
    <body name="arm" pos="1 0 1"><joint name="hinge" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/></body>
  </worldbody>
  <actuator><position joint="hinge" kp="1e7"/></actuator>
</mujoco>"""
SLOPE = """<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <geom name="slope" type="plane" size="2 2 .1" pos="0 3 2" euler="20 0 0"/>
    <body pos="0 -9 .05"><freejoint/><geom name="box" type="box" size=".05 .05 .05"/></body>
    <body pos="0 3 2.10641"><freejoint/><geom name="ball" size=".1" condim="3"/></body>
  </worldbody>
</mujoco>"""
STABLE = ("solref=0.005 1", "impratio=10")


def test_the_stable_set_holds(one: One, values: Values) -> None:
    found = one("gripping_pad", "hold", *STABLE)
    assert found.verdict == "pass"
    for name, limit in (("slip", 1e-4), ("penetration_mean", 1e-3), ("mode_switches", 5)):
        measured = values(found, name)
        assert set(measured) == {"left-block", "right-block"}
        assert all(each is not None and each < limit for each in measured.values())
    # Each pad presses with 35 N, to the force that lifts a pad of 15 g.
    for force in values(found, "force_mean").values():
        assert force == pytest.approx(35, rel=0.01)


@pytest.mark.long
def test_a_run_that_blows_up_does_not_hold(one: One, missed: Missed) -> None:
    """A motor of 1e7 N m/rad on a light arm."""
    found = one(STIFF, "hold", "timestep=0.02")
    assert found.verdict == "fail"
    assert [each.name for each in missed(found)] == ["steps_lost"]
    assert "the run is not complete: the engine stopped after" in found.notes[0]
    assert one(STIFF, "timestep", "timestep=0.02").verdict == "warning"


@pytest.mark.long
@pytest.mark.parametrize(
    ("model", "reason"),
    [("ball_drop", "intermittently"), ("free_arm", "no monitored pair carries force")],
)
def test_nothing_held_is_neither_pass_nor_fail(one: One, model: str, reason: str) -> None:
    bouncing = ["solref=-160000 -27", "timestep=0.001"] if model == "ball_drop" else []
    found = one(model, "hold", *bouncing)
    assert found.verdict == "not applicable"
    assert reason in found.reason


def test_a_box_that_slides_is_not_held(one: One) -> None:
    found = one("box_slide", "hold", "speed=10", "duration=0.8")
    assert found.verdict == "not applicable"
    assert "while sliding" in found.reason


def model_of(scene: str, assign: tuple[str, ...], folder: Path) -> CheckedModel:
    return open_model(CheckRequest(scene, assign, task=TaskOptions(drive="none")), Session(folder))


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "assign"),
    [("gripping_pad", ("solref=0.02 0.2",)), ("box_stack", ("boxes=3", "duration=0.5"))],
)
def test_a_whole_window_gives_the_metrics_of_the_record(
    scene: str, assign: tuple[str, ...], tmp_path: Path
) -> None:
    own = model_of(scene, assign, tmp_path).nominal
    pairs = list(held_pairs(own, 0.0, own.record.duration))
    assert max(each.depth for each in pairs) == own.record.metrics["penetration_mean"]


def test_a_window_sees_its_part_only(tmp_path: Path) -> None:
    """A box at 2 m/s slides for 0.41 s, and sticks from then on."""
    model = model_of("box_slide", (), tmp_path)
    (early,) = held_pairs(model.nominal, 0.05, 0.35)
    (late,) = held_pairs(model.nominal, 0.5, 1.0)
    assert not early.holds
    assert early.sliding > 0.9
    # v0 t - mu g t^2 / 2; a box that slides hops, and slips only while it bears force.
    way = 2 * 0.3 - 0.5 * 9.81 / 2 * (0.35**2 - 0.05**2)
    assert way / 4 < early.slip < way
    assert late.holds
    assert late.sliding == 0
    assert late.slip < 1e-4


def test_what_rolls_away_is_not_held(tmp_path: Path) -> None:
    """A ball on a slope sticks and bears load all the time, at v = 5/7 g sin(20 deg) t."""
    (tmp_path / "slope.xml").write_text(SLOPE)
    model = model_of(str(tmp_path / "slope.xml"), ("duration=0.6",), tmp_path)
    pairs = {each.name: each for each in model.holding.bearing}
    assert [each.name for each in model.holding.held] == ["floor-box"]
    ball = pairs["slope-ball"]
    assert ball.share > 0.95
    assert ball.sliding < 0.1
    # The mean over 0.1 to 0.6 s; it starts 0.02 mm above the slope.
    expected = 5 / 7 * 9.81 * np.sin(np.deg2rad(20)) * 0.35
    assert ball.speed == pytest.approx(expected, rel=0.03)
