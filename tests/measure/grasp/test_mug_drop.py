"""A mug dropped onto fingers: where it ends, and how deep it sinks on the way."""

from collections.abc import Callable
from typing import Any

import pytest

Run = Callable[..., Any]
Rows = list[dict[str, Any]]
SPEED = (2 * 9.81 * 0.3) ** 0.5
FIRM = (0.99, 0.999, 0.001, 0.5, 2.0)


@pytest.mark.long
@pytest.mark.parametrize(
    ("opening", "fall"),
    # On the fingers it has fallen by the clearance; between them, by their 50 mm more.
    [(0.0, 0.3), (0.07, 0.3), (0.09, 0.35)],
)
def test_where_it_ends(opening: float, fall: float, measured: Run) -> None:
    run = measured("mug_drop", opening=opening, solref=(0.005, 1.0))
    assert run.labels == ["stable"]
    # Resting contacts yield by hundredths of a millimetre.
    assert run.metrics["drop"] == pytest.approx(fall, abs=2e-4)
    assert run.metrics["energy_gain"] < 1e-6


@pytest.mark.long
@pytest.mark.parametrize("timeconst", [0.01, 0.02])
def test_depth_at_impact_is_that_of_the_oscillator(timeconst: float, measured: Run) -> None:
    """It is v tc / e for dr = 1 and impedance near 1, whatever the mass and however many points.

    Gravity adds g tc^2 / e at most, 1.4 mm at 20 ms; a step of 0.1 ms sees the peak to w h = 1 %.
    """
    run = measured("mug_drop", opening=0.0, solref=(timeconst, 1.0), solimp=FIRM, timestep=1e-4)
    depth = run.metrics["penetration_max"]
    least = SPEED * timeconst / 2.718282
    assert 0.98 * least < depth < 1.02 * (least + 9.81 * timeconst**2 / 2.718282)


@pytest.mark.long
def test_a_soft_contact_lets_the_fingers_in_at_any_timestep(measured: Run) -> None:
    for timestep in (5e-4, 2e-3, 4e-3):
        soft = measured("mug_drop", solref=(0.02, 1.0), timestep=timestep)
        assert {"tunneling", "deep_penetration"} & set(soft.labels)
        assert soft.metrics["drop"] > 0.31
        assert soft.metrics["penetration_steady"] > 4e-3


def test_every_contact_is_recorded(measured: Run) -> None:
    """Twelve walls and a bottom stand on the floor in four points each: 52."""
    run = measured("mug_drop", opening=0.09, solref=(0.005, 1.0))
    floor = run.trace.pairs[2]
    assert run.metrics["contacts_max"] == 52
    assert run.metrics["contacts_cut"] == 0
    assert floor.touching[0].sum(axis=1).max() == 52
    assert run.metrics["ungraded_contacts"] == 0


@pytest.mark.night
def test_the_sweep_maps_what_is_stable(swept: Callable[..., Rows]) -> None:
    # The labels that are expected need no second pass, which takes most of the time.
    rows = swept("mug-drop", ["checks=none"])
    assert [row["expectation_reason"] for row in rows if row["expectation_met"] is False] == []
    assert all(row["label"] for row in rows)
    assert {row["solref"] for row in rows if row["label"] == "stable"} == {"0.005 1"}
    for row in rows:
        gains = row["energy_gain"] > 0.01
        # Only a contact that is damped too little, at a step of 10 ms, throws the mug up.
        assert gains == (row["solref"] == "0.02 0.2" and row["timestep"] == 1e-2)
