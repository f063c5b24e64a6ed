"""The whole answer, from a store of real runs."""

import json
from collections.abc import Callable
from pathlib import Path

import jsonschema
import pytest

from contactlab import resources
from contactlab.errors import StoreError, SweepFileError
from contactlab.pareto.analysis import analyze_tradeoff
from contactlab.pareto.configuration_export import recommended_sweep
from contactlab.pareto.criteria import Criteria
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.finished_store import Store

Written = Callable[..., Store]


def test_knobs_and_scenarios_are_told_apart(report: TradeoffReport) -> None:
    assert report.knobs == ("warmstart", "timestep", "integrator")
    assert report.scenarios == ("angle", "gravity")
    assert len(report.configurations) == 8
    assert report.runs_per_configuration == 3 * 2
    assert all(each.outcomes.runs == 6 for each in report.configurations)


def test_every_number_is_the_slow_loops(store: Store, report: TradeoffReport) -> None:
    rows = store.table.to_pylist()
    for each in report.configurations:
        runs = [
            row
            for row in rows
            if all(row[name] == value for name, value in each.configuration.items())
        ]
        worst = max(abs(row["oracle_error"]) for row in runs)
        assert each.worst == {"oracle_error": worst}
        assert each.error == max(worst, report.error.resolution)
        assert each.margins["oracle_error"] == (0.001 / worst if worst else None)
        assert each.feasible == (
            worst <= 0.001 and all(row["label"] == "stable" for row in runs)
        ), each.reasons
        assert each.time == pytest.approx(
            sum(row["cost_cpu_per_sim_s"] for row in runs) / len(runs), rel=1e-12
        )


def test_the_answer_validates_against_its_published_schema(report: TradeoffReport) -> None:
    schema = json.loads((resources.SCHEMAS / "tradeoff.schema.json").read_text())
    data = json.loads(report.model_dump_json())
    jsonschema.Draft202012Validator(schema).validate(data)
    assert data["recommendation"]["configuration"]["timestep"] in (1e-3, 2e-3, 4e-3, 8e-3)
    assert data["recommendation"]["margins"]["oracle_error"] >= 1
    assert data["front"]
    assert TradeoffReport.model_validate(data) == report


def test_a_tolerance_of_the_question_goes_over_the_sweeps(store: Store) -> None:
    strict = analyze_tradeoff(store, Criteria(tolerances={"oracle_error": 0.5, "steps": 1.0}))
    assert strict.tolerances == {"oracle_error": 0.5, "steps": 1.0}
    assert strict.recommendation is None
    assert strict.robust is None
    assert strict.next_step is None
    assert not strict.front
    assert strict.unconstrained_front
    most = strict.blockers[0]
    assert (most.name, most.kind, most.configurations) == ("steps", "tolerance", 8)
    assert most.best == min(each.worst["steps"] or 0 for each in strict.configurations)


def test_another_error_can_stand_for_accuracy(store: Store) -> None:
    found = analyze_tradeoff(store, Criteria(metric="energy_drift"))
    assert (found.error.name, found.error.kind) == ("energy_drift", "metric")


@pytest.mark.parametrize(
    ("question", "cause", "message"),
    [
        (Criteria(metric="oracle_eror"), SweepFileError, "did you mean 'oracle_error'"),
        (Criteria(metric="label"), SweepFileError, "no number 'label'"),
        (Criteria(tolerances={"depth": 1.0}), SweepFileError, "no number 'depth'"),
        (Criteria(metric="error_final"), StoreError, "sweep with `accuracy: {error: auto}`"),
        (Criteria(metric="restitution_measured"), StoreError, "no run in"),
    ],
)
def test_what_the_store_does_not_have(
    store: Store, question: Criteria, cause: type[Exception], message: str
) -> None:
    with pytest.raises(cause, match=message.replace("{", r"\{").replace("}", r"\}")):
        analyze_tradeoff(store, question)


def test_recorded_times_come_with_a_warning(report: TradeoffReport) -> None:
    assert report.time.source == "recording"
    assert any("timing: {rounds: 3}" in note for note in report.notes)


def test_the_rerun_is_the_configuration_in_the_same_scenarios_from_fresh_seeds(
    store: Store, report: TradeoffReport, tmp_path: Path
) -> None:
    assert report.recommendation is not None
    text = recommended_sweep(store, report, tmp_path, seeds=3)
    ask = read_request(text, "rerun", tmp_path / "rerun", folder=tmp_path, workers=0)
    manifest = run_sweep(ask, lambda *_: None, lambda _: None)
    assert manifest.runs == 3 * 3
    assert manifest.expectations == {"met": 9}
    again = Store.open(ask.store).table.to_pylist()
    for name, value in report.recommendation.configuration.items():
        assert {row[name] for row in again} == {value}
    assert {(row["angle"], row["gravity"]) for row in again} == {(60, 5), (60, 10), (120, 5)}
    assert not {row["seed"] for row in again} & set(store.table["seed"].to_pylist())
    assert {row["duration"] for row in again} == {0.3}
    assert {row["scene_hash"] for row in again} == set(store.table["scene_hash"].to_pylist())


@pytest.mark.timed
def test_the_rerun_of_a_tolerance_that_is_too_strict_fails(
    store: Store, report: TradeoffReport, tmp_path: Path
) -> None:
    strict = report.model_copy(update={"tolerances": {"oracle_error": 1e-15}})
    text = recommended_sweep(store, strict, tmp_path, seeds=1)
    ask = read_request(text, "rerun", tmp_path / "rerun", folder=tmp_path, workers=0)
    manifest = run_sweep(ask, lambda *_: None, lambda _: None)
    assert manifest.expectations == {"unmet": 3}


def test_a_model_file_of_ones_own_is_run_again_from_the_stores_copy(
    written: Written, tmp_path: Path
) -> None:
    model = tmp_path / "own.xml"
    model.write_text((resources.MODELS / "free_fall" / "scene.xml").read_text())
    found = written(
        f'version: 1\nscene: "{model}"\ndrive: none\naxes: {{timestep: [1.0e-3, 2.0e-3]}}\n'
    )
    model.unlink()
    own = analyze_tradeoff(found, Criteria(metric="energy_drift"))
    text = recommended_sweep(found, own, found.path.parent, seeds=1)
    assert f'scene: "./{found.path.name}/scenes/' in text
    ask = read_request(text, "again", tmp_path / "again", folder=found.path.parent, workers=0)
    assert run_sweep(ask, lambda *_: None, lambda _: None).runs == 1
