"""Tasks of an array: each job counts once, whatever becomes of its task; SLURM is stood in for."""

import os
import pickle
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.run.bare_runs import bare_run

from contactlab.errors import ClusterError, OutputError

pytest.importorskip("submitit", reason="contactlab[slurm] is not installed")

from submitit.core.utils import UncompletedJobError

from contactlab.run.slurm import executor as arrays
from contactlab.run.slurm.connection import slurm_arrays
from contactlab.run.slurm.executor import Arrays, SlurmExecutor
from contactlab.run.slurm.part import RESULT, Part, runs_of, stored_runs, unfinished_jobs
from contactlab.run.tasks import MAX_LOSSES, CrashedJob, FinishedRun, Job, Result, Stop

SWEEP = """
version: 1
scene: ball_drop
duration: 0.02
seeds: 8
axes: {timestep: [1.0e-3, 2.0e-3], drop_height: [0.1, 0.2]}
"""
LOCAL = ("--executor", "slurm", "--address", "cluster=local,timeout_min=5")


def job(number: int) -> Job:
    return tuple(bare_run(2 * number + run, f"{number}-{run}") for run in range(2))


def written(folder: Path, number: int, jobs: tuple[Job, ...]) -> None:
    """Write the results of some jobs, as a task does."""
    for one in jobs:
        result: Result = [
            FinishedRun(b'{"run_id":"%s"}' % run.run_id.encode(), "stable", "ok", None)
            for run in one
        ]
        (folder / f"{number}-{one[0].run_id}{RESULT}").write_bytes(pickle.dumps(result))


class Task:
    """A task that does some of its jobs, and then is lost if it has not done all."""

    state = "RUNNING"

    def __init__(self, part: Part, number: int, most: int) -> None:
        written(part.folder, number, part.jobs[:most])
        self._lost = most < len(part.jobs)

    def done(self) -> bool:
        return True

    def result(self) -> None:
        if self._lost:
            raise UncompletedJobError("killed")

    def cancel(self) -> None:
        pass


def flown(
    monkeypatch: pytest.MonkeyPatch, folder: Path, count: int, most: Iterator[int]
) -> list[Result]:
    """Return the results of so many jobs on three tasks, each of which does at most so many."""
    numbers = iter(range(10**6))
    executor = SlurmExecutor(3, 1, "local", {})

    def submit(_: SlurmExecutor, __: Path, parts: list[Part]) -> list[Task]:
        return [Task(part, next(numbers), next(most)) for part in parts]

    monkeypatch.setattr(SlurmExecutor, "submit_parts", submit)
    monkeypatch.setattr(arrays, "_POLL_SECONDS", 0)
    flying = Arrays(executor, folder, {}, map(job, range(count)), Stop())
    return [*flying.iterate_results()]


@given(st.integers(0, 12), st.lists(st.integers(0, 4), max_size=12))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)
def test_each_run_has_one_result_whatever_is_lost(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, count: int, losses: list[int]
) -> None:
    """Tasks die after so many jobs, the rest of them do all: no run is lost, none counts twice."""

    def most() -> Iterator[int]:
        yield from losses
        while True:
            yield 100

    results = flown(monkeypatch, tmp_path, count, most())
    ids = [run for result in results for run in runs_of(result)]
    assert sorted(ids) == sorted(run.run_id for number in range(count) for run in job(number))
    assert not list(tmp_path.glob(f"*{RESULT}"))


def test_a_job_that_loses_its_task_again_and_again_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Its worker comes to nothing each time; those behind it are done."""

    def most() -> Iterator[int]:
        yield from [0] * MAX_LOSSES
        while True:
            yield 100

    first, *others = flown(monkeypatch, tmp_path, 1, most())
    assert isinstance(first, CrashedJob)
    assert first.job == job(0)
    assert f"lost {MAX_LOSSES} times" in first.reason
    assert not others


def test_what_is_requeued_goes_on_where_it_was(tmp_path: Path) -> None:
    jobs = tuple(map(job, range(3)))
    part = Part(tmp_path, jobs, 1, {})
    written(tmp_path, 0, jobs[:1])
    assert part.checkpoint().function is part
    assert unfinished_jobs(jobs, stored_runs(tmp_path)) == jobs[1:]
    assert unfinished_jobs(jobs, {jobs[2][0].run_id}) == (*jobs[:2], jobs[2][1:])


def test_a_node_with_another_version_is_refused(tmp_path: Path) -> None:
    error = Part(tmp_path, (), 1, {"contactlab": "0.0.1"})()
    assert isinstance(error, ClusterError)
    assert "the sweep was started with 0.0.1" in str(error)


@pytest.mark.parametrize(
    ("address", "says"),
    [
        (None, "there is no SLURM here"),
        ("time", "write NAME=VALUE"),
        ("cluster=local,cpus=none", "write cpus=N"),
        ("cluster=mine", "cluster=slurm or local"),
        ("cluster=local,hours=3", "hours"),
    ],
)
def test_what_tasks_cannot_ask_for(
    address: str | None, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(ClusterError, match=says), slurm_arrays(address, 2):
        pass


def test_without_submitit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "submitit", None)
    with pytest.raises(OutputError, match="pip install 'submitit"), slurm_arrays(None, None):
        pass


def tasks_of(folder: Path) -> list[int]:
    """Return the processes of tasks that run below a folder."""
    found: list[int] = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_text().split("\0")
        except OSError:
            continue
        if "submitit.core._submit" in words and any(str(folder) in word for word in words):
            found.append(int(process.name))
    return found


@pytest.mark.long
@pytest.mark.parametrize(
    "number", [signal.SIGKILL, pytest.param(signal.SIGUSR2, marks=pytest.mark.night)]
)
def test_a_sweep_whose_tasks_die_is_that_of_one_machine(
    command: Any,
    sweeper: Any,
    tmp_path: Path,
    until: Callable[..., None],
    hostile_folder: Callable[[], list[Path]],
    number: int,
) -> None:
    """Killed, or told that their time is over, which has them requeued.

    They run no module of the folder in which they start.
    """
    (tmp_path / "small.yaml").write_text(SWEEP)
    process = command.start("sweep", "small.yaml", "-o", "there", *LOCAL, "--workers", "1")
    until(lambda: bool(tasks_of(tmp_path)))
    os.kill(tasks_of(tmp_path)[0], number)
    _, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert not hostile_folder()
    sweeper.run(SWEEP, "here")
    assert sweeper.outcome("there") == sweeper.outcome("here")
    assert not list(tmp_path.glob(".contactlab-slurm-*"))
