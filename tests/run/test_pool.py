"""A worker that dies takes with it what it was on, and nothing else."""

import json
import multiprocessing
import os
import signal
from collections.abc import Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import pytest
from tests.run.bare_runs import bare_run
from tests.run.spoiled_workers import spoil_workers

from contactlab.run import fork_server, worker_pool
from contactlab.run.tasks import CrashedJob, FinishedRun, Job, Stop
from contactlab.run.worker_pool import WorkerHandle, WorkerPool
from contactlab.store.verify_store import find_problems

FIRST: Job = (bare_run(0, "first"),)
SECOND: Job = (bare_run(1, "second"),)

CULPRIT = """
import os, signal
from contactlab.run.worker import Worker
run = Worker.run

def deadly(self, job):
    if any(each.index == 7 for each in job):
        {death}
    return run(self, job)

Worker.run = deadly
"""

# A worker has its own thread and the one that waits for the command's end, and BLAS adds none.
COUNT_THREADS = """import numpy
        numpy.ones((999, 999)) @ numpy.ones((999, 999))
        os._exit(len(os.listdir("/proc/self/task")))"""


@pytest.mark.night
def test_spawned_workers_leave_the_evidence_of_forked_ones(
    sweeper: Any, ball: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As they start where nothing may be forked."""
    sweeper.run(ball, "forked", workers=2)
    monkeypatch.setattr(worker_pool, "CONTEXT", multiprocessing.get_context("spawn"))
    sweeper.run(ball, workers=2)
    assert sweeper.outcome() == sweeper.outcome("forked")


@pytest.mark.night
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
def test_killing_workers_from_outside_loses_nothing(
    sweeper: Any, ball: str, number: signal.Signals
) -> None:
    sweeper.run(ball, "quiet")
    left = iter(range(3))

    def kill_one(_: Sequence[FinishedRun]) -> None:
        if next(left, None) is not None:
            os.kill(multiprocessing.active_children()[0].pid or 0, number)

    sweeper.run(ball, workers=2, progress=kill_one)
    assert next(left, None) is None
    assert sweeper.outcome() == sweeper.outcome("quiet")
    assert find_problems(sweeper.folder / "store") == []


@pytest.mark.long
@pytest.mark.parametrize(
    ("death", "reason"),
    [
        pytest.param(
            "os.kill(os.getpid(), signal.SIGSEGV)",
            "the worker was ended by SIGSEGV",
            marks=pytest.mark.night,
        ),
        pytest.param("os.abort()", "the worker was ended by SIGABRT", marks=pytest.mark.night),
        ("os._exit(3)", "the worker exited with code 3"),
        pytest.param(COUNT_THREADS, "the worker exited with code 2", marks=pytest.mark.night),
    ],
)
def test_only_the_culprit_is_labelled(
    command: Any, sweeper: Any, ball: str, tmp_path: Path, death: str, reason: str
) -> None:
    sweeper.run(ball, "quiet")
    expected, traces = sweeper.outcome("quiet")
    (tmp_path / "small.yaml").write_text(ball)
    spoil_workers(tmp_path, CULPRIT.format(death=death))
    code, out, err = command.run(
        *("sweep", "small.yaml", "-o", "store", "--workers", "1", "--format", "json"),
        first=tmp_path,
    )
    assert (code, err) == (4, "error: 1 of 18 runs crashed or timed out\n")
    assert json.loads(out)["statuses"] == {"ok": 17, "crashed": 1}
    found, found_traces = sweeper.outcome()
    assert found["label"] == [*expected["label"][:7], "crashed", *expected["label"][8:]]
    assert found["label_reason"][7] == found["status_reason"][7] == reason
    assert found["trajectory_hash"][7] is None
    others = [index for index in range(18) if index != 7]
    assert [found["trajectory_hash"][index] for index in others] == [
        expected["trajectory_hash"][index] for index in others
    ]
    del traces[expected["trace_file"][7]]
    assert found_traces == traces
    assert command.run("verify", "store")[0] == 0


@pytest.mark.long
def test_a_slow_run_times_out(command: Any, stack: str, tmp_path: Path) -> None:
    slow = stack.replace("duration: 0.1", "duration: 30\ntimeout: 0.05")
    (tmp_path / "slow.yaml").write_text(slow)
    only = ("--set", "seeds=1", "--set", "timestep=2e-3", "--where", "solver=Newton")
    code, out, err = command.run(
        *("sweep", "slow.yaml", "-o", "store", "--workers", "1", "--format", "json", *only)
    )
    assert (code, err) == (4, "error: 1 of 1 run crashed or timed out\n")
    summary = json.loads(out)
    assert summary["labels"] == summary["statuses"] == {"timeout": 1}
    (run_id,) = (json.loads(command.run("show", "store", "", "--format", "json")[1])["run_id"],)
    record = json.loads(command.run("show", "store", run_id, "--format", "json")[1])
    assert record["status_reason"].startswith("over 0.05 s: Stack (most recent call")


class DeadProcess:
    """A process that a signal ended."""

    exitcode = -signal.SIGKILL

    def join(self) -> None:
        """Return at once."""

    def kill(self) -> None:
        """Do nothing: it is dead."""


@pytest.fixture
def worker(tmp_path: Path) -> tuple[Any, Any]:
    """A pool of one worker, which waits for a job, and the worker's end of the pipe."""
    ours, theirs = multiprocessing.Pipe()
    process: Any = DeadProcess()
    task: Any = None
    pool: Any = WorkerPool(task, tmp_path, 1)
    pool._workers[tmp_path / "0"] = WorkerHandle(process, ours, tmp_path / "0")
    return pool, theirs


def test_a_worker_that_dies_between_jobs_loses_the_next(worker: tuple[Any, Any]) -> None:
    pool, theirs = worker
    theirs.send(["done"])
    theirs.close()
    assert list(pool.run_jobs([FIRST, SECOND], Stop())) == [
        ["done"],
        CrashedJob(SECOND, "the worker was ended by SIGKILL", timed_out=False),
    ]
    assert pool._workers == {}


def test_a_worker_that_dies_in_mid_message_loses_its_job(worker: tuple[Any, Any]) -> None:
    pool, theirs = worker
    os.write(theirs.fileno(), (1000).to_bytes(4, "big") + b"only the beginning")
    theirs.close()
    assert list(pool.run_jobs([FIRST], Stop())) == [
        CrashedJob(FIRST, "the worker was ended by SIGKILL", timed_out=False)
    ]


@pytest.mark.night
def test_a_long_temporary_path_is_no_hindrance(
    command: Any, ball: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sockets take paths of 107 characters; those of batch systems may be longer by themselves."""
    folder = tmp_path / ("job" * 30)
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    (tmp_path / "small.yaml").write_text(ball)
    code, _, err = command.run("sweep", "small.yaml", "-o", "store", "--workers", "1")
    assert (code, err) == (0, "")
    assert list(folder.iterdir()) == []


@pytest.mark.long
@pytest.mark.parametrize(
    "error", [ConnectionRefusedError, ConnectionResetError, BrokenPipeError, EOFError]
)
def test_a_fork_server_that_dies_while_it_answers_is_asked_again(
    sweeper: Any, ball: str, monkeypatch: pytest.MonkeyPatch, error: type[Exception]
) -> None:
    start = BaseProcess.start
    failures = iter([error] * 3)

    def interrupted(process: BaseProcess) -> None:
        if (failure := next(failures, None)) is not None:
            raise failure
        start(process)

    monkeypatch.setattr(BaseProcess, "start", interrupted)
    monkeypatch.setattr(fork_server, "_START_PAUSE", 0.001)
    sweeper.run(ball, workers=1)
    assert next(failures, None) is None
    assert find_problems(sweeper.folder / "store") == []
