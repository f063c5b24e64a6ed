"""A forecast adds up all runs of a plan, and measures some of them."""

import json
from pathlib import Path
from typing import Any

import pytest

import contactlab
from contactlab.errors import SweepFileError
from contactlab.rendering.text import render_text
from contactlab.reporting.store_reports_document import describe_forecast
from contactlab.run import forecast as forecasts
from contactlab.run.forecast import forecast_sweep
from contactlab.run.planned_runs import RunIndex
from contactlab.run.sampled_cost import SampledCost, sample_cost
from contactlab.run.sweep_request import SweepRequest, read_request
from contactlab.scene.run_spec import RunSpec

TIMESTEPS, HEIGHTS = [1e-3, 2e-3, 4e-3], [0.1, 0.2, 0.3, 0.4, 0.5]
SWEEP: dict[str, Any] = {
    "version": 1,
    "scene": "ball_drop",
    "duration": 0.1,
    "axes": {"timestep": TIMESTEPS, "drop_height": HEIGHTS},
}
FACTOR = 1.5  # of the estimated time, as the forecast documents it
SIZE_FACTOR = 1.25


def requested(folder: Path, workers: int = 1, **keys: Any) -> SweepRequest:
    return read_request(
        {**SWEEP, **keys}, "drops", folder / "store", folder=folder, workers=workers
    )


@pytest.mark.parametrize("seeds", [1, 3, 5])
@pytest.mark.parametrize(
    ("trace", "fewest", "most"),
    [
        ("all", 1.0, 1.0),
        ("sample:6", 6.0, 6.0),
        ("sample:10000", 1.0, 1.0),
        ("flagged", 0.0, 1.0),
        ("flagged+sample:6", 6.0, 1.0),
    ],
)
def test_a_forecast_is_the_sum_over_its_runs(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    seeds: int,
    trace: str,
    fewest: float,
    most: float,
) -> None:
    """Steps of each run, one by one, times the cost of a step; runs are sampled evenly."""
    sampled = list[RunSpec]()

    def cost(_request: object, _index: object, runs: list[RunSpec]) -> SampledCost:
        sampled.extend(runs)
        return SampledCost(1e-3, {"messages": 100.0, "compact": 10.0})

    monkeypatch.setattr(forecasts, "sample_cost", cost)
    request = requested(tmp_path, seeds=seeds, trace=trace)
    forecast = forecasts.forecast_sweep(request)
    plan, scene = request.plan, request.scene
    runs = [scene.resolve(run.values, run.seed, 0.1) for run in plan.iterate_runs()]
    steps = sum(run.steps for run in runs)
    assert (forecast.runs, forecast.steps) == (15 * seeds, steps)
    assert forecast.seconds
    estimate = 2.0 + 1e-3 * steps  # the start of the command, and the steps
    assert forecast.seconds == pytest.approx((estimate / FACTOR, FACTOR * estimate))
    least, all_kept = (kept / len(runs) if kept > 1 else kept for kept in (fewest, most))
    expected = 100 * steps * least / SIZE_FACTOR, 100 * steps * all_kept * SIZE_FACTOR
    assert forecast.bytes_by_format["messages"] == pytest.approx(expected)
    assert forecast.bytes == forecast.bytes_by_format[plan.sweep.trace_format]
    stride = max(1, len(runs) // 48)
    assert [run.values for run in sampled] == [run.values for run in runs[::stride]]


def test_two_workers_take_half_of_the_recording(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(forecasts, "sample_cost", lambda *_: SampledCost(1.0, {}))
    monkeypatch.setattr("os.cpu_count", lambda: 8)
    one, two = (forecasts.forecast_sweep(requested(tmp_path, count)) for count in (1, 2))
    assert one.seconds
    assert two.seconds
    assert one.seconds[1] - 2 * FACTOR == pytest.approx(2 * (two.seconds[1] - 2 * FACTOR))


def test_more_workers_than_runs_take_no_less(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(forecasts, "sample_cost", lambda *_: SampledCost(1.0, {}))
    monkeypatch.setattr("os.cpu_count", lambda: 10_000)
    one = requested(tmp_path)
    runs = len(RunIndex(one.plan, one.scene))
    fewer, as_many, more = (
        forecasts.forecast_sweep(requested(tmp_path, count)).seconds
        for count in (runs // 2, runs, 10 * runs)
    )
    assert as_many == more
    assert fewer
    assert as_many
    assert fewer[1] > as_many[1]


@pytest.mark.parametrize("form", [pytest.param("messages", marks=pytest.mark.long), "compact"])
def test_the_size_of_traces_is_that_of_the_store(tmp_path: Path, form: str) -> None:
    """All runs are short enough to be sampled, so the sizes differ by lengths of names alone."""
    request = requested(tmp_path, trace="all", trace_format=form)
    index = RunIndex(request.plan, request.scene)
    runs = list(index.iterate_runs())
    cost = sample_cost(request, index, runs)
    store = tmp_path / form
    sweep = {**SWEEP, "trace": "all", "trace_format": form}
    contactlab.sweep(sweep, output=str(store), workers=0)
    size = sum(file.stat().st_size for file in (store / "traces").rglob("*.mcap"))
    steps = sum(run.steps for run in runs)
    assert cost.trace_bytes[form] * steps == pytest.approx(size, rel=0.25)
    assert cost.cpu_seconds > 0
    assert not (tmp_path / "store").exists()


def test_code_that_is_not_allowed_is_not_run(tmp_path: Path) -> None:
    (tmp_path / "policy.py").write_text("raise SystemExit('it ran')\n")
    (tmp_path / "cart.xml").write_text(
        "<mujoco><worldbody><body><joint name='x' type='slide'/><geom size='.1'/></body>"
        "</worldbody><actuator><motor joint='x'/></actuator></mujoco>"
    )
    request = requested(
        tmp_path, scene="cart.xml", axes={"timestep": TIMESTEPS}, drive={"policy": "policy.py:P"}
    )
    forecast = forecasts.forecast_sweep(request)
    assert (forecast.seconds, forecast.bytes, forecast.memory_bytes) == (None, None, None)
    assert "--allow-code" in render_text(describe_forecast(forecast))
    assert json.loads(forecast.model_dump_json())["runs"] == 3


SUNK = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/>
<body name="ball" pos="0 0 .2"><freejoint/><geom size=".1"/></body></worldbody>
<keyframe><key name="sunk" qpos="0 0 0 1 0 0 0"/></keyframe></mujoco>"""


def test_values_in_another_unit_are_refused_together(tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(SUNK)
    axes = "{timestep: [1, 2], solref.timeconst: [0.005, 50], margin: [0, 0.2]}"
    text = f"{{version: 1, scene: ball.xml, drive: none, duration: 9, axes: {axes}}}"
    request = read_request(text, "two", tmp_path / "store", folder=tmp_path, workers=0)
    with pytest.raises(SweepFileError) as caught:
        forecasts.check_units(request.plan, request.scene)
    assert "timestep 2 s" in str(caught.value)
    assert "solref.timeconst 50 s" in str(caught.value)
    assert "margin" not in str(caught.value)


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ("{timestep: [2, 4]}", "timestep 4 s: is 4 ms meant? Write 0.004"),
        ("{margin: [0, 5]}", "margin 5 m: is 5 mm meant? Write 0.005"),
        ("{keyframe: [sunk, qpos0]}", "world and ball by 100 mm"),
        (
            "{drop_height: [0.2, -0.08]}",
            "in 1 of 2 tried starts bodies begin deep inside each other, world",
        ),
        ("{drop_height: [0, -0.01]}", "drop_height -0.01 m starts the free bodies below"),
        ("{timestep: [0.002, 0.2]}", "1 of 2 runs have fewer than 10 steps"),
        ("{timestep: [0.002, 0.004]}", ""),
    ],
)
def test_suspicious_values_and_starts_are_questioned(axes: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(SUNK)
    text = f"{{version: 1, scene: ball.xml, drive: none, duration: 1, trace: none, axes: {axes}}}"
    store = tmp_path / "store"
    report = forecasts.forecast_sweep(read_request(text, "two", store, folder=tmp_path, workers=0))
    shown = " ".join(report.warnings)
    assert words in shown
    assert words or "meant" not in shown
    assert report.drive.startswith("nothing but the controls of its start")


def test_a_pd_controller_runs_no_code_of_the_user_and_has_a_forecast(tmp_path: Path) -> None:
    (tmp_path / "hinge.xml").write_text(
        '<mujoco><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody>'
        '<actuator><motor joint="j"/></actuator></mujoco>'
    )
    text = "{version: 1, scene: hinge.xml, drive: {kp: 2, kd: 1}, duration: 1, trace: none}"
    request = read_request(text, "held", tmp_path / "store", folder=tmp_path, workers=0)
    assert not request.allow_code
    assert forecasts.forecast_sweep(request).seconds is not None


ROBOT = """<mujoco><worldbody>{floor}<body name="trunk" pos="0 0 1"><freejoint/><geom size=".1"/>
<body pos=".2 0 0"><joint/><geom size=".05" pos=".1 0 0"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(("floor", "warns"), [("", 1), ('<geom type="plane" size="1 1 1"/>', 0)])
def test_a_robot_that_falls_for_ever_is_warned_of(tmp_path: Path, floor: str, warns: int) -> None:
    (tmp_path / "robot.xml").write_text(ROBOT.format(floor=floor))
    request = requested(tmp_path, scene="robot.xml", axes={"timestep": TIMESTEPS})
    index = RunIndex(request.plan, request.scene)
    for warnings in (
        forecast_sweep(request).warnings,
        [*forecasts.warn_of_settings(request, index)],
    ):
        assert sum("nothing is below the floating base trunk" in each for each in warnings) == warns
