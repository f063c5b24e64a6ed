"""Shipped trade-offs: what they recommend holds again from ten fresh seeds."""

from collections.abc import Callable
from pathlib import Path

import pytest

from contactlab import resources
from contactlab.accuracy import timing
from contactlab.pareto.analysis import analyze_tradeoff
from contactlab.pareto.configuration_export import recommended_sweep
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.finished_store import Store

Weighed = Callable[[str], tuple[Store, TradeoffReport]]
pytestmark = pytest.mark.night


def run(source: Path | str, store: Path) -> Store:
    folder = source.parent if isinstance(source, Path) else store.parent
    ask = read_request(source, store.name, store, folder=folder, workers=2)
    run_sweep(ask, lambda *_: None, lambda _: None)
    return Store.open(store)


@pytest.fixture(autouse=True)
def _short_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """Measure times coarsely: what is expected here does not depend on them."""
    for name in ("MIN_SECONDS", "MAX_SECONDS", "STEP_SECONDS"):
        monkeypatch.setattr(timing, name, 1e-3)


@pytest.fixture(scope="module")
def weighed(tmp_path_factory: pytest.TempPathFactory) -> Weighed:
    """Return the store and the report of a shipped sweep, which runs once."""
    done: dict[str, tuple[Store, TradeoffReport]] = {}

    def of(name: str) -> tuple[Store, TradeoffReport]:
        if name not in done:
            store = run(resources.sweep_file(name), tmp_path_factory.mktemp(name) / "store")
            done[name] = store, analyze_tradeoff(store)
        return done[name]

    return of


@pytest.mark.parametrize("name", ["tradeoff-slide", "tradeoff-rolling"])
def test_the_recommendation_holds_from_fresh_seeds(
    weighed: Weighed, tmp_path: Path, name: str
) -> None:
    store, report = weighed(name)
    assert report.time.source == "timing"
    again = analyze_tradeoff(run(recommended_sweep(store, report, tmp_path), tmp_path / "again"))
    (only,) = again.configurations
    assert only.feasible, only.reasons
    assert again.runs_per_configuration >= 10
    assert store.manifest.expectations.get("unmet", 0) == 0


def test_rolling_ends_on_a_floor_that_no_timestep_lowers(weighed: Weighed) -> None:
    """The error published for RK4 at 1 ms is 2.7e-3, and halving the step twice leaves 2.4e-3.

    Balls that rattle spread it by 0.3e-3 (standard deviation) with RK4; three of these are allowed
    to either side.
    """
    _, report = weighed("tradeoff-rolling")
    floors = {each.name: each.floor for each in report.methods}
    assert floors["RK4"] is not None
    assert floors["RK4"].error == pytest.approx(2.4e-3, abs=0.9e-3)
    assert floors["RK4"].timestep >= 1e-3
    coarsest = max(
        each.error or 0
        for each in report.configurations
        if each.configuration["integrator"] == "Euler"
    )
    assert coarsest > 5 * floors["RK4"].error
