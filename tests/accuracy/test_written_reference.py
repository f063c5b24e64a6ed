"""Errors against the scene as written: a ball in free fall, where every number has a closed form.

RK4 is exact for a constant acceleration, so that a run under another gravity is off by what the
difference of gravity moves it, and by rounding, at any timestep.
"""

from typing import Any

import pytest

FALL = """<mujoco>
  <option timestep="0.004"/>
  <worldbody>
    <body pos="0 0 3"><freejoint/><geom size="0.1"/></body>
  </worldbody>
  <keyframe><key name="high" qpos="0 0 4 1 0 0 0"/></keyframe>
</mujoco>
"""
SWEEP = """
version: 1
scene: fall.xml
drive: none
duration: 1.0
seeds: 2
axes:
  integrator: [RK4]
  %s
accuracy: {against: %s, error: trajectory, refine: 2}
trace: none
checks: none
"""
WRITTEN, SAMPLES = 9.81, 256


@pytest.fixture
def fall(sweeper: Any) -> Any:
    (sweeper.folder / "fall.xml").write_text(FALL)
    return sweeper


@pytest.mark.long
def test_another_gravity_is_off_by_what_it_moves(fall: Any) -> None:
    """By dg t^2 / 2 and dg t; energy by g' dg m t^2 / 2, of a peak of m g^2 T^2 / 2.

    Means are over times k / 256, those of t, t^2 being (n + 1) / 2n and (n + 1)(2n + 1) / 6n^2.
    Steps of 0.3 s end before the run does, those of 0.35 s after: all are compared at its end.
    """
    fall.run(SWEEP % ("gravity: [9.81, 8.81]\n  timestep: [0.05, 0.3, 0.35]", "written"))
    first = (SAMPLES + 1) / (2 * SAMPLES)
    second = (SAMPLES + 1) * (2 * SAMPLES + 1) / (6 * SAMPLES**2)
    for row in fall.rows():
        apart = WRITTEN - row["gravity"]
        assert row["error_final"] == pytest.approx(apart / 2, abs=1e-9)
        assert row["error_peak"] == pytest.approx(apart / 2, abs=1e-9)
        assert row["error_mean"] == pytest.approx(apart / 2 * second, abs=1e-9)
        assert row["error_velocity"] == pytest.approx(apart * first, abs=1e-9)
        energy = row["gravity"] * apart / WRITTEN**2 * second
        assert row["error_energy"] == pytest.approx(energy, abs=1e-9)
        assert row["chaotic"] is False
        assert row["divergence"] <= 3e-8, "1e-8 m and 1e-8 m/s, along each of three axes"


@pytest.mark.long
@pytest.mark.parametrize("start", ["keyframe: [qpos0, high]", "perturbation: [0.0, 9.0]"])
def test_scenario_and_start_are_the_runs_own(fall: Any, start: str) -> None:
    """Runs in another scenario, or from elsewhere, are compared with runs that are there too."""
    scenario = "gravity: {values: [9.81, 8.81], role: scenario}"
    fall.run(SWEEP % (f"{scenario}\n  {start}", "written"))
    assert len(fall.rows()) == 8
    assert all(row["error_peak"] <= 1e-9 for row in fall.rows())


@pytest.mark.long
def test_runs_that_differ_in_numerics_alone_have_the_same_error_either_way(fall: Any) -> None:
    """Euler is off by g h t / 2 at time t, whichever reference says so."""
    for against in ("own", "written"):
        fall.run(SWEEP.replace("RK4", "Euler") % ("timestep: [0.004, 0.02]", against), against)
    for own, written in zip(fall.rows("own"), fall.rows("written"), strict=True):
        assert own["run_id"] == written["run_id"]
        expected = pytest.approx(WRITTEN * own["timestep"] / 2, rel=1e-6)
        assert own["error_final"] == expected
        assert written["error_final"] == expected


# RK4 multiplies the speed by 1 + z + z^2/2 + z^3/6 + z^4/24, of z = -damping h / mass: 5 at the
# coarse step of 4 ms, and so by 2e8 in 48 ms, which is no failure; 1/3 at the fine step of 2 ms.
DAMPER = """<mujoco>
  <option timestep="0.008" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    <body><joint type="slide" damping="1000"/><geom size="0.1" mass="1"/></body>
  </worldbody>
  <keyframe><key name="pushed" qvel="1"/></keyframe>
</mujoco>
"""


def test_a_reference_that_flies_away_is_none(sweeper: Any) -> None:
    """Steps of the speed alone take no body further than one of them at its first speed."""
    (sweeper.folder / "damper.xml").write_text(DAMPER)
    sweeper.run("""
version: 1
scene: damper.xml
drive: none
duration: 0.048
axes: {timestep: [0.008]}
accuracy: {error: trajectory, refine: 2}
trace: none
checks: none
""")
    (row,) = sweeper.rows()
    assert row["reference_integrator"] == "implicitfast"
    assert row["error_peak"] <= 0.008
    assert row["error_estimate"] <= 0.004
