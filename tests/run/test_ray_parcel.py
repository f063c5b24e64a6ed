"""What is sent to nodes with a sweep, and what a process of a node does with it."""

import os
import pickle
import platform
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from contactlab.run import worker_pool
from contactlab.run.ray import worker as ray_worker
from contactlab.run.task_bundle import pack_bundle, unpack_bundle
from contactlab.run.tasks import CrashedJob, Task
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import stored_scene
from contactlab.store.store_files import ObjectAddress

pytestmark = pytest.mark.long

# Above what any system counts to.
NO_PROCESS = 1 << 23


@pytest.fixture
def task(sweeper: Any, ball: str, monkeypatch: pytest.MonkeyPatch) -> Task:
    """The task of a small sweep, as its workers got it."""
    taken: list[Task] = []
    make = parcel_of_worker(taken)
    monkeypatch.setattr("contactlab.run.worker.Worker.__init__", make)
    with pytest.raises(AttributeError):
        sweeper.run(ball)
    return taken[0]


def parcel_of_worker(taken: list[Task]) -> Any:
    def init(_worker: Any, task: Task, *_: Any) -> None:
        taken.append(task)

    return init


def test_nodes_that_see_the_store_read_the_scene_there(task: Task, tmp_path: Path) -> None:
    assert unpack_bundle(pack_bundle(task), tmp_path / "node") == task
    assert not (tmp_path / "node").exists()


def test_a_scene_goes_along_with_a_store_that_is_no_folder(task: Task, tmp_path: Path) -> None:
    far = replace(task, store=ObjectAddress("s3", "bucket", "prefix"))
    sent = pack_bundle(far)
    there = unpack_bundle(sent, tmp_path / "node")
    assert there == replace(far, scene_folder=there.scene_folder)
    assert tmp_path / "node" in there.scene_folder.parents
    hashes = {
        stored_scene(folder, task.identity.scene_model, task.identity.scene).content.hash
        for folder in (task.scene_folder, there.scene_folder)
    }
    assert len(hashes) == 1
    assert unpack_bundle(sent, tmp_path / "node") == there


def test_folders_go_with_their_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("contactlab.run.ray.worker.gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    first = ray_worker.own_folder()
    gone = Path(str(first).replace(f"-{os.getpid()}-", f"-{NO_PROCESS}-"))
    (gone / "scene").mkdir(parents=True)
    elsewhere = tmp_path / f"contactlab-of-another-{NO_PROCESS}-x"
    elsewhere.mkdir()
    name = platform.node()
    longer = tmp_path / f"contactlab-of-{name}-{NO_PROCESS}-1-abcdefgh"
    longer.mkdir()
    second = ray_worker.own_folder()
    assert set(tmp_path.iterdir()) == {first, second, elsewhere, longer}


INNER: Any = ray_worker


@pytest.fixture
def process(task: Task) -> Iterator[Any]:
    """Run a job of so many runs as a process of a node would."""

    def run(runs: int, sweep: str = "one") -> Any:
        values = {"timestep": 1e-3, "drop_height": 0.02}
        (run,) = Scene.open("ball_drop").plan_runs(values, [0], 0.01)
        job = tuple(replace(run, index=index, run_id=f"{index:016x}") for index in range(runs))
        return ray_worker.run_on_worker(sweep, lambda: pack_bundle(task), pickle.dumps(job))

    yield run
    for worker in INNER._workers_by_token.values():
        worker.close()
    INNER._workers_by_token.clear()


def number(token: str) -> int:
    """Return the number of the process that is kept."""
    (worker,) = INNER._workers_by_token[token]._workers.values()
    return worker.process.pid


def test_a_worker_is_kept_between_jobs_of_one_sweep(process: Any) -> None:
    assert [each.status for each in process(2)] == ["ok", "ok"]
    first = number("one")
    assert len(process(1)) == 1
    assert number("one") == first
    assert len(process(1, "another")) == 1
    assert list(INNER._workers_by_token) == ["another"]
    with pytest.raises(ProcessLookupError):
        os.kill(first, 0)


def test_a_worker_that_dies_loses_its_job_and_is_replaced(process: Any) -> None:
    process(1)
    os.kill(number("one"), signal.SIGKILL)
    lost = process(1)
    assert isinstance(lost, CrashedJob)
    assert (lost.reason, lost.timed_out) == ("the worker was ended by SIGKILL", False)
    assert len(process(1)) == 1


def test_a_job_that_is_called_back_ends_early(
    process: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = signal.getsignal(signal.SIGINT)
    send_job: Any = worker_pool.send_job

    def called_back(*sent: Any) -> None:
        send_job(*sent)
        os.kill(os.getpid(), signal.SIGINT)

    process(1)
    with monkeypatch.context() as patch:
        patch.setattr(worker_pool, "send_job", called_back)
        # None at all, where the worker is slow to begin.
        assert len(process(2000)) < 2000
    assert signal.getsignal(signal.SIGINT) is before
    assert len(process(1)) == 1
