"""A plug-in of one file adds one entry of each kind, and each is shown where ours are."""

from pathlib import Path

import pytest
from tests.explain.printed_words import definition_text
from typer.testing import CliRunner

from contactlab.command_line.main import command_line
from contactlab.commands.report import report
from contactlab.plugins import load_plugins
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

pytestmark = pytest.mark.usefixtures("forgotten")

COLOUR, LETTER = "#7a4e8a", "j"
ADVICE = "start the body lower"
SOURCE = f'''
import numpy as np

from contactlab.plugin import (
    Buffers, Context, Floats, Limit, Measured, MeasuredRuns, Onset, Onsets, PreparedRuns,
    Proceed, Rollout, SimulationEngine, Threshold, Watch, check, engine, label, metric, no_limit,
    proceed_always,
)


@metric(unit="m", better="lower")
def start_height(context: Context) -> Floats:
    """Height of the first body at the start."""
    return context.trace.qpos[:, 0, 2]


@label(
    "bad",
    rank=20,
    letter="{LETTER}",
    colour="{COLOUR}",
    advice="{ADVICE}",
    thresholds=(Threshold("start_height", 0.01, "m", "Largest height at the start."),),
)
def too_high(runs: MeasuredRuns) -> Onsets:
    """A body starts higher than accepted."""
    found = runs.over("start_height")
    return {{run: Onset(f"it starts at {{high:g}} m", 0) for run, high, _ in found}}


@check("degrees", question="at most two degrees", limits=(Limit("dofs", "1", "gate", 2),))
def degrees(checked):
    return Measured([checked.measure("dofs", float(checked.base.model.nv))])


@engine
class StillEngine(SimulationEngine):
    """Keeps every body where it starts, and counts time."""

    name = "still"
    summary = "nothing moves"

    @property
    def version(self) -> str:
        return "1"

    def roll_out(self, runs: PreparedRuns, buffers: Buffers, watch: Watch = no_limit,
                 proceed: Proceed = proceed_always) -> Rollout:
        steps, count = runs.steps, len(runs.prepared)
        arrays = buffers.arrays(runs.models[0], count, steps)
        arrays.state[:], arrays.sensors[:], arrays.iterations[:] = 0, 0, 0
        for run, model in enumerate(runs.models):
            arrays.state[run, :, 0] = model.opt.timestep * np.arange(steps + 1)
            arrays.state[run, :, 1 : 1 + model.nq] = runs.starts.qpos[run]
        return Rollout(
            state=arrays.state, sensors=arrays.sensors, iterations=arrays.iterations,
            steps=(steps,) * count, cost=np.full(count, np.nan),
            warnings=({{}},) * count, errors=(None,) * count,
        )
'''
SWEEP = """\
version: 1
scene: ball_drop
duration: 0.02
trace: none
axes: {engine: [mujoco, still]}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "high.py"
    path.write_text(SOURCE)
    return path


@pytest.fixture
def store(file: Path, tmp_path: Path) -> Store:
    load_plugins([file])
    request = read_request(SWEEP, "small", tmp_path / "store", folder=tmp_path, workers=0)
    run_sweep(request, lambda *_: None, lambda _finished: None)
    return Store.open(tmp_path / "store")


def test_a_sweep_has_its_engine_metric_and_label(store: Store) -> None:
    records = list(store.records())
    assert {record.engine.name for record in records} == {"mujoco", "still"}
    for record in records:
        height = record.metrics["start_height"]
        assert height == record.initial.qpos[2]
        assert record.label == "too_high"
        assert record.labels[0].reason == f"it starts at {height:g} m"
    assert find_problems(store.path) == []


def test_explain_gives_its_meaning_advice_and_limit(file: Path) -> None:
    load_plugins([file])
    text = definition_text("too_high")
    assert "A body starts higher than accepted." in text
    assert f"change: {ADVICE}" in text
    assert "limit start_height: 0.01 m" in text
    assert f"over it, a run is too_high: {ADVICE}" in definition_text("start_height")


@pytest.mark.long
def test_the_page_shows_it_without_the_plugin(store: Store, tmp_path: Path) -> None:
    from contactlab.measure import LABELS, METRICS  # noqa: PLC0415 - as the plug-in left them

    del LABELS["too_high"], METRICS["start_height"]
    page = report(store.path, output=tmp_path / "page.html").read_text(encoding="utf-8")
    row = page[page.index('<th scope="row">too_high') - 500 :][:1200]
    assert f"{COLOUR})" in row
    assert f">{LETTER}</text>" in row
    assert "A body starts higher than accepted." in row
    assert f"Change: {ADVICE}." in row


@pytest.mark.long
def test_check_asks_its_question(file: Path, tmp_path: Path) -> None:
    words = ["examine", "ball_drop", "--plugin", str(file), "--check", "degrees"]
    done = CliRunner().invoke(command_line(), [*words, "-o", str(tmp_path / "checked")])
    assert "dofs 6 (limit 2)" in done.output, done.output
    assert done.exit_code == 1
