"""The closed-form cases of the catalogue: what must hold holds, and every control fails.

Numbers that a case is held against stand in its sweep, with where they come from. Here the sweeps
run, and the pairs of a good and a bad configuration land on their sides.
"""

from collections.abc import Callable
from math import atan, degrees
from pathlib import Path
from typing import Any

import pytest
from tests.studies.stability.conftest import FOLDER, UNCHECKED, swept

pytestmark = pytest.mark.long

CASES = [
    "free_fall",
    "incline",
    "isotropy",
    "ladder",
    "rest_penetration",
    "restitution",
    "roll_down",
    "roll_friction",
    "slide_directions",
    "slide_to_roll",
    "spin_down",
]
LONG_CASES = ("oblique_impact",)

Rows = list[dict[str, Any]]
Case = Callable[[str], Rows]


def picked(rows: Rows, **values: Any) -> Rows:
    """Return the runs with these values; dots in axis names are written as two underscores."""
    wanted = {name.replace("__", "."): value for name, value in values.items()}
    found = [row for row in rows if all(row[name] == value for name, value in wanted.items())]
    assert found
    return found


def worst(rows: Rows, metric: str = "oracle_error") -> float:
    return max(abs(row[metric]) for row in rows)


def least(rows: Rows, metric: str = "oracle_error") -> float:
    return min(abs(row[metric]) for row in rows)


@pytest.mark.parametrize(
    "name", [*CASES, *(pytest.param(name, marks=pytest.mark.night) for name in LONG_CASES)]
)
def test_cases_come_out_as_expected(case: Case, name: str) -> None:
    rows = case(name)
    unmet = [(row["run_id"], row["label"]) for row in rows if row["expectation_met"] is False]
    assert unmet == []
    met = [row["label"] for row in rows if row["expectation_met"]]
    assert "stable" in met
    assert set(met) - {"stable"}


@pytest.mark.night
@pytest.mark.parametrize("name", UNCHECKED)
def test_checks_change_no_outcome(case: Case, tmp_path: Path, name: str) -> None:
    fields = "run_id", "label", "expectation_met"
    whole, unchecked = swept(FOLDER / f"{name}.yaml", tmp_path / "store"), case(name)
    assert [[row[field] for field in fields] for row in whole] == [
        [row[field] for field in fields] for row in unchecked
    ]


def test_direct_solref_gives_the_restitution_asked_for_and_the_implicit_step_less(
    case: Case,
) -> None:
    bouncy = picked(case("restitution"), solref="-160000 -144.7")
    good, bad = (
        [row["restitution_measured"] for row in picked(bouncy, integrator=integrator)]
        for integrator in ("Euler", "discrete")
    )
    assert sum(good) / len(good) == pytest.approx(0.6, abs=0.02)
    assert sum(bad) / len(bad) < 0.6 - 0.02


def test_only_steps_too_long_gain_energy_or_sink_in(case: Case) -> None:
    rows = case("restitution")
    good = picked(rows, timestep=5e-4, integrator="Euler")
    assert worst(good, "energy_gain") < 0.01
    assert worst(good, "penetration_max") < 0.025
    assert least(picked(rows, timestep=4e-3), "energy_gain") > 0.01
    assert least(picked(rows, timestep=2e-2), "penetration_max") > 0.05


def test_slides_between_a_pyramids_edges_are_too_long(case: Case) -> None:
    rows = picked(case("slide_directions"), direction=45.0, timestep=2e-3)
    assert worst(picked(rows, cone="elliptic")) < 0.01
    assert least(picked(rows, cone="pyramidal")) > 0.3


def test_boxes_stick_only_with_impratio_and_a_short_time_constant(case: Case) -> None:
    rows = picked(case("incline"), tilt=21.565, direction=0.0)
    good = picked(rows, impratio=10, solref__timeconst=0.005)
    bad = picked(rows, cone="pyramidal", solref__timeconst=0.02)
    assert worst(good, "creep_speed") < 1e-4
    assert least(bad, "creep_speed") > 1e-3


def test_boxes_slide_by_the_law_two_degrees_above_the_angle_of_friction(case: Case) -> None:
    rows = picked(case("incline"), tilt=28.565, rock=0.0)
    law = 0.081601
    assert worst(picked(rows, impratio=10)) < 0.01 * law
    assert least(picked(rows, cone="pyramidal", direction=45.0)) > 3 * law


@pytest.mark.parametrize("side", [-1, 1])
def test_the_angle_of_friction_parts_sticking_from_sliding(case: Case, side: int) -> None:
    """A tenth of what friction leaves at one degree above the angle tells the two apart."""
    angle = degrees(atan(0.5))
    good = [row for row in case("incline") if row["cone"] == "elliptic" and row["impratio"] == 10]
    shares = [row["oracle_measured"] for row in good if side * (row["tilt"] - angle) > 0]
    assert len(shares) >= 4 * 2
    assert (min(shares) > 0.004) if side > 0 else (max(shares) < 0.004)


def test_friction_is_isotropic_in_elliptic_cones_only(case: Case) -> None:
    rows = case("isotropy")
    pushed = picked(rows, push=7.3575)
    assert len({row["direction"] for row in pushed}) == 16
    assert worst(picked(pushed, cone="elliptic")) < 0.01 / 3
    assert worst(picked(pushed, cone="pyramidal")) > 0.1
    held = picked(rows, push=1.962, cone="elliptic")
    assert worst(picked(held, impratio=100), "final_speed") < 5e-5
    assert least(picked(held, impratio=1), "final_speed") > 5e-5


def test_rolling_friction_needs_an_elliptic_cone(case: Case) -> None:
    rows = picked(case("roll_friction"), friction__roll=1e-3, condim=6, direction=0.0)
    assert worst(picked(rows, cone="elliptic")) < 0.01
    assert least(picked(rows, cone="pyramidal")) > 0.4


def test_small_rolling_friction_needs_impratio(case: Case) -> None:
    rows = picked(case("roll_friction"), friction__roll=1e-4, cone="elliptic", direction=0.0)
    assert worst(picked(rows, impratio=10)) < 0.01
    assert least(picked(rows, impratio=1)) > 0.5


@pytest.mark.night
def test_impacts_follow_coulomb_where_friction_has_its_own_reference(case: Case) -> None:
    rows = picked(case("oblique_impact"), cone="elliptic")
    referred = picked(rows, **{"pair_solreffriction[impact]": "-1 -320"}, restitution=0.6)
    assert worst(picked(referred, friction__slide=0.1)) < 0.03
    assert worst(picked(referred, friction__slide=0.3)) < 0.06
    bad = picked(case("oblique_impact"), cone="pyramidal", friction__slide=0.6, restitution=0.9)
    assert least(picked(bad, angle=45.0)) > 0.5


def test_rest_penetration_is_exact_in_elliptic_cones(case: Case) -> None:
    rows = case("rest_penetration")
    assert worst(picked(rows, cone="elliptic")) < 1e-9
    assert least(picked(rows, cone="pyramidal")) > 0.1


def test_free_fall_is_exact_without_a_medium(case: Case) -> None:
    rows = case("free_fall")
    assert worst(picked(rows, density=0.0)) < 1e-9
    assert least(picked(rows, density=1.2)) > 0.1


def test_ladders_fall_beyond_twice_the_friction(case: Case) -> None:
    rows = picked(case("ladder"), impratio=10)
    assert worst(picked(rows, angle=31.0), "oracle_measured") < 0.1
    assert least(picked(rows, angle=31.5), "oracle_measured") > 0.9
