"""What a store keeps of the runs it was asked for."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

import contactlab
from contactlab.plan.kept_traces import OF_MANY, KeptTraces
from contactlab.run.sweep_request import read_request
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

SWEEP = """
version: 1
scene: ball_drop
duration: 0.3
axes:
  timestep: [2.0e-3, 2.0e-2]
  drop_height: [0.02, 0.1, 0.3]
"""


def rows(sweeper: Any, text: str) -> list[dict[str, Any]]:
    sweeper.run(text)
    store: Path = sweeper.folder / "store"
    assert find_problems(store) == []
    return Store.open(store).table.to_pylist()


def kept(found: list[dict[str, Any]]) -> list[int]:
    return [row["index"] for row in found if row["trace_file"] is not None]


@pytest.mark.long
@pytest.mark.parametrize(
    ("rule", "indices"),
    [
        ("all", range(6)),
        ("none", []),
        ("sample:1", [0]),
        ("sample:3", [0, 2, 4]),
        ("sample:4", [0, 2, 3, 5]),
        ("sample:9", range(6)),
    ],
)
def test_which_traces_are_kept(sweeper: Any, rule: str, indices: Sequence[int]) -> None:
    assert kept(rows(sweeper, f"{SWEEP}trace: {rule}\n")) == list(indices)


@pytest.mark.parametrize(("rule", "indices"), [("flagged", [1]), ("flagged+sample:1", [0, 1])])
def test_traces_of_flagged_runs_are_kept(sweeper: Any, rule: str, indices: Sequence[int]) -> None:
    """A pyramidal cone stops a box that slides across its axes too late."""
    axes = "axes: {cone: [elliptic, pyramidal], direction: [45.0]}"
    found = rows(sweeper, f"version: 1\nscene: box_slide\n{axes}\ntrace: {rule}\n")
    assert [row["label"] for row in found] == ["stable", "oracle_miss"]
    assert kept(found) == list(indices)


def test_traces_of_many_runs() -> None:
    """Above 100,000 runs those not stable and 1,000 others, unless the sweep says otherwise."""
    for seeds, told, rule in (
        (100_000, {}, "all"),
        (100_001, {}, OF_MANY),
        (100_001, {"trace": "all"}, "all"),
    ):
        sweep = {"version": 1, "scene": "ball_drop", "seeds": seeds, **told}
        asked = read_request(sweep, "many", Path("store"), folder=Path(), workers=0)
        assert asked.plan.sweep.trace == rule
    kept = KeptTraces.read_rule(OF_MANY)
    stable = [kept.keeps_trace(place, "stable", 100_001) for place in range(100_001)]
    assert sum(stable) == 1000
    assert all(kept.keeps_trace(place, "chatter", 100_001) for place in range(0, 100_001, 97))
    assert kept.share_bounds(100_001) == (1000 / 100_001, 1.0)


def test_a_shard_keeps_the_traces_that_the_whole_sweep_does(sweeper: Any) -> None:
    whole = kept(rows(sweeper, f"{SWEEP}trace: sample:4\n"))
    (sweeper.folder / "sweep.yaml").write_text(f"{SWEEP}trace: sample:4\n")
    shards = [
        contactlab.sweep(
            sweeper.folder / "sweep.yaml",
            shard=f"{number}/2",
            output=sweeper.folder / f"shard{number}",
            workers=0,
        )
        for number in (1, 2)
    ]
    assert sorted(place for each in shards for place in kept(each.table.to_pylist())) == whole


@pytest.mark.long
def test_equal_runs_run_once(sweeper: Any) -> None:
    found = rows(sweeper, f"{SWEEP}include:\n  - {{timestep: 2.0e-3, drop_height: 0.1}}\n")
    assert len(found) == 6


@pytest.mark.long
def test_settings_that_only_some_runs_have(sweeper: Any) -> None:
    rare = "geom_friction[ball,0]"
    included = f'{{timestep: 2.0e-3, drop_height: 0.2, "{rare}": 0.5}}'
    found = rows(sweeper, f"{SWEEP}include:\n  - {included}\n  - {{timestep: 1.0e-3}}\n")
    assert [row[rare] for row in found] == [None] * 6 + [0.5, None]
    assert [row["drop_height"] for row in found[-2:]] == [0.2, None]
    store = Store.open(sweeper.folder / "store")
    assert [rare in record.settings for record in store.records()] == [False] * 6 + [True, False]


@pytest.mark.long
def test_tolerances_and_the_latency_budget(sweeper: Any) -> None:
    found = rows(sweeper, f"{SWEEP}tolerances: {{penetration_max: 0.005}}\nlatency_budget: 1.0\n")
    for row in found:
        assert row["tolerances_met"] == (row["penetration_max"] <= 0.005)
        assert row["cost_latency_used"] == pytest.approx(row["cost_cpu_s"] / row["steps"])
        assert row["cost_cpu_per_sim_s"] == pytest.approx(row["cost_cpu_s"] / row["duration"])
    assert len({row["tolerances_met"] for row in found}) == 2
