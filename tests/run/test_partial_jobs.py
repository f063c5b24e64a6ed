"""A job that is told to stop hands over its first runs, as whole as if it had gone on."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import pytest

from contactlab.errors import StoppedError
from contactlab.run import worker
from contactlab.run.sweep_runner import run_sweep
from contactlab.run.tasks import FinishedRun, Job, Stop, Task
from contactlab.run.worker import Worker

pytestmark = pytest.mark.long

ONE_JOB = """
version: 1
scene: ball_drop
duration: 0.05
seeds: 8
axes: {drop_height: [0.02], engine: [ENGINE]}
"""


class OneJob:
    """Runs all runs as one job, and says no at the n-th question whether to proceed."""

    workers = 0

    def __init__(self, yes: int) -> None:
        self.yes = yes
        self.rows: list[dict[str, Any]] = []

    def proceed(self) -> bool:
        self.yes -= 1
        return self.yes >= 0

    def run(self, task: Task, jobs: Iterable[Job], stop: Stop) -> Iterator[list[FinishedRun]]:
        job = tuple(run for job in jobs for run in job)
        found = Worker(task, None, self.proceed).run(job)
        self.rows = [{**json.loads(each.shared or "{}"), **json.loads(each.row)} for each in found]
        yield found
        stop.request_stop()


def part_of_job(sweeper: Any, text: str, yes: int) -> list[dict[str, Any]]:
    """Return what is left of a job that was told to stop after so many runs, without the clock."""
    executor = OneJob(yes)
    ask = replace(sweeper.ask(text, f"store-{yes}"), cluster=executor)
    with pytest.raises(StoppedError):
        run_sweep(ask, lambda *_: None, lambda _: None)
    files = {path.relative_to(ask.store).as_posix() for path in ask.store.rglob("*.mcap*")}
    assert {row["trace_file"] for row in executor.rows} == files
    clock = {"started", "finished", "cost_cpu_s", "cost_cpu_per_sim_s"}
    return [{name: row[name] for name in row.keys() - clock} for row in executor.rows]


ONCE = ["checks: none"]
TWICE = ["checks: all", "knife_edge: true\nchecks: none"]


@pytest.mark.parametrize(
    ("key", "engine"), [*((key, "mujoco") for key in ONCE + TWICE), (*ONCE, "impulse")]
)
def test_a_part_of_a_job_is_its_first_runs(sweeper: Any, key: str, engine: str) -> None:
    """It is asked whether to proceed before it begins, and before all runs but one."""
    text = ONE_JOB.replace("ENGINE", engine) + key
    whole = part_of_job(sweeper, text, 10**9)
    assert len(whole) == 8
    for yes in (0, 1, 2, 7, 8):
        assert part_of_job(sweeper, text, yes) == whole[:yes], yes


@pytest.mark.parametrize("key", TWICE)
def test_a_second_pass_may_be_cut_as_well(
    sweeper: Any, key: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If it lasts, it is asked before all runs but one, and those that it left out go."""
    monkeypatch.setattr(worker, "_GRACE_SECONDS", 0.0)
    text = ONE_JOB.replace("ENGINE", "mujoco") + key
    whole = part_of_job(sweeper, text, 10**9)
    for yes in (0, 1, 4, 8, 9, 12, 15):
        done = max(min(1, yes), yes - 7)
        assert part_of_job(sweeper, text, yes) == whole[:done], yes
