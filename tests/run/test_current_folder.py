"""Workers import nothing of the current folder, and a halted one costs no more than its run."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.run.bare_runs import bare_run

from contactlab.run import worker_pool
from contactlab.run.ray.connection import ray_cluster
from contactlab.run.tasks import CrashedJob, Job, Stop
from contactlab.run.worker_pool import WorkerHandle, WorkerPool, end_halted

JOB: Job = (bare_run(0, "first"),)


@pytest.mark.long
@pytest.mark.parametrize("executor", ["local", pytest.param("ray", marks=pytest.mark.night)])
def test_modules_of_the_current_folder_are_not_run(
    command: Any, tmp_path: Path, hostile_folder: Callable[[], list[Path]], executor: str
) -> None:
    """Tasks of SLURM neither: see `test_slurm.py`."""
    if executor != "local":
        pytest.importorskip(executor)
    (tmp_path / "one.yaml").write_text("version: 1\nscene: ball_drop\nduration: 0.01\n")
    words = "sweep", "one.yaml", "-o", "store", "--workers", "1", "--executor", executor
    process = command.start(*words)
    _, err = process.communicate()
    assert process.returncode == 0, err
    assert not hostile_folder()


@pytest.mark.long
def test_the_module_imports_nothing_of_the_current_folder(
    tmp_path: Path, hostile_folder: Callable[[], list[Path]]
) -> None:
    """Python itself looks there first, for the package as well."""
    (tmp_path / "contactlab.py").unlink()
    line = [sys.executable, "-m", "contactlab", "list", "sweeps"]
    subprocess.run(line, cwd=tmp_path, check=True, capture_output=True)
    assert not hostile_folder()


@pytest.mark.long
@pytest.mark.usefixtures("hostile_folder")
def test_ray_is_started_in_an_empty_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its workers import modules of the folder that it is started in."""
    ray = pytest.importorskip("ray")
    seen: list[list[Path]] = []
    monkeypatch.setattr(ray, "init", lambda *_, **__: seen.append([*Path.cwd().iterdir()]))
    before = Path.cwd()
    with ray_cluster(None, 1):
        assert Path.cwd() == before
        assert os.environ["RAY_worker_niceness"] == "0"  # noqa: SIM112 - as Ray spells it
    assert seen == [[]]


@pytest.fixture
def halted_worker(tmp_path: Path) -> Any:
    """A worker that has just begun, halted by a signal."""
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe()
    process = context.Process(target=time.sleep, args=(600,), daemon=True)
    process.start()
    theirs.close()
    os.kill(process.pid or 0, signal.SIGSTOP)
    os.waitpid(process.pid or 0, os.WUNTRACED)
    yield WorkerHandle(process, ours, tmp_path / "marker")
    process.kill()


def test_a_halted_worker_is_ended(
    halted_worker: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker_pool, "_STOP_INTERVAL", 0.001)
    task: Any = None
    pool: Any = WorkerPool(task, tmp_path, 1)
    pool._workers[pool._markers[0]] = replace(halted_worker, marker=pool._markers[0])
    (result,) = pool.run_jobs([JOB], Stop())
    assert isinstance(result, CrashedJob)
    assert (result.job, result.timed_out) == (JOB, False)
    assert "halted" in result.reason


def test_one_that_goes_on_is_left(halted_worker: Any) -> None:
    end_halted([halted_worker])
    end_halted([halted_worker])
    os.kill(halted_worker.process.pid, signal.SIGCONT)
    os.waitpid(halted_worker.process.pid, os.WCONTINUED)
    end_halted([halted_worker])
    assert halted_worker.halted == 0
    assert halted_worker.process.is_alive()
