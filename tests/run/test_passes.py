"""A sweep that is stopped in a pass after its runs goes on there, and ends as one that was not."""

from collections.abc import Callable, Sequence
from contextlib import chdir
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from tests.run.spoiled_workers import spoil_workers

from contactlab.run.tasks import FinishedRun
from contactlab.store.verify_store import find_problems


class StopError(Exception):
    """Ends a sweep from its progress callback."""


class Stop:
    """Gives up when so many runs were told of in a pass."""

    def __init__(self, label: str, after: int) -> None:
        self.label, self.left = label, after

    def __call__(self, finished: Sequence[FinishedRun]) -> None:
        self.left -= sum(each.label == self.label for each in finished)
        if self.left <= 0:
            raise StopError


PASSES = """
version: 1
scene: ball_drop
duration: 0.1
seeds: 3
axes:
  timestep: [2.0e-3, 3.0e-3]
  drop_height: [0.01, 0.02]
accuracy: {refine: 2}
timing: {}
"""


pytestmark = pytest.mark.usefixtures("_short_clocks")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, make_sweeper: Callable[[Path], Any]) -> Any:
    sweeper = make_sweeper(tmp_path_factory.mktemp("whole"))
    with pytest.MonkeyPatch.context() as patch, chdir(sweeper.folder):
        for name in ("MIN_SECONDS", "MAX_SECONDS", "STEP_SECONDS"):
            patch.setattr(f"contactlab.accuracy.timing.{name}", 1e-4)
        sweeper.run(PASSES)
    return sweeper.outcome()


@pytest.mark.long
@pytest.mark.parametrize(
    ("label", "after", "workers"),
    [
        pytest.param("compared with references", 5, 0, marks=pytest.mark.night),
        pytest.param("compared with references", 5, 2, marks=pytest.mark.night),
        ("counted", 1, 0),
        pytest.param("counted", 12, 2, marks=pytest.mark.night),
        pytest.param("timed", 7, 0, marks=pytest.mark.night),
    ],
)
def test_stopped_in_a_pass_it_goes_on(
    sweeper: Any, whole: Any, label: str, after: int, workers: int
) -> None:
    with pytest.raises(StopError):
        sweeper.run(PASSES, workers=workers, progress=Stop(label, after))
    store = sweeper.folder / "store"
    assert not (store / "manifest.json").exists()
    sweeper.run(PASSES, workers=workers)
    assert sweeper.began[0] == (12, 12), "no run is made again"
    assert sweeper.outcome() == whole
    assert find_problems(store) == []
    assert not (store / "notes.jsonl").exists()


@pytest.mark.long
def test_torn_notes_are_made_again(sweeper: Any, whole: Any) -> None:
    with pytest.raises(StopError):
        sweeper.run(PASSES, progress=Stop("compared with references", 7))
    notes = sweeper.folder / "store" / "notes.jsonl"
    notes.write_bytes(notes.read_bytes()[:-10])
    sweeper.run(PASSES)
    assert sweeper.outcome() == whole


CULPRIT = """
import os, signal
from contactlab.run.worker import Worker
run = Worker.run

def deadly(self, job):
    if self._task.purpose == "{purpose}" and any(each.index == 7 for each in job):
        os.kill(os.getpid(), signal.SIGSEGV)
    return run(self, job)

Worker.run = deadly
"""


@pytest.mark.night
@pytest.mark.parametrize(
    ("purpose", "column"),
    [
        ("errors", "error_final"),
        pytest.param("work", "time_min", marks=pytest.mark.night),
    ],
)
def test_a_pass_that_ends_a_worker_leaves_its_runs_without(
    command: Any, sweeper: Any, purpose: str, column: str
) -> None:
    folder = sweeper.folder
    (folder / "passes.yaml").write_text(PASSES)
    spoil_workers(folder, CULPRIT.format(purpose=purpose))
    sweep = ("sweep", "passes.yaml", "-o", "store", "--workers", "2")
    code, _, err = command.run(*sweep, first=folder)
    assert code == 0, err
    found = pq.read_table(folder / "store" / "runs.parquet").to_pylist()
    without = [row["index"] for row in found if row[column] is None]
    assert 7 in without
    assert len(without) < len(found)
    assert all(row["label"] != "crashed" for row in found)
    assert find_problems(folder / "store") == []
