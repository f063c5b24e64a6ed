"""Energy in free motion: closed forms, integrators told apart, damping told, inertias named."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from contactlab.judge.limits import LIMITS
from contactlab.schema.check_report import CheckReport, CheckResult, Measure

Checked = Callable[..., CheckReport]
One = Callable[..., CheckResult]
Values = Callable[[CheckResult, str], Mapping[str | None, float | None]]
Missed = Callable[[CheckResult], list[Measure]]

DRIFT = LIMITS["energy_drift"].value or 0.0
MODELS = Path(__file__).parent / "free_motion"
PUMPED = (MODELS / "pumped.xml").read_text(encoding="utf-8")
ARM = (MODELS / "arm.xml").read_text(encoding="utf-8")
# Moments 1, 1, 3: no body's; the compiler is told to put up with it.
TWISTED = (MODELS / "twisted.xml").read_text(encoding="utf-8")


def arm(integrator: str, damping: float) -> str:
    return ARM.replace("INTEGRATOR", integrator).replace("DAMPING", f"{damping:g}")


SPRUNG = (MODELS / "sprung.xml").read_text(encoding="utf-8")
CHAIN = (MODELS / "chain.xml").read_text(encoding="utf-8")


@pytest.mark.long
def test_a_sprung_chain_keeps_its_energy_to_the_derived_order(one: One, values: Values) -> None:
    """Slides along one line have a constant mass matrix, where semi-implicit steps are symplectic.

    They keep E - h v' K x / 2 + O(h^2), which is E at the start, where x is 0: E stays within
    h |v' K x| / 2 of that, and |v' K x| <= w E for modes of frequencies up to w. With masses 2, 1,
    3 kg and springs 200, 50 N/m, w^2 < 200 (1/2 + 1) + 50 (1 + 1/3) = 367, since the trace bounds
    the largest eigenvalue. The next order is smaller by h w / 2 = 2 %.
    """
    found = one(SPRUNG.format(integrator="Euler"), "free_motion")
    for timestep in (2e-3, 1e-3, 5e-4):
        name = f"Euler at {timestep * 1e3:g} ms"
        drift = values(found, "energy_drift")[name]
        assert drift is not None
        # A change over 5 s, per second.
        assert drift <= timestep * 367**0.5 / 2 * 1.05 / 5
    most = values(found, "energy_deviation_max")["Euler at 2 ms"]
    assert most is not None
    assert 0 < most <= 2e-3 * 367**0.5 / 2 * 1.05


@pytest.mark.long
def test_a_floating_chain_moves_its_joints(one: One, values: Values, missed: Missed) -> None:
    """It neither falls, which would hide the drift of its joints, nor rests."""
    found = one(CHAIN.format(integrator="Euler"), "free_motion")
    assert {each.name for each in missed(found)} >= {"energy_drift"}
    assert any("2.5 rad/s" in note and "gravity too" in note for note in found.notes)
    # Errors of next order in h are small at the times that are compared.
    assert values(found, "convergence_order")["Euler"] == pytest.approx(1, abs=0.1)
    # At 2 ms, RK4 leaves nothing but rounding.
    long = one(CHAIN.format(integrator="RK4"), "free_motion", "timestep=0.02")
    assert values(long, "convergence_order")["RK4"] == pytest.approx(4, abs=0.3)
    rk4 = values(found, "energy_drift")["RK4 at 2 ms"]
    assert rk4 is not None
    assert rk4 < 1e-6


@pytest.mark.long
def test_a_planted_energy_gain_is_an_error(one: One, missed: Missed) -> None:
    """A damper of negative coefficient b pumps b v^2 into a lone hinge.

    Its speed grows as exp(b t / I), with I = 1 kg m^2 and b = 0.01 N m s by a factor of
    exp(0.05) in 5 s: its energy by 10.5 % of the start, or 9.5 % of the peak, 1.9 % a second.
    """
    pumped = PUMPED.replace("DAMPING", "-0.01")
    found = one(pumped, "free_motion")
    assert found.verdict == "fail"
    (gain,) = missed(found)
    assert gain.name == "energy_gain"
    # Per peak of the undamped run, which is the start.
    assert gain.value == pytest.approx((np.exp(0.1) - 1) / 5, rel=1e-3)
    assert one(PUMPED.replace("DAMPING", "0.01"), "free_motion").verdict == "pass"


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_the_integrator_is_to_blame(
    checked: Checked, values: Values, missed: Missed, integrator: str
) -> None:
    report = checked("free_arm", "free_motion", assign=(f"integrator={integrator}",))
    (found,) = report.checks
    assert ("energy_drift", f"{integrator} at 2 ms") in [
        (each.name, each.of) for each in missed(found)
    ]
    rk4 = values(found, "energy_drift")["RK4 at 2 ms"]
    assert rk4 is not None
    assert rk4 < DRIFT
    (remedy,) = report.remedies
    assert remedy.settings == {"integrator": "RK4"}
    assert remedy.edits == ()  # The model has RK4 as it is written.
    assert {"energy_drift"} <= set(remedy.mends)


@pytest.mark.long
def test_damping_takes_what_the_integrator_gains(one: One, values: Values, missed: Missed) -> None:
    """A drift that the model's own damping hides is a warning, and no error."""
    found = one(arm("Euler", 0.05), "free_motion")
    assert found.verdict == "warning"
    assert {each.name for each in missed(found)} == {"energy_drift"}
    gain = values(found, "energy_gain")["Euler at 2 ms, damping on"]
    assert gain is not None
    assert gain < 0
    free = one(arm("Euler", 0), "free_motion")
    assert list(values(free, "energy_gain")) == ["Euler at 2 ms"]


@pytest.mark.long
def test_an_impossible_inertia_is_named_and_no_integrator_blamed(one: One, missed: Missed) -> None:
    found = one(TWISTED, "free_motion")
    assert found.verdict == "fail"
    assert [each.of for each in missed(found) if each.name.startswith("inertia")] == ["rotor"]
    assert any("rotor" in each and "0.01 + 0.01 < 0.03" in each for each in found.notes)


@pytest.mark.parametrize(
    ("model", "reason"),
    [
        ("isotropy", "forces from outside"),
        ("<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>", "nothing that moves"),
    ],
)
def test_where_nothing_can_be_said(one: One, model: str, reason: str) -> None:
    found = one(model, "free_motion")
    assert found.verdict == "not applicable"
    assert reason in found.reason


@pytest.mark.long
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


@pytest.mark.long
def test_each_tree_is_judged_by_itself(one: One, values: Values, missed: Missed) -> None:
    """A heavy ball has far more energy than an arm, and leaves the arm's drift as it is."""
    ball = '<body name="ball" pos="0 0 9"><freejoint/><geom size=".2" mass="100"/></body>'
    beside = one(arm("Euler", 0).replace("</worldbody>", f"{ball}</worldbody>"), "free_motion")
    drifts = values(beside, "energy_drift")
    # A ball's inertia is the same about all axes: it spins at a constant rate.
    assert drifts["ball, Euler at 2 ms"] == pytest.approx(0, abs=1e-12)
    assert {each.of for each in missed(beside)} == {"upper, Euler at 2 ms"}
