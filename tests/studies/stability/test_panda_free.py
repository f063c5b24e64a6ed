"""The Panda in free motion: what drifts, and what damping and limits hide of it."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab import resources

Case = Callable[..., list[dict[str, Any]]]
FREE = {"damper": False, "limit": False}
EULER = ("Euler", "implicitfast")


def test_it_swings_with_the_energy_that_was_measured_of_the_real_one() -> None:
    """Known: 92.6 J at most, soon after the start, where no step of 2 ms or less shows."""
    model = mujoco.MjModel.from_xml_path(str(resources.MODELS / "panda_free" / "scene.xml"))
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    kinetic: list[float] = []
    for _ in range(500):
        mujoco.mj_step(model, data)
        kinetic.append(float(data.energy[1]))
    assert max(kinetic) == pytest.approx(92.6, abs=0.05)
    assert 0.5 < np.argmax(kinetic) * model.opt.timestep < 0.7


@pytest.mark.night
def test_what_is_expected_comes_out(case: Case, assert_expected: Any) -> None:
    assert_expected(case("panda_free"))


@pytest.mark.night
def test_only_rk4_keeps_what_practice_asks_for(case: Case) -> None:
    """0.1 % of the peak kinetic energy a second; known at 2 ms: RK4 1e-8, Euler 1 %."""
    for row in case("panda_free", integrator="RK4", **FREE):
        assert abs(row["energy_drift"]) < 1e-6
    for integrator in EULER:
        for row in case("panda_free", integrator=integrator, timestep=2e-3, **FREE):
            assert row["energy_drift"] > 1e-3


@pytest.mark.night
def test_euler_s_gain_grows_with_the_step(case: Case) -> None:
    """To first order by 4 from 0.5 to 2 ms; the motion is chaotic, so that 2 is asked for."""
    for integrator in EULER:
        for seed in (0, 1):
            where = {"integrator": integrator, "seed": seed, **FREE}
            (short,) = case("panda_free", timestep=5e-4, **where)
            (long,) = case("panda_free", timestep=2e-3, **where)
            assert long["energy_gain"] > 2 * short["energy_gain"]


@pytest.mark.parametrize("hiding", ["damper", "limit"])
@pytest.mark.night
def test_what_dissipates_hides_the_drift(case: Case, hiding: str) -> None:
    """Runs of all integrators lie within 2 % of each other, drifting ones among them."""
    drifts = [row["energy_drift"] for row in case("panda_free", **{**FREE, hiding: True})]
    assert len(drifts) == 16
    assert max(drifts) < -0.15
    assert np.ptp(drifts) < 0.02 * np.abs(drifts).max()


@pytest.mark.night
def test_damping_takes_what_it_took_of_the_real_one(case: Case) -> None:
    """Known: 27 % of the peak kinetic energy a second at 1 N m s/rad."""
    for row in case("panda_free", damper=True):
        assert row["energy_drift"] == pytest.approx(-0.27, abs=0.005)


@pytest.mark.night
def test_a_little_dry_friction_shows(planted: Case) -> None:
    """0.01 N m in seven joints at a few rad/s take 0.2 W, twice what practice accepts of 92 J."""
    rows = planted(
        "panda_free",
        'damping="1"',
        'damping="1" frictionloss="0.01"',
        "integrator=RK4",
        "damper=false",
        "limit=false",
    )
    for row in rows:
        assert row["label"] == "oracle_miss"
        assert row["energy_drift"] < -1e-3
