"""A run that does not repeat is found; one that does is the reference."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.engines import Rollout
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.schema.check_report import CheckReport, CheckResult, Measure, Reference
from contactlab.store.finished_store import Store
from contactlab.studies.check import checked_model

Checked = Callable[..., CheckReport]
One = Callable[..., CheckResult]
Missed = Callable[[CheckResult], list[Measure]]


def test_the_reference_is_the_run(checked: Checked, tmp_path: Path) -> None:
    checked("ball_drop", "repeat", assign=("duration=0.3", "drop_height=0.05"))
    text = (tmp_path / "check/reference.json").read_text()
    reference = Reference.model_validate_json(text)
    store = Store.open(tmp_path / "check" / reference.store)
    record = store.record(reference.run_id)
    assert reference.trajectory_hash == record.trajectory_hash
    assert reference.tolerance == 0.05
    assert reference.success == (record.label == "stable")
    assert reference.metrics["penetration_mean"] == record.metrics["penetration_mean"]
    assert reference.metrics["energy_drift"] == record.metrics["energy_drift"]
    assert reference.settings == record.settings
    assert set(reference.units) == set(reference.resolution) == set(reference.metrics)
    again = Store.open(tmp_path / "check/repeat").record(reference.run_id)
    assert again.trajectory_hash == record.trajectory_hash


def test_a_run_that_differs_elsewhere_is_found(
    one: One, missed: Missed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last bit of one coordinate of this process's own run is changed."""
    roll_out = MujocoEngine.roll_out

    def bent(*arguments: Any, **options: Any) -> Rollout:
        rollout = roll_out(*arguments, **options)
        rollout.state[0, -1, 1] += 2.0**-40
        return rollout

    monkeypatch.setattr(MujocoEngine, "roll_out", bent)
    found = one("ball_drop", "repeat", "duration=0.1", "drop_height=0.5")
    assert found.verdict == "fail"
    assert {each.of for each in missed(found)} == {"in another process", "in the same process"}


@pytest.mark.long
def test_a_bare_model_runs_no_longer_than_it_may(
    checked: Checked, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """100 steps of 0.002 s, of the 3 s that bare models take, unless more are asked for."""
    monkeypatch.setattr(checked_model, "_MOST_STEPS", 100)
    model = '<mujoco><worldbody><body><joint/><geom size=".1"/></body></worldbody></mujoco>'
    for assign, steps in ((), 100), (("duration=0.5",), 250):
        report = checked(model, "repeat", assign=assign)
        said = "runs take 0.2 s, not 3: longer ones take more than 100 steps"
        assert any(note.startswith(said) for note in report.notes) == (steps == 100)
        records = list(Store.open(tmp_path / "check/run").records())
        assert [record.steps for record in records] == [steps] * len(report.task.seeds)
