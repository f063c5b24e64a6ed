"""A run that does not repeat is found; one that does is the reference."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.engines import Rollout
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.schema.check_report import CheckResult, Measure, Reference
from contactlab.schema.examination import Examination
from contactlab.store.finished_store import Store

Checked = Callable[..., Examination]
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
