"""An executor of another package runs jobs by `--executor NAME`, and changes nothing stored."""

from pathlib import Path
from typing import Any

import pytest

from contactlab.store.verify_store import find_problems

pytestmark = pytest.mark.long

MINE = """
from contextlib import contextmanager
from pathlib import Path

from contactlab.run.worker import Worker

class Counted:
    workers = 3

    def run(self, task, jobs, stop):
        worker = Worker(task, None)
        jobs = list(jobs)
        Path("jobs.txt").write_text(f"{len(jobs)}")
        for job in reversed(jobs):
            yield worker.run(job)

@contextmanager
def cluster(address, workers):
    Path("given.txt").write_text(f"{address} {workers}")
    yield Counted()
"""


def test_jobs_run_where_an_installed_executor_runs_them(
    command: Any, sweeper: Any, ball: str, tmp_path: Path
) -> None:
    sweeper.run(ball, "quiet")
    (tmp_path / "small.yaml").write_text(ball)
    site = tmp_path / "site"
    metadata = site / "counted-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: counted\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[contactlab.executors]\nmine = counted:cluster\n")
    (site / "counted.py").write_text(MINE)
    asked = ("sweep", "small.yaml", "-o", "store", "--executor", "mine", "--address", "far:1")
    code, _, err = command.run(*asked, first=site)
    assert code == 0, err
    assert (tmp_path / "given.txt").read_text() == "far:1 None"
    assert int((tmp_path / "jobs.txt").read_text()) > 1
    assert sweeper.outcome() == sweeper.outcome("quiet")
    assert find_problems(tmp_path / "store") == []
