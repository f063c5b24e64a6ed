"""The model as written, beside a sweep: in every scenario, first of all, found where it is."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.pareto.analysis import analyze_tradeoff
from contactlab.pareto.criteria import Criteria
from contactlab.pareto.tradeoff_chart import chart_data
from contactlab.plan.overrides import Overrides
from contactlab.run.sweep_request import read_request
from contactlab.store.finished_store import Store
from contactlab.studies.tradeoff_sweep import TradeoffRequest, sweep_settings
from contactlab.tasks.session import Session

pytestmark = pytest.mark.long

SWEEP = """
version: 1
scene: double_pendulum
duration: 0.1
seeds: 2
axes:
  timestep: [%s]
  cone: [pyramidal]
  angle: {values: [60, 120], role: scenario}
effects: {midphase: false}
baseline: true
accuracy: {against: written, refine: 2}
trace: none
"""
OTHERS = SWEEP % "4.0e-3, 8.0e-3"


@pytest.fixture(scope="module")
def beside(written: Callable[..., Store]) -> Store:
    return written(OTHERS)


def test_it_is_run_once_in_every_scenario_without_knobs_or_effects(beside: Store) -> None:
    rows = beside.table.to_pylist()
    assert len(rows) == (2 + 1) * 2 * 2
    own = [row for row in rows if row["timestep"] is None]
    assert [(row["angle"], row["seed"]) for row in own] == [(60, 0), (60, 1), (120, 0), (120, 1)]
    assert {(row["cone"], row["midphase"]) for row in own} == {(None, None)}
    assert {row["settings"]["timestep"] for row in own} == {2e-3}
    assert beside.manifest.sweep.baseline == own[0]["run_id"]


def test_it_comes_first_with_the_options_that_it_has(beside: Store) -> None:
    report = analyze_tradeoff(beside)
    now = report.baseline
    assert now is not None
    assert now == report.configurations[0]
    assert now.configuration == {"timestep": 2e-3, "cone": "pyramidal", "midphase": None}
    assert now.outcomes.runs == report.runs_per_configuration == 4
    errors = [row["error_final"] for row in beside.table.to_pylist() if row["timestep"] is None]
    assert now.error_spread is not None
    assert now.error_spread[0] <= now.error_spread[1] <= max(errors)
    (marked,) = [each for each in chart_data(report).points if each["chosen"].startswith("now")]
    assert (marked["timestep"], marked["place"]) == (2e-3, 0)


def test_what_others_leave_to_the_scene_too_stays_left_to_it(written: Callable[..., Store]) -> None:
    """Rows that are included name some knobs; those without a cone are of one method."""
    rows = "include: [{timestep: 4.0e-3}, {timestep: 8.0e-3}, {timestep: 8.0e-3, cone: elliptic}]\n"
    head, tail = SWEEP[: SWEEP.index("axes:")], SWEEP[SWEEP.index("baseline:") :]
    report = analyze_tradeoff(written(f"{head}{rows}{tail}"))
    assert report.baseline is not None
    assert report.baseline.configuration == {"timestep": 2e-3, "cone": None}
    assert sum(each.configuration["cone"] is None for each in report.configurations) == 3


def test_it_is_found_among_the_sweeps_own_runs(written: Callable[..., Store]) -> None:
    """A run that equals one of the product is run once: the product's is the baseline."""
    text = (SWEEP % "1.0e-3, 2.0e-3").replace("effects: {midphase: false}\n", "")
    report = analyze_tradeoff(written(text))
    assert len(report.configurations) == 2
    assert report.baseline is not None
    assert report.baseline.configuration == {"timestep": 2e-3, "cone": "pyramidal"}
    assert report.configurations[0] == report.baseline


def test_only_what_differs_from_it_is_written(beside: Store) -> None:
    """Where nothing is faster, there is nothing to change in the model."""
    request = TradeoffRequest(str(beside.address), Criteria())
    report = sweep_settings(request, Session(Path(str(beside.address)).parent))
    now = report.baseline and report.baseline.configuration
    assert now is not None
    for pick in (report.recommendation, report.robust):
        assert pick is not None
        changed = {name for name, value in pick.configuration.items() if now[name] != value}
        text = " ".join(pick.mjcf)
        assert ("timestep=" in text) == ("timestep" in changed)
        assert ("midphase=" in text) == ("midphase" in changed)
        assert "pyramidal" not in text


def test_without_it_a_sweep_is_what_it_was(tmp_path: Any) -> None:
    def identity(text: str) -> dict[str, Any]:
        ask = read_request(text, "same", tmp_path / "s", folder=tmp_path, workers=0)
        return ask.plan.sweep.model_dump(mode="json")

    plain = OTHERS.replace("baseline: true\n", "").replace("against: written, ", "")
    assert not {"baseline", "against"} & {*identity(plain), *identity(plain)["accuracy"]}
    assert identity(plain.replace("seeds", "baseline: false\nseeds")) == identity(plain)


def test_filters_keep_it_in_the_scenarios_that_are_left(tmp_path: Any) -> None:
    only = Overrides(where=("timestep=4.0e-3", "angle=60"))
    ask = read_request(OTHERS, "few", tmp_path / "s", folder=tmp_path, workers=0, overrides=only)
    rows = [dict(row.values) for row in ask.plan.iterate_rows()]
    assert rows == [
        {"timestep": 4e-3, "cone": "pyramidal", "angle": 60.0, "midphase": False},
        {"angle": 60.0},
    ]
    assert ask.plan.count == 4
