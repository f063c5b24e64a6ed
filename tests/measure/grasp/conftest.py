"""Grips, drops and strikes: one run measured by itself, and shipped sweeps run once."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.parquet as pq
import pytest

from contactlab import resources
from contactlab.contact.trace_arrays import PairSeries, Trace
from contactlab.engines import Buffers
from contactlab.engines.mujoco_batch import roll_out
from contactlab.engines.rollout_trace import make_trace
from contactlab.measure import assess_runs
from contactlab.plan.overrides import Overrides
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.scene.compiled_scene import PreparedModel
from contactlab.scene.run_setup import make_setup
from contactlab.scene.scene import Scene

Rows = list[dict[str, Any]]


class Measured(NamedTuple):
    """One run: its metrics, labels, net quantities of its pairs, arrays and model."""

    metrics: dict[str, float]
    labels: list[str]
    series: tuple[PairSeries, ...]
    trace: Trace
    prepared: PreparedModel


@pytest.fixture(scope="session")
def measured() -> Callable[..., Measured]:
    """Return what runs one run of a scene and measures it."""
    scenes: dict[str, Scene] = {}

    def measure(name: str, **values: Any) -> Measured:
        scene = scenes.setdefault(name, Scene.open(name))
        run = scene.resolve(values, 0, None)
        base = scene.base(run.structure)
        prepared = base.prepare(run.list_edits())
        rollout = roll_out([prepared.model], scene.initial_states([run]), run.steps, Buffers())
        trace = make_trace(base, [prepared], rollout)
        setup = make_setup(base, scene.source.manifest, [run], [prepared.model], {})
        found = assess_runs(trace, setup)
        return Measured(
            metrics={key: float(column[0]) for key, column in found.metrics.items()},
            labels=[each.label for each in found.labels[0]],
            series=found.series,
            trace=trace,
            prepared=prepared,
        )

    return measure


@pytest.fixture(scope="session")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Rows]:
    """Return the rows of a shipped sweep that have the given values; each sweep runs once.

    It may be changed in ways that take less time: `["checks=none"]`.
    """
    tables: dict[str, Rows] = {}

    def rows(name: str, less: Sequence[str] = (), **values: object) -> Rows:
        if name not in tables:
            store = tmp_path_factory.mktemp(name) / "store"
            tables[name] = _run(resources.sweep_file(name), store, less)
        found = [row for row in tables[name] if all(row[key] == values[key] for key in values)]
        assert found
        return found

    return rows


def _run(sweep: Path, store: Path, less: Sequence[str]) -> Rows:
    overrides = Overrides(("trace=none", *less), ())
    ask = read_request(
        sweep, sweep.stem, store, folder=sweep.parent, workers=0, overrides=overrides
    )
    run_sweep(ask, lambda *_: None, lambda _finished: None)
    return pq.read_table(store / "runs.parquet").to_pylist()
