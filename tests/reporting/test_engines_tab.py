"""The tab of engines: how far paired runs are apart, what they cost, and a report of parity."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.reporting.conftest import run

from contactlab.errors import StoreError
from contactlab.page.engine_parts import engine_parts, engines_sentence
from contactlab.page.report_files import write_page
from contactlab.reporting.report import PageRequest, read_report_data
from contactlab.store.finished_store import Store
from contactlab.studies.parity.parity_report import Divergence, Measured, ParityReport, RunParity

pytestmark = pytest.mark.long

# More heights than a map has columns: pairs are of exact values, not of bins.
BOTH = """
version: 1
scene: ball_drop
duration: 0.3
trace: none
checks: none
axes:
  engine: [mujoco, impulse]
  timestep: [1.0e-3, 2.0e-3]
  drop_height: {linspace: [0.05, 0.3, 41]}
"""


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return run(BOTH, tmp_path_factory.mktemp("both"))


def test_the_gate_is_that_of_runs_that_differ_in_their_engine_alone(both: Store) -> None:
    parts = engine_parts(read_report_data(both), None)
    assert parts is not None
    by_axes: dict[tuple[Any, ...], dict[str, tuple[float, float]]] = {}
    for record in both.records():
        key = record.axes["timestep"], record.axes["drop_height"]
        told = float(record.label == "stable"), record.metrics["penetration_mean"]
        by_axes.setdefault(key, {})[record.engine.name] = told[0], float(told[1] or 0)
    assert len(by_axes) == 82
    pairs = [(each["mujoco"], each["impulse"]) for each in by_axes.values()]
    for place, row in enumerate(parts.gate):
        ours, theirs = (np.array([pair[side][place] for pair in pairs]) for side in (0, 1))
        shares = np.abs(theirs - ours) / (1.0 if row.quantity == "success" else ours)
        assert (row.engine, row.pairs) == ("impulse", 82)
        assert (row.mean, row.worst) == pytest.approx((shares.mean(), shares.max()))
        assert (row.verdict == "within") == (shares.max() <= 0.05)
    # The impulse law has no depth at all.
    assert [each.quantity for each in parts.gate] == ["success", "penetration_mean"]
    assert parts.gate[1].verdict == "beyond"
    said = engines_sentence(parts)
    assert "penetration_mean differs by 100 % on average with impulse, by 100 % at worst" in said


def test_costs_are_medians_of_each_engine_over_mujoco(both: Store) -> None:
    parts = engine_parts(read_report_data(both), None)
    assert parts is not None
    costs: dict[str, list[float]] = {}
    for record in both.records():
        assert record.cost is not None
        costs.setdefault(record.engine.name, []).append(record.cost.cpu_per_sim_s)
    ours, theirs = parts.costs
    assert (ours.name, ours.runs, ours.ratio, theirs.name) == ("mujoco", 82, 1.0, "impulse")
    assert theirs.cost == pytest.approx(np.median(costs["impulse"]), rel=1e-6)
    assert theirs.ratio == pytest.approx(theirs.cost / ours.cost)


def parity(store: Store, **changes: Any) -> ParityReport:
    """Return a report of the impulse law's runs, the first of which differs."""
    ids = [each.run_id for each in store.records() if each.engine.name == "impulse"]
    share = Measured(
        mujoco=2.0, engine=2.2, rounded_mujoco=2.0, difference=0.1, above_tolerance=True
    )
    runs = [
        RunParity(run_id=each, axes={"timestep": 0.001}, seed=0, verdict="same", position=1e-12)
        for each in ids
    ]
    first = Divergence(stage="contacts", quantity="count of <a> - b", step=4, mujoco=8, engine=4)
    differs = {"verdict": "different", "first_divergence": first, "measured": {"energy": share}}
    told = {"sweep": "tried", "scene": "ball_drop", "engine": "impulse", "version": "1",
            "mujoco": "4", "device": "", "exit_code": 1, "headline": "impulse differs",
            "verdicts": {}, "findings": (), "closed_form": None,
            "runs": (runs[0].model_copy(update=differs), *runs[1:])}  # fmt: skip
    return ParityReport.model_validate(told | changes)


def test_a_report_of_parity_is_shown_worst_first(both: Store, tmp_path: Path) -> None:
    file, page = tmp_path / "parity.json", tmp_path / "page.html"
    report = parity(both)
    file.write_text(report.model_dump_json())
    parts = engine_parts(read_report_data(both), file)
    assert parts is not None
    assert parts.parity == report
    assert [(each.quantity, each.worst) for each in parts.gate] == [("energy", 0.1)]
    write_page(both, page, PageRequest(traces=0, parity=file))
    text = page.read_text()
    assert "✗ impulse differs." in text
    assert "contacts: count of &lt;a&gt; - b at step 4, 8 -&gt; 4" in text
    assert "<a> - b" not in text
    rows = text[text.index("Runs, the worst first") :]
    assert rows.index(report.runs[0].run_id) < rows.index(report.runs[1].run_id)
    assert "and 42 more" in rows


def test_what_is_no_report_of_the_store_is_refused(both: Store, tmp_path: Path) -> None:
    data, file = read_report_data(both), tmp_path / "parity.json"
    with pytest.raises(StoreError, match="cannot read"):
        engine_parts(data, file)
    file.write_text("{}")
    with pytest.raises(StoreError, match="--against ENGINE --format json"):
        engine_parts(data, file)
    file.write_text(parity(both, scene="incline").model_dump_json())
    with pytest.raises(StoreError, match="is of incline, the store of ball_drop"):
        engine_parts(data, file)


def test_a_store_of_one_engine_has_no_such_tab(both: Store, tmp_path: Path) -> None:
    alone = run(BOTH.replace("[mujoco, impulse]", "[mujoco]"), tmp_path)
    assert engine_parts(read_report_data(alone), None) is None
    write_page(alone, tmp_path / "page.html", PageRequest(traces=0))
    assert 'href="#engines"' not in (tmp_path / "page.html").read_text()
    write_page(both, tmp_path / "page.html", PageRequest(traces=0))
    assert 'href="#engines"' in (tmp_path / "page.html").read_text()
