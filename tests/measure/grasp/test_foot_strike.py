"""A foot striking the ground: what it is given, how deep it stands, and what breaks it."""

from collections.abc import Callable
from typing import Any

import pytest

from contactlab.contact.contact_laws import rest_penetration

Run = Callable[..., Any]
Rows = list[dict[str, Any]]
FOOT, TRUNK, GRAVITY = 1.0, 10.0, 9.81
SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)


@pytest.mark.parametrize("timestep", [1e-3, 2e-3, 4e-3])
@pytest.mark.parametrize("timeconst", [0.02, 0.01])
def test_it_rests_as_deep_as_the_law_says(timeconst: float, timestep: float, measured: Run) -> None:
    """Its r = (F/4) A (1 - d) (dw tc)^2 / d^2, with the inverse mass A that the engine compiled."""
    run = measured("foot_strike", solref=(timeconst, 1.0), timestep=timestep)
    inverse = float(run.prepared.model.body("foot").invweight0[0])
    assert inverse == pytest.approx((1 / FOOT + 2 / (FOOT + TRUNK)) / 3, rel=1e-9)
    load = (FOOT + TRUNK) * GRAVITY / 4
    expected = float(rest_penetration(load, inverse, (timeconst, 1.0), SOLIMP))
    # exp(-0.45 22 1.4) = 1e-6 of the trunk's swing is left, and a swing is a few weights.
    assert run.metrics["penetration_steady"] == pytest.approx(expected, rel=1e-4)
    assert run.metrics["oracle_error"] < 1e-4
    assert run.labels == ["stable"]


@pytest.mark.parametrize("speed", [0.0, 0.5])
@pytest.mark.parametrize("drop_height", [0.05, 0.1])
def test_the_ground_gives_back_what_gravity_gave(
    drop_height: float, speed: float, measured: Run
) -> None:
    """From rest to rest: the impulse is (m + M) g T, whatever happened in between."""
    run = measured("foot_strike", drop_height=drop_height, speed=speed)
    # The swing that is left at the end moves 10 kg at some 1e-6 m/s.
    assert run.metrics["normal_impulse"] == pytest.approx(11 * GRAVITY * 2, rel=1e-6)
    assert run.metrics["energy_gain"] < 1e-9


def test_a_step_lengthens_a_time_constant_below_two_of_it(measured: Run) -> None:
    """5 ms at steps of 4 ms is 8 ms: 2.56 times as deep, but for d, which grows with depth."""
    run = measured("foot_strike", solref=(0.005, 1.0), timestep=4e-3)
    inverse = float(run.prepared.model.body("foot").invweight0[0])
    load = (FOOT + TRUNK) * GRAVITY / 4
    made = float(rest_penetration(load, inverse, (0.008, 1.0), SOLIMP))
    assert run.metrics["penetration_steady"] == pytest.approx(made, rel=1e-4)
    assert run.labels == ["oracle_miss"]


def test_a_contact_too_fast_for_the_step_throws_the_foot_up(measured: Run) -> None:
    """The step h is 4 tc dr."""
    run = measured("foot_strike", solref=(0.02, 0.05), timestep=4e-3)
    assert "energy_injection" in run.labels
    assert run.metrics["energy_gain"] > 1


@pytest.mark.long
def test_the_sweep_comes_out(swept: Callable[..., Rows]) -> None:
    rows = swept("foot-strike")
    assert [row["expectation_reason"] for row in rows if row["expectation_met"] is False] == []
    assert {"stable", "chatter", "energy_injection", "oracle_miss"} <= {r["label"] for r in rows}
