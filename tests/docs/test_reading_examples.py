"""The examples of docs/reference/evidence.md run as they stand there, on a store of real runs."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactlab.errors import StoreError
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store

TEXT = (Path(__file__).parents[2] / "docs/reference/evidence.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
SWEEP = """
version: 1
scene: ball_drop
duration: 0.3
axes: {timestep: [2.0e-3, 2.0e-2], drop_height: [0.02, 0.3]}
"""


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    folder = tmp_path_factory.mktemp("examples")
    ask = read_request(SWEEP, "bounce", folder / "results/bounce", folder=folder, workers=0)
    run_sweep(ask, begin=lambda *_: None, progress=lambda _: None)
    return Store.open(ask.store)


@pytest.fixture
def example(store: Store, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Run the example that imports something, where the store is; return what it defined."""
    monkeypatch.chdir(store.path.parents[1])

    def run(imports: str) -> dict[str, Any]:
        [code] = [each for each in EXAMPLES if imports in each]
        names: dict[str, Any] = {}
        exec(code, names)  # noqa: S102 - it is ours
        return names

    return run


def test_every_example_is_run() -> None:
    assert len(EXAMPLES) == 3


@pytest.mark.long
def test_own_means(example: Any, store: Store) -> None:
    found = example("import contactlab")
    assert found["bounce"].units["timestep"] == "s"
    assert found["errors"].shape == (4,)
    # Up to the last step, what the floor gives the ball is its change of momentum and its weight.
    trace = found["trace"]
    errors = [each.metrics["oracle_error"] or 0 for each in store.records()]
    assert found["record"].metrics["oracle_error"] == max(errors)
    gained = trace.qvel[-1, 2] - trace.qvel[0, 2] + 9.81 * trace.time[-1]
    assert found["impulse"] == pytest.approx(gained, rel=1e-6)
    for name in trace.units:
        values = getattr(trace, name)
        assert values is None or len(values) in (len(trace.time), len(trace.time) - 1)
    assert all(len(getattr(found["pair"], name)) for name in found["pair"].units)


@pytest.mark.long
def test_duckdb_and_polars_agree(example: Any, store: Store) -> None:
    by_duckdb, by_polars = example("import duckdb"), example("import polars")
    counts = {(each[0], each[1]): each[2] for each in by_duckdb["by_timestep"]}
    assert {(each[0], each[1]): each[2] for each in by_polars["shares"].iter_rows()} == counts
    assert sum(counts.values()) == len(by_duckdb["solrefs"]) == 4
    assert '"timestep": {"unit": "s"' in by_duckdb["units"][0][0]
    tunnels = [each.run_id for each in store.records() if "tunneling" in str(each.labels)]
    assert by_polars["fell_through"]["run_id"].to_list() == tunnels


def test_columns_have_the_units_of_the_table(store: Store) -> None:
    table = store.table
    for name, unit in store.units.items():
        assert (table.field(name).metadata or {})[b"unit"] == unit.encode()
    for name in ("timestep", "drop_height", "penetration_max", "cost_cpu_s", "duration"):
        values = store.columns.numbers(name).values
        np.testing.assert_array_equal(values, table[name].to_numpy())
        assert store.units[name] in ("s", "m")


def test_a_trace_is_found_by_the_start_of_its_run(store: Store) -> None:
    record = next(store.records())
    np.testing.assert_array_equal(
        store.trace(record.run_id[:8]).qpos, store.trace(record).qpos, strict=True
    )
    with pytest.raises(StoreError, match="no pair 'floor-bal' was recorded; did you mean"):
        store.trace(record).pair("floor-bal")
    with pytest.raises(StoreError, match="no pair 'x' was recorded; recorded pairs: floor-ball"):
        store.trace(record).pair("x")
