"""Small models that escaped an earlier form of the measure, each with what it reads now.

Some of them stay hard: docs/theory/error-budget.md.
"""

import numpy as np
import pytest
from tests.budget_motions import motion_of

from contactlab.budget import PhaseBudget, error_budget, judge

CART = """<mujoco><option timestep="{h}"/><worldbody><body name="cart" pos="0 0 .1">
<joint name="rail" type="slide" axis="1 0 0"/><geom type="box" size=".1 .1 .1" mass="1"/></body>
</worldbody><actuator>{motor}</actuator></mujoco>"""
SERVO = '<velocity joint="rail" kv="1000" forcerange="-{force} {force}"/>'
BOUNCE = """<mujoco><option timestep=".01" integrator="{integrator}"/><worldbody>
<geom type="plane" size="0 0 1"/><body name="ball" pos="0 0 .6">
<joint type="slide" axis="0 0 1"/><geom size=".1" mass="1" solref="-30000 0"
solimp=".99 .99 .001" priority="1"/></body></worldbody></mujoco>"""
SPRING = """<mujoco><option timestep=".01" gravity="0 0 0" integrator="RK4"/><worldbody>
<body name="bob"><joint type="slide" axis="1 0 0" stiffness="22500"/><geom size=".1" mass="1"/>
</body></worldbody></mujoco>"""
LINK = """<body pos="{} 0 {}"><joint axis="0 1 0" damping="1e-5"/><geom type="capsule" size=".005"
fromto="0 0 0 .05 0 0" mass=".002" contype="0" conaffinity="0"/>"""
CHAIN = (
    '<mujoco><option timestep=".002"/><worldbody>'
    + LINK.format(0, 2)
    + LINK.format(0.05, 0) * 9
    + "</body>" * 10
    + "</worldbody></mujoco>"
)


def rattled(force: float, step: float) -> PhaseBudget:
    """Return the budget of a servo that turns its force about at each step, asked for .5 m/s."""
    xml = CART.format(h=step, motor=SERVO.format(force=force))
    controls = np.full((1, round(2 / step), 1), 0.5)
    return error_budget([motion_of(xml, 2.0, controls=controls)], rows=[]).phases[0]


@pytest.mark.parametrize(
    ("force", "step", "share"), [(5, 0.004, 0.128), (5, 0.005, 0.241), (1, 0.004, 0.0378)]
)
def test_a_servo_that_rattles_at_its_limit(force: float, step: float, share: float) -> None:
    phase = rattled(force, step)
    assert phase.run.error == pytest.approx(share, rel=0.02)
    # The run's velocity goes to and fro at every step, the reference's does not.
    assert phase.excess_path.max() > 0.5


@pytest.mark.parametrize("seconds", [0.5, 2.0])
def test_a_motor_that_is_told_to_flip_has_no_error(seconds: float) -> None:
    xml = CART.format(h=0.005, motor='<motor joint="rail"/>')
    controls = np.zeros((1, round(seconds / 0.005), 1))
    controls[0, :80, 0] = 5 * (-1.0) ** np.arange(80)
    assert error_budget([motion_of(xml, seconds, controls=controls)], rows=[]).error < 1e-6


@pytest.mark.parametrize(
    ("xml", "seconds", "qpos", "energy", "word"),
    [
        (BOUNCE.format(integrator="Euler"), 3.0, None, 2.450, "inaccurate"),
        (BOUNCE.format(integrator="RK4"), 3.0, None, -0.551, "inaccurate"),
        (SPRING, 2.0, [0.1], -1.0, "inaccurate"),
        (CHAIN, 2.0, None, 0.833, "inaccurate"),
    ],
    ids=["bounces that gain", "bounces under RK4", "a spring under RK4", "a chain"],
)
def test_energy_that_comes_or_goes(
    xml: str, seconds: float, qpos: list[float] | None, energy: float, word: str
) -> None:
    budget = error_budget([motion_of(xml, seconds, qpos=qpos)], rows=[])
    assert budget.phases[0].energy_drift == pytest.approx(energy, rel=0.03)
    assert judge(budget).word == word
