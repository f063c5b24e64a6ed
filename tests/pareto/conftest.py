"""Runs made by hand: what came of each is written down, not simulated."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from contactlab.pareto.analysis import analyze_tradeoff
from contactlab.pareto.configurations import (
    EvaluatedConfiguration,
    ResolvedCriteria,
    StoredRuns,
    evaluate_configurations,
    group_runs,
)
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.schema.tradeoff_report import ErrorMeasure, TimeMeasure, TradeoffReport
from contactlab.store.finished_store import Store
from contactlab.store.run_columns import CodedColumn

Rows = Sequence[dict[str, Any]]
SWEEP = """
version: 1
scene: double_pendulum
duration: 0.3
seeds: 2
axes:
  timestep: [1.0e-3, 2.0e-3, 4.0e-3, 8.0e-3]
  integrator: [Euler, RK4]
  angle: {values: [60, 120], role: scenario}
  gravity: {values: [5, 10], role: scenario}
exclude: [{gravity: 10, angle: 120}]
effects: {warmstart: false}
tolerances: {oracle_error: 0.1%}
trace: none
"""
_FIXED = ("seed", "label", "scenario")


def coded(values: Sequence[Any]) -> CodedColumn:
    """Return a column of n values."""
    known = list(dict.fromkeys(values))
    return CodedColumn(np.array([known.index(each) for each in values]), tuple(known))


def make_runs(rows: Rows, knobs: Sequence[str] = ("timestep",)) -> StoredRuns:
    """Return runs of which each row names its knobs, seed, label, scenario and numbers."""
    numbers = dict.fromkeys(name for row in rows for name in row)
    return StoredRuns(
        knobs={name: coded([row[name] for row in rows]) for name in knobs},
        scenarios={"scenario": coded([row.get("scenario", 0) for row in rows])},
        seeds=coded([row.get("seed", 0) for row in rows]),
        labels=coded([row.get("label", "stable") for row in rows]),
        numbers={
            name: np.array([row.get(name, np.nan) for row in rows], dtype=float)
            for name in numbers
            if name not in {*_FIXED, *knobs}
        },
    )


def make_weighing(error: str = "oracle_error", **tolerances: float) -> ResolvedCriteria:
    """Return what to weigh by: times of a timing pass, and an error."""
    kind = "discretization" if error.startswith("error_") else "modeling"
    return ResolvedCriteria(
        ErrorMeasure(name=error, unit="1", kind=kind, against=None, resolution=0.0),
        TimeMeasure(name="time_median", source="timing", spread=0.0),
        tolerances,
    )


def make_weighed(
    rows: Rows, knobs: Sequence[str] = ("timestep",), error: str = "oracle_error", **limits: float
) -> list[EvaluatedConfiguration]:
    """Return the configurations of rows."""
    runs = make_runs(rows, knobs)
    return evaluate_configurations(runs, make_weighing(error, **limits), group_runs(runs))


@pytest.fixture(scope="session")
def runs_of() -> Callable[..., StoredRuns]:
    return make_runs


@pytest.fixture(scope="session")
def weighed() -> Callable[..., list[EvaluatedConfiguration]]:
    return make_weighed


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Store]:
    """Run a sweep, given as text, into a store."""

    def run(text: str = SWEEP) -> Store:
        folder = tmp_path_factory.mktemp("tradeoff")
        ask = read_request(text, "tried", folder / "store", folder=folder, workers=0)
        run_sweep(ask, lambda *_: None, lambda _: None)
        return Store.open(ask.store)

    return run


@pytest.fixture(scope="session")
def store(written: Callable[..., Store]) -> Store:
    return written()


@pytest.fixture(scope="session")
def report(store: Store) -> TradeoffReport:
    return analyze_tradeoff(store)
