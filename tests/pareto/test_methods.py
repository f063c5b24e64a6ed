"""Methods of a sweep: their orders, floors and which knobs matter, from planted laws."""

from collections.abc import Callable
from typing import Any

import pytest

from contactlab.pareto.configurations import (
    EvaluatedConfiguration,
    StoredRuns,
    find_insensitive_knobs,
    fix_insensitive_knobs,
    is_chaotic,
)
from contactlab.pareto.convergence import find_methods
from contactlab.schema.tradeoff_report import Method

Weigh = Callable[..., list[EvaluatedConfiguration]]
STEPS = [2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3, 8e-3]
KNOBS = ("timestep", "integrator", "cone")
FLOOR = 2e-3


def row(step: float, integrator: str, error: float, **more: Any) -> dict[str, Any]:
    more = {"cone": "elliptic", "time_median": 1e-6 / step, **more}
    return {"timestep": step, "integrator": integrator, "oracle_error": error, **more}


def one(found: list[Method], integrator: str) -> Method:
    (method,) = (each for each in found if each.configuration["integrator"] == integrator)
    return method


def test_each_integrator_has_the_order_of_its_error(weighed: Weigh) -> None:
    orders = {"Euler": 1, "RK4": 4}
    rows = [row(step, name, step**slope) for name, slope in orders.items() for step in STEPS]
    found = find_methods(weighed(rows, KNOBS), {"timestep": "s"}, is_modeling=True)
    assert [each.name for each in found] == ["Euler", "RK4"]
    for name, slope in orders.items():
        assert one(found, name).order.slope == pytest.approx(slope, abs=1e-9)
        assert one(found, name).floor is None


def test_a_single_method_is_named_by_the_swept_knobs(weighed: Weigh) -> None:
    """It may not be as the scene has it, since the runs with other values are left out."""
    rows = [row(step, "RK4", step**4) for step in STEPS]
    (found,) = find_methods(weighed(rows, KNOBS), {}, ["timestep", "cone"], is_modeling=False)
    assert found.name == "elliptic"
    (found,) = find_methods(weighed(rows, KNOBS), {}, ["timestep"], is_modeling=False)
    assert found.name == "as the scene has it"


def test_a_single_impact_takes_the_order_away(weighed: Weigh) -> None:
    rows = [row(step, "RK4", step**4, impacts=0) for step in STEPS]
    rows += [row(step, "Euler", step, impacts=int(step == STEPS[0])) for step in STEPS]
    found = find_methods(weighed(rows, KNOBS), {"timestep": "s"}, is_modeling=False)
    assert one(found, "RK4").order.slope == pytest.approx(4, abs=1e-9)
    assert one(found, "Euler").order.slope is None
    assert "one impact" in str(one(found, "Euler").order.reason)


def test_what_was_lost_or_clamped_is_no_point_of_a_line(weighed: Weigh) -> None:
    rows = [row(step, "Euler", step) for step in STEPS]
    rows[0] |= {"label": "diverged", "oracle_error": 1e9}
    rows[5] |= {"solref_clamped": 1.0, "oracle_error": 1e9}
    (found,) = find_methods(weighed(rows, KNOBS), {"timestep": "s"}, is_modeling=False)
    assert found.order.slope == pytest.approx(1, abs=1e-9)
    assert found.order.points == 4


def test_a_floor_holds_for_every_integrator_of_the_same_physics(weighed: Weigh) -> None:
    """RK4 has reached what Euler still comes down to, with a slope that is no order."""
    rows = [row(step, "RK4", FLOOR) for step in STEPS]
    rows += [row(step, "Euler", FLOOR + step) for step in STEPS]
    found = find_methods(weighed(rows, KNOBS), {"timestep": "s"}, is_modeling=True)
    floor = one(found, "RK4").floor
    assert floor is not None
    assert floor.error == FLOOR
    assert floor.points == len(STEPS)
    assert one(found, "Euler").order.slope is None
    assert "three times the floor" in str(one(found, "Euler").order.reason)
    other = [row(step, "Euler", step, cone="pyramidal") for step in STEPS]
    apart = find_methods(
        weighed(rows[: len(STEPS)] + other, KNOBS), {"timestep": "s"}, is_modeling=True
    )
    assert one(apart, "Euler").order.slope == pytest.approx(1, abs=1e-9)


def test_an_error_against_a_reference_has_no_floor(weighed: Weigh) -> None:
    rows = [row(step, "RK4", FLOOR) for step in STEPS]
    (found,) = find_methods(weighed(rows, KNOBS), {"timestep": "s"}, is_modeling=False)
    assert found.floor is None


def test_knobs_that_change_no_error_are_idle(weighed: Weigh) -> None:
    rows = [
        row(step, name, step if name == "Euler" else step**2, cone=cone)
        for step in STEPS
        for name in ("Euler", "RK4")
        for cone in ("pyramidal", "elliptic")
    ]
    found = weighed(rows, KNOBS)
    assert find_insensitive_knobs(found) == ["cone"]
    few = fix_insensitive_knobs(found, ["cone"], None)
    assert {each.values["cone"] for each in few} == {"pyramidal"}
    assert len(few) == len(found) / 2
    rows[3]["label"] = "chatter"
    assert find_insensitive_knobs(weighed(rows, KNOBS)) == []


def test_a_knob_that_never_varies_alone_is_not_idle(weighed: Weigh) -> None:
    rows = [row(step, "Euler", 1.0, cone=str(step)) for step in STEPS]
    assert find_insensitive_knobs(weighed(rows, KNOBS)) == []


def test_one_chaotic_run_is_enough_to_say_so(runs_of: Callable[..., StoredRuns]) -> None:
    rows = [row(step, "RK4", 1.0, chaotic=0.0) for step in STEPS]
    assert not is_chaotic(runs_of(rows, KNOBS))
    rows[2]["chaotic"] = 1.0
    assert is_chaotic(runs_of(rows, KNOBS))
    assert not is_chaotic(runs_of([row(1e-3, "RK4", 1.0)], KNOBS))
