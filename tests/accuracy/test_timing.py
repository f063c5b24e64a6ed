"""The timing pass: interleaved runs, bounds on their time, and their work."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from contactlab.accuracy import timing
from contactlab.engines.engine import Segments
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.run.forecast import forecast_sweep
from contactlab.schema.evidence import Timing

TIMED = """
version: 1
scene: box_stack
duration: 0.2
seeds: 2
axes:
  boxes: [3]
  integrator: [Euler, RK4]
  timestep: [1.0e-3, 2.0e-3]
trace: none
checks: none
timing: {rounds: 4}
"""


@pytest.mark.long
def test_every_run_has_its_times_and_its_work(sweeper: Any) -> None:
    sweeper.run(TIMED)
    found = sweeper.rows()
    assert len(found) == 8
    for row in found:
        assert all(row[name] is not None for name in Timing.model_fields)
        assert 0 < row["time_min"] <= row["time_median"]
        assert 0 < row["step_p50"] <= row["step_p99"]
        assert row["compile_time"] > 0
        assert row["work_steps"] == pytest.approx(1 / row["timestep"])
        assert row["work_rows"] > row["work_contacts"] > row["work_steps"]
        # The mean of the whole and the median of single steps, of a stack whose steps are even.
        assert 0.4 < row["time_median"] * row["timestep"] / row["step_p50"] < 2.5
        assert row["error_kind"] is None
    assert len({row["timing_settings"] for row in found}) == 1


@pytest.mark.night
def test_four_evaluations_take_four_times_as_long(sweeper: Any) -> None:
    """RK4 evaluates the forces four times a step; interleaved, both see the same machine."""
    sweeper.run(TIMED)
    least = {
        (row["integrator"], row["timestep"], row["seed"]): row["time_min"] for row in sweeper.rows()
    }
    for timestep in (1e-3, 2e-3):
        ratio = least["RK4", timestep, 0] / least["Euler", timestep, 0]
        assert ratio == pytest.approx(4, rel=0.3)
    assert least["Euler", 1e-3, 0] / least["Euler", 2e-3, 0] == pytest.approx(2, rel=0.3)


@pytest.mark.night
def test_work_repeats_and_settings_tell_rounds_apart(sweeper: Any) -> None:
    sweeper.run(TIMED, "one")
    sweeper.run(TIMED.replace("rounds: 4", "rounds: 3"), "two", workers=2)
    for one, two in zip(sweeper.rows("one"), sweeper.rows("two"), strict=True):
        work = [name for name in one if name.startswith("work_")]
        assert [one[name] for name in work] == [two[name] for name in work]
        assert one["timing_settings"] != two["timing_settings"]


@pytest.mark.long
def test_runs_are_interleaved_within_each_round(
    sweeper: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """First a few steps of each run for its pace, then rounds, always in plan order."""
    seen: list[tuple[int, float]] = []

    def watched(_: MujocoEngine, segments: Segments, most: int, repeats: int) -> tuple[float, int]:
        seen.append((segments.model.opt.integrator, segments.model.opt.timestep))
        return 1e-4 * repeats * sum(segments.lengths(most)), repeats * sum(segments.lengths(most))

    monkeypatch.setattr(MujocoEngine, "time_segments", watched)
    sweeper.run(TIMED)
    assert len(set(seen)) == 4
    assert seen == seen[:8] * 5
    # A tenth of a millisecond a step: 1 s of steps of 1 ms each take 0.1 s.
    assert sorted({round(row["time_min"], 9) for row in sweeper.rows()}) == [0.05, 0.1]


CONTENDERS = TIMED.replace("rounds: 4", "rounds: 4, contenders: true")


@pytest.mark.long
@pytest.mark.parametrize("limit", [0.0, 0.5, 1e3])
def test_only_what_may_be_recommended_is_timed_again(
    sweeper: Any, monkeypatch: pytest.MonkeyPatch, limit: float
) -> None:
    """RK4 costs four times as much here; which errors are smaller, the rows say.

    A configuration goes on for all four rounds if it is feasible, or none is, and none of these
    that is clearly faster has a smaller error, which is here the only share of a tolerance.
    """
    seen: list[tuple[str, float]] = []

    def cost(integrator: str, timestep: float) -> float:
        return (4e-4 if integrator == "RK4" else 1e-4) / timestep

    def watched(_: MujocoEngine, segments: Segments, most: int, repeats: int) -> tuple[float, int]:
        option = segments.model.opt
        seen.append(("RK4" if option.integrator == 1 else "Euler", option.timestep))
        steps = repeats * sum(segments.lengths(most))
        return cost(*seen[-1]) * option.timestep * steps, steps

    monkeypatch.setattr(MujocoEngine, "time_segments", watched)
    sweeper.run(f"{CONTENDERS}tolerances: {{oracle_error: {limit}}}")
    errors: dict[tuple[str, float], float] = {}
    for row in sweeper.rows():
        key = row["integrator"], row["timestep"]
        errors[key] = max(errors.get(key, 0.0), abs(row["oracle_error"]))
    feasible = {key for key, error in errors.items() if error <= limit} or set(errors)
    for key, own in errors.items():
        beaten = any(
            cost(*other) * 1.25 < cost(*key) and errors[other] <= own for other in feasible
        )
        # Once for its pace; its two seeds share what a step costs.
        assert seen.count(key) == 1 + (4 if key in feasible and not beaten else 1), key


@pytest.mark.long
def test_seeds_share_their_times(sweeper: Any) -> None:
    sweeper.run(CONTENDERS)
    first, second = ([row for row in sweeper.rows() if row["seed"] == seed] for seed in (0, 1))
    for one, two in zip(first, second, strict=True):
        assert one["step_p99"] == two["step_p99"] > 0
        assert one["time_median"] == two["time_median"] > 0
        assert one["work_steps"] > 0
        assert two["work_steps"] is None


@pytest.mark.long
@pytest.mark.parametrize(("cost", "steps"), [(1e-6, 200 * 50), (1e-4, 200), (1e-3, 8 * 13)])
def test_neither_short_nor_long_runs_take_too_long(
    sweeper: Any, monkeypatch: pytest.MonkeyPatch, cost: float, steps: int
) -> None:
    """At least 20 ms in a round, at most 50 times over; at most 0.1 s, from 8 places."""
    made: list[int] = []

    def watched(_: MujocoEngine, segments: Segments, most: int, repeats: int) -> tuple[float, int]:
        made.append(repeats * sum(segments.lengths(most)))
        return cost * made[-1], made[-1]

    monkeypatch.setattr(MujocoEngine, "time_segments", watched)
    sweeper.run(TIMED.replace("[1.0e-3, 2.0e-3]", "[1.0e-3]").replace("[Euler, RK4]", "[Euler]"))
    assert set(made[2:]) == {steps}


@pytest.mark.timed
def test_the_plan_counts_what_passes_take(sweeper: Any) -> None:
    asks = {
        "plain": TIMED.replace("timing: {rounds: 4}", ""),
        "timed": TIMED,
        "held": TIMED.replace("timing: {rounds: 4}", "accuracy: {refine: 16}"),
        "finer": TIMED.replace("timing: {rounds: 4}", "accuracy: {refine: 32}"),
    }
    forecasts = {name: forecast_sweep(ask) for name, ask in _asks(sweeper, asks).items()}
    seconds = {name: forecast.seconds or (0.0, 0.0) for name, forecast in forecasts.items()}
    assert forecasts["plain"].accuracy_seconds == forecasts["plain"].timing_seconds == 0
    # At least 20 ms for each of 8 runs in each of 4 rounds.
    assert forecasts["timed"].timing_seconds >= 4 * 8 * 0.02
    assert seconds["timed"][1] > forecasts["timed"].timing_seconds
    # Two seeds: two families, each with references of 200 * 16 and 200 * 32 steps of RK4.
    assert seconds["held"][1] > forecasts["held"].accuracy_seconds > 0
    # Costs are measured anew for each; twice as fine takes twice as long.
    ratio = forecasts["finer"].accuracy_seconds / forecasts["held"].accuracy_seconds
    assert ratio == pytest.approx(2, rel=0.5)


def _asks(sweeper: Any, texts: dict[str, str]) -> dict[str, Any]:
    return {name: sweeper.ask(text, name) for name, text in texts.items()}


@pytest.mark.parametrize("timestep", [5e-4, 2e-3, 1e-2])
def test_times_are_of_a_second_simulated_and_of_a_step(timestep: float) -> None:
    """Steps of 1 to 101 us take 51 us in the mean: over the timestep, per simulated second."""
    steps = 1e-6 * np.arange(1.0, 102.0)
    engine: Any = SimpleNamespace(
        time_segments=lambda _, most, repeats: (
            most * repeats * float(steps.mean()),
            most * repeats,
        ),
        time_steps=lambda _, most: np.tile(steps, most),
    )
    segments: Any = SimpleNamespace(model=SimpleNamespace(opt=SimpleNamespace(timestep=timestep)))
    portion: Any = SimpleNamespace(most=5, repeats=3, single=1)
    found = timing._measure_times(engine, segments, portion)  # pyright: ignore[reportPrivateUsage]
    assert found == pytest.approx((51e-6 / timestep, 51e-6, 100e-6))
