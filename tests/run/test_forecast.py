"""A forecast adds up all runs of a plan, and samples them evenly."""

from collections.abc import Mapping
from typing import Any

import pytest

from contactlab.engines.engine import bytes_of_run
from contactlab.plan.sweep_file import read_sweep
from contactlab.run import forecast as forecasts
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.store_reports import SweepForecast

# Runs of 200 steps at most take as long in all as the sweep does in the mean.
TIMESTEPS, HEIGHTS = [1e-3, 2e-3, 4e-3], [0.1, 0.2, 0.3, 0.4, 0.5]


@pytest.mark.parametrize("seeds", [1, 3, 5])
@pytest.mark.parametrize(
    ("trace", "fewest", "most"),
    [
        ("all", 1.0, 1.0),
        ("none", 0.0, 0.0),
        ("sample:6", 6.0, 6.0),
        ("sample:10000", 1.0, 1.0),
        ("flagged", 0.0, 1.0),
        ("flagged+sample:6", 6.0, 1.0),
    ],
)
def test_a_forecast_is_the_sum_over_its_runs(
    monkeypatch: pytest.MonkeyPatch, seeds: int, trace: str, fewest: float, most: float
) -> None:
    """Steps and bytes of each run, one by one; what a step costs is asked of every twelfth of n.

    Every n // 12-th run of the plan is asked about, the first one among them.
    """
    asked = list[Mapping[str, object]]()

    def cost(_: Scene, run: RunSpec) -> float:
        asked.append(run.values)
        return 1e-6

    monkeypatch.setattr(forecasts, "_step_cost", cost)
    sweep: dict[str, Any] = {
        "version": 1,
        "scene": "ball_drop",
        "duration": 0.1,
        "seeds": seeds,
        "axes": {"timestep": TIMESTEPS, "drop_height": HEIGHTS},
        "trace": trace,
    }
    plan = read_sweep(sweep, SceneLoader(None).vocabulary).plan
    scene = Scene.open("ball_drop")
    told = forecasts.forecast_sweep(plan, scene, 1)
    runs = [scene.resolve(run.values, run.seed, 0.1) for run in plan.iterate_runs()]
    steps = sum(run.steps for run in runs)
    assert (told.runs, told.steps) == (15 * seeds, steps)
    least, all_kept = (kept / len(runs) if kept > 1 else kept for kept in (fewest, most))
    size = sum(bytes_of_run(scene.base_of(run).model, run.steps) for run in runs)
    expected = 0.1 * least * size, 0.6 * all_kept * size
    assert told.bytes_by_format["messages"] == pytest.approx(expected)
    assert told.bytes == told.bytes_by_format[plan.sweep.trace_format]
    assert asked == [run.values for run in runs[:: len(runs) // 12]]
    # Recording and measures take 0.2 to 1.5 times what stepping takes.
    assert told.seconds == pytest.approx((1.2e-6 * steps, 2.5e-6 * steps))


def test_checks_of_all_runs_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each takes what it takes beside its steps, and eight times these."""
    monkeypatch.setattr(forecasts, "_step_cost", lambda *_: 1e-6)
    monkeypatch.setattr(forecasts, "_check_cost", lambda *_: 1e-2)
    sweep = {"version": 1, "scene": "ball_drop", "duration": 0.1, "seeds": 3}
    told = dict[str, SweepForecast]()
    for checks in ("all", "none"):
        plan = read_sweep({**sweep, "checks": checks}, SceneLoader(None).vocabulary).plan
        told[checks] = forecasts.forecast_sweep(plan, Scene.open("ball_drop"), 1)
    more = told["all"].seconds[0] - told["none"].seconds[0]
    assert more == told["all"].checks_seconds == pytest.approx(3e-2 + 8e-6 * told["all"].steps)
