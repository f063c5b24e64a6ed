"""Energy in free motion: closed forms, integrators told apart, damping told, inertias named."""

from collections.abc import Callable, Mapping

import pytest

from contactlab.schema.check_report import CheckResult, Measure
from contactlab.studies.check.free_motion_check import DRIFT

One = Callable[..., CheckResult]
Values = Callable[[CheckResult, str], Mapping[str | None, float | None]]
Missed = Callable[[CheckResult], list[Measure]]

BALL = """<mujoco><worldbody>
  <geom type="plane" size="1 1 .1"/>
  <body pos="0 0 1"><freejoint/><geom size=".05"/></body>
</worldbody></mujoco>"""
ARM = """<mujoco>
  <option timestep="0.002" integrator="INTEGRATOR"/>
  <default><joint axis="0 1 0" damping="DAMPING"/></default>
  <worldbody>
    <body name="upper">
      <joint name="shoulder"/>
      <geom type="capsule" fromto="0 0 0 .5 0 0" size=".03" mass="1"/>
      <body name="lower" pos=".5 0 0">
        <joint name="elbow"/>
        <geom type="capsule" fromto="0 0 0 .5 0 0" size=".03" mass="1"/>
      </body>
    </body>
  </worldbody>
</mujoco>"""
# Moments 1, 1, 3: no body's; the compiler is told to put up with it.
TWISTED = """<mujoco>
  <compiler balanceinertia="true"/>
  <worldbody>
    <body name="rotor" pos="0 0 1">
      <joint axis="0 1 0"/>
      <inertial pos=".3 0 0" mass="1" diaginertia=".01 .01 .03"/>
    </body>
  </worldbody>
</mujoco>"""
STILL = """<mujoco><worldbody>
  <body><joint type="slide" axis="1 0 0"/><geom size=".05"/></body>
</worldbody></mujoco>"""


def arm(integrator: str, damping: float) -> str:
    return ARM.replace("INTEGRATOR", integrator).replace("DAMPING", f"{damping:g}")


def test_a_falling_ball_loses_what_the_recursion_says(one: One, values: Values) -> None:
    """After k semi-implicit steps E - E0 = -m g^2 h^2 k / 2, and K = m g^2 h^2 k^2 / 2."""
    found = one(BALL, "free_motion")
    last = 2499  # The last of 2500 rows is the state before the last step.
    for timestep, rows in ((2, last), (1, 2 * 2500 - 1), (0.5, 4 * 2500 - 1)):
        drift = values(found, "energy_drift")[f"Euler at {timestep:g} ms"]
        # A sum of 1e4 rounded steps is good to 1e-12.
        assert drift == pytest.approx(1 / rows / (rows * timestep * 1e-3), rel=1e-9)
    assert found.verdict == "pass"
    # The error of place is g h t / 2, of first order exactly; RK4 is exact.
    assert values(found, "convergence_order")["Euler"] == pytest.approx(1, abs=1e-6)
    assert values(found, "convergence_order")["RK4"] is None


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_the_integrator_is_to_blame(
    one: One, values: Values, missed: Missed, integrator: str
) -> None:
    found = one("free_arm", "free_motion", f"integrator={integrator}")
    assert [(each.name, each.of) for each in missed(found)] == [
        ("energy_drift", f"{integrator} at 2 ms")
    ]
    rk4 = values(found, "energy_drift")["RK4 at 2 ms"]
    assert rk4 is not None
    assert rk4 < DRIFT
    assert "RK4 at 2 ms meets it" in found.reason
    assert found.changes[0].lines == ('<option integrator="RK4"/>',)
    assert found.changes[0].cures
    # Errors of next order in h are small at the times that are compared.
    orders = values(found, "convergence_order")
    assert orders[integrator] == pytest.approx(1, abs=0.1)
    assert orders["RK4"] == pytest.approx(4, abs=0.3)


def test_a_change_that_cures_does(one: One) -> None:
    settings = one("free_arm", "free_motion", "integrator=Euler").changes[0].settings
    found = one("free_arm", "free_motion", *(f"{key}={each}" for key, each in settings.items()))
    assert found.verdict == "pass"
    assert found.changes == ()


def test_damping_is_told_from_drift(one: One, values: Values) -> None:
    """What the dampers took and what the energy lost differ by the integrator's error alone."""
    found = one(arm("RK4", 0.05), "free_motion")
    assert found.verdict == "pass"
    name = "RK4 at 2 ms, damping on"
    change, work, rest = (
        values(found, each)[name] or 0.0
        for each in ("energy_change", "work_of_dampers", "energy_unexplained")
    )
    assert change < -0.01
    assert change == pytest.approx(work + rest, rel=1e-9)
    # The trapezoidal rule errs by h^2 / 12 of the power's slope, which is at most some W / 10 ms:
    # less than 1e-3 of a work that is shared out over 5 s.
    assert abs(rest) < 1e-3 * abs(work)


def test_damping_hides_drift_and_is_said_to(one: One) -> None:
    found = one(arm("Euler", 0.05), "free_motion")
    assert found.verdict == "fail"
    assert "with the model's own damping on, the energy falls by" in found.reason
    assert found.reason.endswith("which hides that drift")
    free = one(arm("Euler", 0), "free_motion")
    assert "damping" not in free.reason
    assert not any("damping" in str(each.of) for each in free.measures)


def test_an_impossible_inertia_is_named_and_no_integrator_blamed(one: One, missed: Missed) -> None:
    found = one(TWISTED, "free_motion")
    assert found.verdict == "fail"
    assert [each.of for each in missed(found) if each.name.startswith("inertia")] == ["rotor"]
    assert found.reason.startswith("the inertia of 'rotor' belongs to no physical body")
    assert any("rotor" in each and "0.01 + 0.01 < 0.03" in each for each in found.notes)
    assert found.changes == ()


@pytest.mark.parametrize(
    ("model", "reason"),
    [
        (STILL, "nothing moves by itself"),
        ("isotropy", "forces from outside"),
        ("<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>", "nothing that moves"),
    ],
)
def test_where_nothing_can_be_said(one: One, model: str, reason: str) -> None:
    found = one(model, "free_motion")
    assert found.verdict == "not applicable"
    assert reason in found.reason


def test_compensated_gravity_is_switched_off(one: One, values: Values) -> None:
    held = arm("RK4", 0).replace('name="lower"', 'name="lower" gravcomp="1"')
    held = held.replace('name="upper"', 'name="upper" gravcomp="1"')
    found, bare = one(held, "free_motion"), one(arm("RK4", 0), "free_motion")
    assert found.verdict == "pass"
    assert values(found, "energy_drift") == values(bare, "energy_drift")


def test_a_motion_that_diverges_fails(one: One, values: Values) -> None:
    """At 20 ms Euler's step blows the arm up, and RK4's does not."""
    found = one("free_arm", "free_motion", "integrator=Euler", "timestep=0.02")
    assert found.verdict == "fail"
    assert values(found, "energy_drift")["Euler at 20 ms"] is None
    assert "the run with Euler at 20 ms is not complete: the engine stopped" in found.reason
    assert found.changes[0].lines == ('<option integrator="RK4"/>',)


def test_a_body_that_falls_beside_an_arm_hides_nothing(one: One, values: Values) -> None:
    """A ball of 100 kg has 5000 times the arm's energy, and leaves the arm's drift as it is."""
    ball = '<body name="ball" pos="0 0 9"><freejoint/><geom size=".2" mass="100"/></body>'
    alone = one(arm("Euler", 0), "free_motion")
    beside = one(arm("Euler", 0).replace("</worldbody>", f"{ball}</worldbody>"), "free_motion")
    assert any("'ball', flying by itself" in each for each in beside.notes)
    for motion, drift in values(alone, "energy_drift").items():
        # The seed moves the arm first, and so alike. Sums of 1e5 J keep the arm's joules to 1e-10.
        assert values(beside, "energy_drift")[motion] == pytest.approx(drift, rel=1e-3, abs=1e-8)
