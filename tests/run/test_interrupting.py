"""Told to stop once, a sweep ends the runs in flight; told twice, it does not wait for them."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from tests.run.spoiled_workers import spoil_workers

from contactlab.errors import OutputError, StoppedError
from contactlab.run.sweep_runner import run_sweep
from contactlab.run.tasks import FinishedRun, Stop
from contactlab.store.row_journal import read_lines
from contactlab.store.verify_store import find_problems

Until = Callable[[Callable[[], bool]], None]

# Jobs of 16 runs and more, by up to two workers.
MANY = """
version: 1
scene: ball_drop
duration: 0.05
seeds: 11
axes:
  timestep: [1.0e-3, 2.0e-3, 3.0e-3]
  drop_height: [0.02, 0.1]
"""
RUNS, LEAST_OF_JOB = 66, 16
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

# Has every run write a byte, and then wait, but not once more where it is checked.
SLOW = """
import ctypes, os, signal, time
from contextlib import contextmanager
from contactlab.run.planned_runs import Preparer
from contactlab.run.worker import Worker
watchdog = Preparer.start_watchdog
start = Worker.__init__

def starting(self, *arguments):
    start(self, *arguments)
    self._preparer.proceed = self._proceed

@contextmanager
def slow(self, times=1):
    with watchdog(self, times) as watch:
        def begin():
            with open({begun!r}, "ab") as file:
                file.write(b".")
            {wait}
            watch()
        yield begin if times == 1 else watch

Preparer.start_watchdog = slow
Worker.__init__ = starting
"""
# All but the first three runs end when their worker should stop.
UNTIL_STOPPED = """
            while os.path.getsize({begun!r}) > 3 and self.proceed():
                time.sleep(0.005)
"""
FINISHING = "finishing the current runs; interrupt again to stop at once\n"
INTERRUPTED = "interrupted; finished runs are kept: run the same command again to resume\n"


class Slow:
    """Sweeps whose runs each take long, as files tell of."""

    def __init__(self, command: Any, folder: Path) -> None:
        self.command, self.folder = command, folder
        (folder / "small.yaml").write_text(MANY)

    @property
    def begun(self) -> int:
        """How many runs have begun."""
        path = self.folder / "begun"
        return path.stat().st_size if path.exists() else 0

    @property
    def rows(self) -> list[dict[str, Any]]:
        """What is stored of an unfinished sweep."""
        return list(read_lines(self.folder / "store" / "journal.jsonl"))

    def start(self, workers: int, wait: str, *asked: str) -> subprocess.Popen[str]:
        """Start a command, or the sweep; each run begins with what Python is to `wait` with."""
        begun = str(self.folder / "begun")
        wait = wait.strip().format(begun=begun)
        spoil_workers(self.folder, SLOW.format(begun=begun, wait=wait), here=workers == 0)
        asked = asked or ("sweep", "small.yaml", "-o", "store")
        return self.command.start(*asked, "--workers", str(workers), first=self.folder)


@pytest.fixture
def slow(command: Any, tmp_path: Path) -> Slow:
    return Slow(command, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize(
    ("workers", "number", "tell"),
    [
        (1, signal.SIGINT, os.killpg),
        pytest.param(2, signal.SIGTERM, os.killpg, marks=pytest.mark.night),
        pytest.param(0, signal.SIGINT, os.kill, marks=pytest.mark.night),
        pytest.param(0, signal.SIGTERM, os.kill, marks=pytest.mark.night),
        pytest.param(1, signal.SIGTERM, os.kill, marks=pytest.mark.night),
        pytest.param(2, signal.SIGINT, os.kill, marks=pytest.mark.night),
    ],
)
def test_told_once_it_keeps_the_runs_in_flight(
    slow: Slow, sweeper: Any, until: Until, workers: int, number: signal.Signals, tell: Any
) -> None:
    process = slow.start(workers, UNTIL_STOPPED)
    until(lambda: slow.begun > 3)
    tell(process.pid, number)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, "", FINISHING + INTERRUPTED)
    until(lambda: slow.command.living(process.pid) == [])
    rows, store = slow.rows, slow.folder / "store"
    assert len(rows) == slow.begun < LEAST_OF_JOB, "whole jobs were run"
    assert {each["trace_file"] for each in rows} == {
        path.relative_to(store).as_posix() for path in store.rglob("*.mcap*")
    }
    assert_goes_on(sweeper, len(rows))


def assert_goes_on(sweeper: Any, stored: int) -> None:
    """Copy the store, run the rest there, and compare with a sweep that nothing stopped."""
    shutil.copytree(sweeper.folder / "store", sweeper.folder / "elsewhere")
    sweeper.run(MANY, "elsewhere")
    assert sweeper.began == [(RUNS, stored)]
    sweeper.run(MANY, "whole")
    assert sweeper.outcome("elsewhere") == sweeper.outcome("whole")
    assert find_problems(sweeper.folder / "elsewhere") == []


@pytest.mark.night
@pytest.mark.parametrize(
    "asked",
    [("stability", "free_fall"), ("tradeoff", "small.yaml")],
    ids=["stability", "tradeoff"],
)
def test_every_command_that_sweeps_can_be_told(
    slow: Slow, until: Until, asked: Sequence[str]
) -> None:
    process = slow.start(1, UNTIL_STOPPED, *asked)
    until(lambda: slow.begun > 0)
    os.killpg(process.pid, signal.SIGTERM)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, ""), err
    *_, finishing, interrupted = err.splitlines(keepends=True)
    assert finishing == FINISHING
    assert interrupted == INTERRUPTED
    until(lambda: slow.command.living(process.pid) == [])


@pytest.mark.long
@pytest.mark.parametrize(
    ("workers", "numbers", "tell"),
    [
        (2, (signal.SIGINT, signal.SIGINT), os.killpg),
        pytest.param(1, (signal.SIGTERM, signal.SIGTERM), os.killpg, marks=pytest.mark.night),
        pytest.param(1, (signal.SIGTERM, signal.SIGINT), os.kill, marks=pytest.mark.night),
    ],
)
def test_told_twice_it_stops_at_once(
    slow: Slow, until: Until, workers: int, numbers: tuple[int, int], tell: Any
) -> None:
    process = slow.start(workers, "signal.pause()")
    until(lambda: slow.begun == workers)
    first, second = numbers
    all_of_them = slow.command.living(process.pid)
    tell(process.pid, first)
    assert process.stderr
    assert process.stderr.readline() == FINISHING
    assert slow.command.living(process.pid) == all_of_them, "a helper did not ignore the signal"
    began = time.monotonic()
    tell(process.pid, second)
    out, err = process.communicate(timeout=60)
    assert time.monotonic() - began < 30
    assert (process.returncode, out, err) == (130, "", INTERRUPTED)
    until(lambda: slow.command.living(process.pid) == [])
    assert slow.rows == []


@pytest.mark.long
def test_a_worker_within_a_long_call_ends_with_its_parent(slow: Slow, until: Until) -> None:
    """A library loaded as Python's own keeps all of Python waiting while it pauses."""
    process = slow.start(2, "ctypes.PyDLL(None).pause()")
    until(lambda: slow.begun == 2)
    process.kill()
    process.communicate(timeout=60)
    until(lambda: slow.command.living(process.pid) == [])


@pytest.mark.long
def test_one_sweep_a_store(slow: Slow, sweeper: Any, until: Until) -> None:
    process = slow.start(1, "signal.pause()")
    until(lambda: slow.begun == 1)
    with pytest.raises(OutputError, match="store is in use by another sweep; wait or use -o"):
        sweeper.run(MANY)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate(timeout=60)
    assert (slow.folder / "store" / ".lock").exists()
    sweeper.run(MANY)
    assert find_problems(slow.folder / "store") == []


class After:
    """Wishes to stop when so many runs were told of."""

    def __init__(self, label: str, count: int) -> None:
        self.label, self.left, self.stop = label, count, Stop()
        self.told = 0

    def __call__(self, finished: Sequence[FinishedRun]) -> None:
        self.told += len(finished)
        self.left -= sum(each.label == self.label for each in finished)
        if self.left <= 0:
            self.stop.request_stop()


@pytest.mark.night
@pytest.mark.parametrize("workers", [0, pytest.param(1, marks=pytest.mark.night), 2])
@pytest.mark.parametrize("label", ["compared with references", "counted"])
@pytest.mark.usefixtures("_short_clocks")
def test_a_pass_stops_and_goes_on(sweeper: Any, label: str, workers: int) -> None:
    sweeper.run(PASSES, "whole")
    after = After(label, 1)
    with pytest.raises(StoppedError, match="run the same command again to resume"):
        run_sweep(sweeper.ask(PASSES, workers=workers), lambda *_: None, after, after.stop)
    sweeper.run(PASSES)
    first, *passes = sweeper.began
    assert first == (12, 12), "runs were made again"
    assert sum(done for _, done in passes) > 0
    assert sweeper.outcome() == sweeper.outcome("whole")
