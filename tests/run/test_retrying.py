"""Runs that were lost are run again on request, and then nothing tells that they ever were."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.run.spoiled_workers import spoil_workers

from contactlab.errors import StoppedError
from contactlab.run.sweep_runner import run_sweep
from contactlab.run.tasks import Stop
from contactlab.store.verify_store import find_problems

# Workers die once a run's trace is written.
CULPRIT = """
import os, signal
from contactlab.run.worker import Worker
run = Worker.run

def deadly(self, job):
    found = run(self, job)
    if found and any(each.index in (7, 12) for each in job):
        os.kill(os.getpid(), signal.SIGKILL)
    return found

Worker.run = deadly
"""
EXTRA = """
tolerances: {error_final: 1.0e-9, penetration_max: 1.0}
accuracy: {refine: 2}
timing: {}
"""


@pytest.fixture
def lossy(command: Any, sweeper: Any, ball: str, tmp_path: Path) -> Any:
    """A store in which two runs crashed, and the same sweep's that nothing disturbed."""

    def lossy(text: str = ball) -> Path:
        (tmp_path / "small.yaml").write_text(text)
        spoil_workers(tmp_path, CULPRIT)
        sweep = ("sweep", "small.yaml", "-o", "store", "--workers", "1", "--format", "json")
        code, out, err = command.run(*sweep, first=tmp_path)
        assert code == 4, err
        assert json.loads(out)["statuses"] == {"ok": 16, "crashed": 2}
        sweeper.run(text, "quiet")
        # What the two left had been written when their workers died.
        assert find_problems(tmp_path / "store") == []
        return tmp_path / "store"

    return lossy


@pytest.mark.long
@pytest.mark.parametrize(
    "extra",
    [pytest.param("", id="runs"), pytest.param(EXTRA, id="passes", marks=pytest.mark.night)],
)
def test_only_failed_runs_are_run_again(
    lossy: Any, command: Any, sweeper: Any, ball: str, extra: str
) -> None:
    store = lossy(ball + extra)
    code, out, err = command.run("sweep", "small.yaml", "-o", "store", "--retry-failed")
    assert code == 0, err
    assert "16 of 18 runs are stored already" in err
    assert "18 runs, 18 traces in store" in out
    assert sweeper.outcome() == sweeper.outcome("quiet")
    assert find_problems(store) == []
    before = (store / "manifest.json").stat().st_mtime_ns
    sweeper.began = []
    run_sweep(replace(sweeper.ask(ball + extra), retry_failed=True), began(sweeper), lambda _: None)
    assert sweeper.began == [(18, 18)]
    assert (store / "manifest.json").stat().st_mtime_ns == before


def began(sweeper: Any) -> Any:
    return lambda total, done, *_: sweeper.began.append((total, done))


@pytest.mark.night
def test_a_retry_may_be_interrupted_and_goes_on(lossy: Any, sweeper: Any, ball: str) -> None:
    store = lossy()
    stop = Stop()
    stop.request_stop()
    with pytest.raises(StoppedError):
        run_sweep(
            replace(sweeper.ask(ball), retry_failed=True), began(sweeper), lambda _: None, stop
        )
    assert not (store / "manifest.json").exists()
    sweeper.run(ball)
    assert sweeper.began == [(18, 16)]
    assert sweeper.outcome() == sweeper.outcome("quiet")
    assert find_problems(store) == []
