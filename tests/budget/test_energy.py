"""What a run gains or loses that its model does not, and what is no such thing."""

from dataclasses import replace

import numpy as np
import pytest
from tests.budget_motions import motion_of

from contactlab.budget import Settings, error_budget, judge
from contactlab.budget.defects import energy_defects, find_drift, settle_defects

PENDULUM = """<mujoco><option timestep="{h}" integrator="RK4"/><worldbody><body pos="0 0 2">
<joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .5 0 0" size=".02"/></body></worldbody>
</mujoco>"""
COMPOUND = """<mujoco><option timestep="{h}" integrator="RK4"/><worldbody><body pos="0 0 20">
<freejoint/><geom type="box" size=".1 .2 .05"/><geom size=".08" pos=".3 0 0"/>
<geom type="capsule" size=".02 .3" pos="0 .2 .1"/></body></worldbody></mujoco>"""
SPRING = """<mujoco><option timestep="{h}" gravity="0 0 0" integrator="RK4"/><worldbody><body>
<joint type="slide" axis="1 0 0" stiffness="{k}"/><geom size=".1" mass="1"/></body></worldbody>
</mujoco>"""
DAMPED = """<mujoco><option timestep=".004"/><worldbody><body>
<joint type="slide" axis="0 0 1" damping="{damping}"/><geom size=".1" mass="1"/></body></worldbody>
</mujoco>"""
PLAIN = Settings(check=False, places=False, excess=False)


@pytest.mark.parametrize("h", [0.001, 0.004])
@pytest.mark.parametrize(
    ("xml", "qvel"), [(PENDULUM, None), (COMPOUND, [1.0, 0, 5, 3, 8, 2])], ids=["swings", "falls"]
)
def test_free_motion_by_rk4_is_its_models(xml: str, qvel: list[float] | None, h: float) -> None:
    budget = error_budget([motion_of(xml.format(h=h), 1.0, qvel=qvel)], rows=[])
    # Fourth order in w h: a body that spins by 9 rad/s tumbles by up to twice that, so that it is
    # (.072)^4, of which a share is left in the energy.
    assert budget.error < 3e-5
    assert abs(budget.phases[0].energy_drift) < 3e-5
    assert judge(budget).word == "ok"


@pytest.mark.parametrize("rate", [0.7, 0.9, 1.5])
def test_what_rk4_takes_of_a_spring_is_found(rate: float) -> None:
    """RK4 leaves 1 - x^6 / 72 + x^8 / 576 of an oscillator's energy a step, x being rate times h.

    Its scale is what it had at the start: what is damped to rest has lost all of it.
    """
    h, seconds = 0.01, 4.0
    left = 1 - rate**6 / 72 + rate**8 / 576
    xml = SPRING.format(h=h, k=(rate / h) ** 2)
    phase = error_budget([motion_of(xml, seconds, qpos=[0.1])], rows=[], settings=PLAIN).phases[0]
    kept = left ** (4 * np.arange(1, 101))
    lost = np.asarray(np.diff(kept, prepend=1.0), np.float64)
    expected = find_drift(lost)
    # A window sees its peaks where a step falls: cos^2 of half a step off, at most.
    assert phase.energy_drift == pytest.approx(expected, rel=np.sin(rate / 2) ** 2)
    assert phase.energy_drift < -0.1
    assert judge(error_budget([motion_of(xml, seconds, qpos=[0.1])], rows=[])).word == "inaccurate"


@pytest.mark.parametrize("damping", [2000.0, 3000.0])
def test_a_damper_that_rk4_cannot_take_is_no_fault_of_the_run(damping: float) -> None:
    """At half a step of 4 ms the rate times h is 4 and 6; RK4 is stable up to 2.79."""
    budget = error_budget([motion_of(DAMPED.format(damping=damping), 1.0)], rows=[])
    assert np.isnan(budget.phases[0].energy_rk4).all()
    assert judge(budget).word == "ok"


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        (np.full(90, 0.01), 0.9),
        (np.append(np.full(3, -0.1), np.zeros(87)), -0.3),
        (np.append(np.zeros(87), np.full(3, 0.1)), 0.03),
        (np.diff(0.2 * np.sin(np.arange(91))), 0.0),
        (np.diff(0.2 * np.cos(np.arange(91))), 0.0),
        (np.append(np.zeros(43), np.append(0.3, np.zeros(46))), 0.3),
        (np.full(2, 0.1), 0.2),
    ],
    ids=["steady", "early", "late", "swings", "swings from a peak", "in the middle", "of two"],
)
def test_a_drift_is_what_stays(parts: np.ndarray, expected: float) -> None:
    # A mean of 30 of what swings by .2, a radian a window, is at most .2 / (30 sin .5).
    assert find_drift(parts) == pytest.approx(expected, abs=1.5 * 2 * 0.2 / (30 * np.sin(0.5)))


def test_what_slack_forgives_is_taken_off_the_next_window() -> None:
    """An impact takes 5 J at the end of a window of the run, a step later in the reference."""
    ends, around = np.array([5.0, 5.0]), np.array([[10.0, 10.0, 5.0], [5.0, 7.0, 7.0]])
    found = energy_defects(ends, around)
    np.testing.assert_array_equal(found, [[0, -5], [0, -2]])
    np.testing.assert_array_equal(settle_defects(np.array([[0, -5.0], [2, 0]])), [0, 0])
    np.testing.assert_array_equal(settle_defects(np.array([[0, -5.0], [7, 0]])), [0, 2])
    np.testing.assert_array_equal(settle_defects(np.array([[0, -5.0], [-2, 0]])), [0, -2])


def test_no_gain_hides_the_loss_of_another_seed() -> None:
    """Of seeds that drift to both sides, as hail does, the mean of amounts counts."""
    phase = error_budget([motion_of(PENDULUM.format(h=0.01), 0.1)], rows=[]).phases[0]
    both = replace(phase, energy=np.array([0.2, -0.1, 0.0]), energy_rk4=np.full(3, np.nan))
    assert both.energy_drift == pytest.approx(0.1)
    assert replace(both, energy=-both.energy).energy_drift == pytest.approx(-0.1)
