"""Energy is judged whatever drives a model: by what its forces did."""

from typing import Any

import mujoco
import pytest

# A ball beside an idle motor, so that the energy at the start bounds nothing.
BOUNCE = """
<mujoco>
  <option timestep="{timestep}"/>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .6"><freejoint/>
      <geom size=".05" mass=".5" solref="{solref}" priority="1"/></body>
    <body pos="1 0 1"><joint name="idle" axis="0 1 0" damping=".1"/>
      <geom size=".05" mass=".5"/></body>
  </worldbody>
  <actuator><motor joint="idle" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
# RK4 multiplies the energy of an oscillator by 1 - (omega h)^6 / 72 in a step.
SPRING = """
<mujoco>
  <option timestep="{timestep}" integrator="RK4" gravity="0 0 0"/>
  <worldbody><body><joint type="slide" stiffness="100" ref="0" springref="0"/>
    <geom size=".1" mass="1" contype="0" conaffinity="0"/></body></worldbody>
  <keyframe><key qpos=".1"/></keyframe>
</mujoco>
"""
# A spring that a motor holds drawn: it stores 98 J, and swings by 1.
DRAWN = """
<mujoco>
  <option timestep=".002" integrator="{integrator}"/>
  <worldbody><body><joint name="draw" type="slide" axis="1 0 0" stiffness="2500" damping="20"/>
    <geom size=".02" mass=".08"/></body></worldbody>
  <actuator><motor joint="draw"/></actuator>
  <keyframe><key qpos="-.25" qvel="{speed}" ctrl="-700"/></keyframe>
</mujoco>
"""
SWEEP = "version: 1\nscene: model.xml\nduration: {seconds}\ndrive: none\ntrace: none\naxes: {{}}\n"


def labels(sweeper: Any, model: str, seconds: float) -> tuple[dict[str, Any], set[str]]:
    (sweeper.folder / "model.xml").write_text(model)
    sweeper.run(SWEEP.format(seconds=seconds))
    (row,) = sweeper.rows()
    return row, set(row["labels"])


@pytest.mark.parametrize(
    ("solref", "timestep", "gains"), [("0.0138 0.1809", 0.004, True), ("0.02 0.6", 0.002, False)]
)
def test_a_bounce_that_gains_is_found_beside_a_motor(
    sweeper: Any, solref: str, timestep: float, gains: bool
) -> None:
    model = BOUNCE.format(solref=solref, timestep=timestep)
    row, found = labels(sweeper, model, 2.0)
    assert ("constraint_gain" in found) == gains, row


@pytest.mark.parametrize(("timestep", "loses"), [(0.1, True), (0.01, False)])
def test_energy_that_the_integrator_takes_is_missed(
    sweeper: Any, timestep: float, loses: bool
) -> None:
    """With omega h = 1, k steps leave (1 - 1/72)^k of it, 34.5 in the median; with .1, all."""
    row, found = labels(sweeper, SPRING.format(timestep=timestep), 4.0)
    expected = 1 - (71 / 72) ** 34.5 if loses else 0.0
    assert row["integration_loss"] == pytest.approx(expected, abs=0.02)
    assert ("energy_loss" in found) == loses


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("speed", [0, 3])
def test_a_spring_that_a_motor_draws_gains_nothing(
    sweeper: Any, integrator: str, speed: float
) -> None:
    """The books close to second order: by (omega h)^2 / 2, 6 % at most, where first order is 35."""
    row, found = labels(sweeper, DRAWN.format(integrator=integrator, speed=speed), 2.0)
    assert found == {"stable"}
    assert row["integration_gain"] < (2500 / 0.08) * 0.002**2
    assert abs(row["integration_loss"]) < (2500 / 0.08) * 0.002**2


# A tab that a thumb bends by .9 N m, where its spring of 2 N m/rad yields at 20 degrees: .7 N m.
YIELDING = """
<mujoco>
  <option timestep=".001"/>
  <worldbody><body name="tab"><joint name="fold" axis="0 1 0" stiffness="2" damping=".02"
    springyield="20"/><geom type="box" size=".05 .03 .002" pos=".05 0 0" mass=".05"
    contype="0" conaffinity="0"/></body></worldbody>
  <actuator><motor joint="fold"/></actuator>
  <keyframe><key ctrl=".9"/></keyframe>
</mujoco>
"""


@pytest.mark.skipif(
    int(mujoco.__version__.partition(".")[0]) < 4, reason="springs yield from MuJoCo 4 on"
)
def test_what_a_yielding_spring_takes_for_good_its_model_takes_too(sweeper: Any) -> None:
    """No force has that work in the books, so the run is looked at again, and is sound."""
    row, found = labels(sweeper, YIELDING, 1.0)
    assert row["integration_loss"] > 0.1
    assert abs(row["backward_error_energy"]) < 0.1
    assert found == {"stable"}


RESTING_BOUNCE = """
<mujoco>
  <option timestep="{timestep}"/>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body pos="0 0 .5"><freejoint/>
      <geom size=".05" mass=".5" solref=".0138 .1809" priority="1"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(("timestep", "gains"), [(0.004, True), (0.0005, False)])
def test_a_gain_at_rest_is_found_before_an_excitation(
    sweeper: Any, timestep: float, gains: bool
) -> None:
    """Pushes begin after 1 s; until then the ball bounces by its own energy alone."""
    (sweeper.folder / "model.xml").write_text(RESTING_BOUNCE.format(timestep=timestep))
    for drive in ("none", "exercise"):
        sweeper.run(SWEEP.format(seconds=3).replace("none", drive, 1), drive)
        (row,) = sweeper.rows(drive)
        assert ("energy_injection" in row["labels"]) == gains, (drive, row["energy_gain"])
