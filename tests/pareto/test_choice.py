"""The recommendation, against a slow obvious loop over everything."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.pareto.conftest import make_runs, make_weighing

from contactlab.pareto.configurations import (
    EvaluatedConfiguration,
    evaluate_configurations,
    group_runs,
)
from contactlab.pareto.end_states import mark_ends
from contactlab.pareto.recommendation import (
    equally_fast,
    feasible_front,
    next_more_accurate,
    recommendable_places,
)

Weigh = Callable[..., list[EvaluatedConfiguration]]
LIMITS = {"oracle_error": 1.0, "depth": 2.0}

RUN = st.fixed_dictionaries(
    {
        "oracle_error": st.one_of(st.sampled_from([0.0, 0.5, 0.8, 1.0]), st.floats(-2, 2)),
        "depth": st.one_of(st.sampled_from([0.0, 1.6, 2.0]), st.floats(0, 3)),
        "time_median": st.one_of(st.sampled_from([1.0, 1.04, 1.05]), st.floats(0.5, 2)),
        "label": st.sampled_from(["stable"] * 9 + ["chatter"]),
    }
)


@st.composite
def sweeps(draw: st.DrawFn) -> list[dict[str, Any]]:
    """Draw the runs of up to 8 configurations in up to 2 scenarios of up to 2 seeds."""
    scenarios, seeds = draw(st.integers(1, 2)), draw(st.integers(1, 2))
    return [
        {**draw(RUN), "timestep": 1e-3 * step, "scenario": scenario, "seed": seed}
        for step in range(1, 1 + draw(st.integers(1, 8)))
        for scenario in range(scenarios)
        for seed in range(seeds)
    ]


def slow(rows: list[dict[str, Any]], least_margin: float) -> float | None:
    """Return the timestep to recommend, by looking at each in turn."""
    found: list[tuple[float, float, float]] = []
    for step in sorted({row["timestep"] for row in rows}):
        runs = [row for row in rows if row["timestep"] == step]
        if any(row["label"] != "stable" for row in runs):
            continue
        sizes = [(abs(row[name]), limit) for row in runs for name, limit in LIMITS.items()]
        if any(size > limit or (size and limit / size < least_margin) for size, limit in sizes):
            continue
        time = sum(row["time_median"] for row in runs) / len(runs)
        found.append((time, max(abs(row["oracle_error"]) for row in runs), step))
    if not found:
        return None
    cheapest = min(time for time, _, _ in found)
    near = [each for each in found if each[0] <= 1.05 * cheapest]
    return min(near, key=lambda each: each[1])[2]


@pytest.mark.parametrize("least_margin", [1.0, 1.25])
@given(rows=sweeps())
def test_the_recommendation_is_the_slow_loops(
    weighed: Weigh, least_margin: float, rows: list[dict[str, Any]]
) -> None:
    near = equally_fast(weighed(rows, **LIMITS), least_margin)
    found = near[0].summary.configuration["timestep"] if near else None
    assert found == slow(rows, least_margin)


@pytest.mark.parametrize(("chosen", "after"), [(0, 2), (1, 2), (2, 3), (3, None)])
def test_the_next_step_is_the_cheapest_that_is_relevantly_more_accurate(
    weighed: Weigh, chosen: int, after: int | None
) -> None:
    """By a factor of 1.05 at least: an error of 0.97 is no step down from 1, one of 0.9 is."""
    errors = (1.0, 0.97, 0.9, 0.3)
    rows = [
        {"oracle_error": error, "depth": 1.0, "time_median": 1.0 + place, "label": "stable",
         "timestep": 1e-3 * (4 - place), "scenario": 0, "seed": 0}
        for place, error in enumerate(errors)
    ]  # fmt: skip
    front = feasible_front(weighed(rows, **LIMITS))
    assert [numbers(each)[1] for each in front] == [*errors]
    found = next_more_accurate(front, front[chosen])
    assert found == (None if after is None else front[after])


@pytest.mark.long
@given(rows=sweeps())
def test_nothing_feasible_is_more_accurate_and_no_more_expensive(
    weighed: Weigh, rows: list[dict[str, Any]]
) -> None:
    found = weighed(rows, **LIMITS)
    near, line = equally_fast(found), feasible_front(found)
    assert bool(near) == bool(line)
    assert all(each.summary.feasible for each in line)
    if near:
        mine = near[0].summary
        better = [each.summary for each in line if numbers(each)[1] < numbers(near[0])[1]]
        assert all((each.time or 0) > (mine.time or 0) for each in better)
        after = next_more_accurate(line, near[0])
        assert after is None or after.summary in better


def numbers(each: EvaluatedConfiguration) -> tuple[float, float]:
    assert each.summary.time is not None
    assert each.summary.error is not None
    return each.summary.time, each.summary.error


@pytest.mark.parametrize(
    "defect",
    [
        {"label": "tunneling"},
        {"label": "crashed", "oracle_error": float("nan")},
        {"oracle_error": 1.0001},
        {"oracle_error": -1.0001},
        {"oracle_error": float("nan")},
        {"depth": 2.1},
    ],
)
def test_what_is_faster_but_fails_once_is_never_recommended(
    weighed: Weigh, defect: dict[str, Any]
) -> None:
    sound = {"oracle_error": 0.5, "depth": 1.0, "time_median": 5.0}
    rows: list[dict[str, Any]] = [
        {**sound, "timestep": 1e-3, "seed": seed, "scenario": scenario}
        for seed in range(3)
        for scenario in range(4)
    ]
    fast = [{**row, "timestep": 4e-3, "time_median": 0.1} for row in rows]
    (chosen,) = equally_fast(weighed([*rows, *fast], **LIMITS))[:1]
    assert chosen.summary.configuration == {"timestep": 4e-3}
    fast[7] |= defect
    found = weighed([*rows, *fast], **LIMITS)
    (chosen,) = equally_fast(found)
    assert chosen.summary.configuration == {"timestep": 1e-3}
    assert len(found[1].summary.reasons) >= 1


def test_what_was_not_run_in_every_scenario_is_never_recommended(weighed: Weigh) -> None:
    """The scenario that is missing may be the worst."""
    sound = {"oracle_error": 0.5, "depth": 1.0, "time_median": 5.0, "timestep": 1e-3}
    rows = [{**sound, "scenario": each} for each in range(2)]
    partial = {**sound, "timestep": 4e-3, "time_median": 0.1, "scenario": 0}
    found = weighed([*rows, partial], **LIMITS)
    assert [each.summary.feasible for each in found] == [True, False]
    assert found[1].summary.reasons == ("run in 1 of 2 cases",)


def test_margins_are_exact(weighed: Weigh) -> None:
    rows = [
        {"timestep": 1e-3, "seed": 0, "oracle_error": -0.25, "depth": 0.0, "time_median": 1.0},
        {"timestep": 1e-3, "seed": 1, "oracle_error": 0.125, "depth": 0.0, "time_median": 3.0},
    ]
    (only,) = weighed(rows, **LIMITS)
    assert only.summary.margins == {"oracle_error": 4.0, "depth": None}
    assert only.summary.worst == {"oracle_error": 0.25, "depth": 0.0}
    assert (only.summary.time, only.summary.time_worst) == (2.0, 3.0)
    assert only.summary.real_time_factor == 0.5


def test_times_within_five_percent_are_equal_and_the_more_accurate_wins(weighed: Weigh) -> None:
    def row(step: float, time: float, error: float) -> dict[str, Any]:
        return {"timestep": step, "time_median": time, "oracle_error": error, "depth": 0.1}

    rows = [row(1e-3, 1.0, 0.9), row(2e-3, 1.049, 0.3), row(3e-3, 1.051, 0.1)]
    chosen, other = equally_fast(weighed(rows, **LIMITS))
    assert chosen.summary.configuration["timestep"] == 2e-3
    assert other.summary.configuration["timestep"] == 1e-3


def test_an_error_below_the_references_own_counts_as_that(weighed: Weigh) -> None:
    row = {"timestep": 1e-3, "time_median": 1.0, "error_final": 1e-9, "error_final_estimate": 1e-6}
    (only,) = weighed([row], error="error_final")
    assert only.summary.error == 1e-6
    assert only.summary.below_estimate


def test_a_tolerance_that_the_reference_cannot_tell_is_not_met(weighed: Weigh) -> None:
    row = {"timestep": 1e-3, "time_median": 1.0, "error_final": 1e-9, "error_final_estimate": 1e-6}
    (met,) = weighed([row], error="error_final", error_final=1e-6)
    assert met.summary.feasible
    assert met.summary.margins == {"error_final": 1.0}
    (missed,) = weighed([row], error="error_final", error_final=9e-7)
    assert not missed.summary.feasible
    assert missed.summary.outcomes.good == 0


def test_ties_keep_the_values_of_the_model_as_written(weighed: Weigh) -> None:
    """As fast within 5 % and as accurate within 5 %: fewer changes win, else accuracy does."""
    rows = [
        {"timestep": step, "cone": cone, "oracle_error": error, "time_median": time}
        for step, cone, error, time in (
            (1e-3, "elliptic", 0.96, 1.0),
            (2e-3, "elliptic", 0.97, 1.01),
            (2e-3, "pyramidal", 1.0, 1.02),
            (4e-3, "pyramidal", 0.5, 1.2),
        )
    ]
    found = weighed(rows, ("timestep", "cone"))
    first, second, written, accurate = (each.values for each in found)
    assert [each.values for each in equally_fast(found)] == [first, second, written]
    kept = equally_fast(found, baseline=written)
    assert [each.values for each in kept] == [written, second, first]
    assert equally_fast(found, baseline=accurate)[0].values == written, "it has the same cone"
    rows[2]["oracle_error"] = 0.96 * 1.06
    assert equally_fast(weighed(rows, ("timestep", "cone")), baseline=written)[0].values == second


def test_no_other_engine_is_recommended(weighed: Weigh) -> None:
    """It is faster and more accurate; only a sweep without MuJoCo has nothing else to choose."""
    rows: list[dict[str, Any]] = [
        {"engine": "impulse", "timestep": 1e-3, "oracle_error": 0.0, "time_median": 0.1},
        {"engine": "mujoco", "timestep": 2e-3, "oracle_error": 0.5, "time_median": 1.0},
        {"engine": "mujoco", "timestep": 1e-3, "oracle_error": 0.1, "time_median": 2.0},
    ]
    found = [
        recommendable_places([each.summary for each in weighed(part, ["engine", "timestep"])])
        for part in (rows, rows[:1])
    ]
    assert found == [[1, 2], [0]]


@pytest.mark.parametrize(("drop", "recommended"), [(0.125, 4e-3), (0.425, 1e-3)])
def test_a_configuration_whose_bodies_end_elsewhere_is_not_recommended(
    drop: float, recommended: float
) -> None:
    rows: list[dict[str, Any]] = [
        {"oracle_error": error, "depth": 1.0, "time_median": 1e-3 / step, "timestep": step,
         "drop": fallen, "penetration_max": 0.002, "seed": seed}
        for step, error, fallen in ((1e-3, 0.1, 0.12), (4e-3, 0.5, drop))
        for seed in range(3)
    ]  # fmt: skip
    runs = make_runs(rows)
    groups = group_runs(runs)
    evaluated = evaluate_configurations(runs, make_weighing("oracle_error", **LIMITS), groups)
    found = mark_ends(evaluated, runs, groups)
    places = recommendable_places([each.summary for each in found])
    (chosen,) = equally_fast([found[place] for place in places])[:1]
    assert chosen.summary.configuration == {"timestep": recommended}
