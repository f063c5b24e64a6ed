"""A sweep into object storage, whatever interrupts it, equals the same sweep into a folder."""

import os
import pickle
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from contactlab.errors import OutputError
from contactlab.run.sweep_runner import run_sweep
from contactlab.run.tasks import Job, Result, Stop, Task
from contactlab.run.worker import Worker
from contactlab.store.objects import lease
from contactlab.store.objects.lease import LockHolder
from contactlab.store.store_files import Address, ObjectAddress, parse_address
from contactlab.store.verify_store import find_problems

if TYPE_CHECKING:
    from contactlab.store.objects.client import ObjectClient

Until = Callable[[Callable[[], bool]], None]

LONG = """
version: 1
scene: ball_drop
duration: 0.5
seeds: 100
axes:
  timestep: [1.0e-3, 1.5e-3, 2.0e-3, 3.0e-3]
  drop_height: [0.1, 0.2, 0.3]
"""


SMALL = """
version: 1
scene: ball_drop
duration: 0.1
seeds: 3
axes: {timestep: [2.0e-3, 4.0e-3]}
accuracy: {error: auto}
"""


@pytest.fixture
def address(bucket: str) -> ObjectAddress:
    found = parse_address(f"{bucket}/sweeps/one")
    assert isinstance(found, ObjectAddress)
    return found


@pytest.fixture
def client(
    address: ObjectAddress, connect: "Callable[[ObjectAddress], ObjectClient]"
) -> "ObjectClient":
    return connect(address)


@pytest.fixture
def outcome_at(
    tmp_path: Path, outcome: Callable[[Path], Any], connect: Any
) -> Callable[[Address], Any]:
    """Return what must repeat of a store, wherever it is."""

    def of(address: Address) -> Any:
        if isinstance(address, Path):
            return outcome(address)
        client = connect(address)
        copy = tmp_path / "copy"
        for name, _ in client.list_sizes():
            assert client.fetch_object(name, copy / name)
        return outcome(copy)

    return of


def rows(client: "ObjectClient") -> int:
    return sum(1 for _ in client.list_sizes("journal"))


@pytest.mark.night
@pytest.mark.parametrize("workers", [0, 2])
def test_equals_a_local_one(
    sweeper: Any,
    ball: str,
    address: ObjectAddress,
    outcome_at: Callable[[Address], Any],
    workers: int,
) -> None:
    ask = replace(sweeper.ask(ball, workers=workers), store=address)
    manifest = run_sweep(ask, lambda *_: None, lambda _: None)
    local = sweeper.run(ball, "local")
    assert (manifest.runs, manifest.traces, manifest.labels) == (
        local.runs,
        local.traces,
        local.labels,
    )
    assert outcome_at(address) == sweeper.outcome("local")
    assert find_problems(address) == []


@dataclass(frozen=True)
class FarMachine:
    """Runs jobs as a machine does that sees neither the sweep's folders nor its memory."""

    workers: int = 1

    def run(self, task: Task, jobs: Iterable[Job], stop: Stop) -> Iterator[Result]:
        del stop
        sent = pickle.loads(pickle.dumps(task))  # noqa: S301 - our own
        folder = Path("/nowhere/scenes") / task.scene_folder.name
        worker = Worker(replace(sent, scene_folder=folder), None)
        for job in jobs:
            yield worker.run(job)


@pytest.mark.night
def test_workers_of_another_machine(
    sweeper: Any, ball: str, address: ObjectAddress, outcome_at: Callable[[Address], Any]
) -> None:
    """They fetch the scene from the bucket, and put their traces there."""
    ask = replace(sweeper.ask(ball), store=address, cluster=FarMachine())
    run_sweep(ask, lambda *_: None, lambda _: None)
    sweeper.run(ball, "local")
    assert outcome_at(address) == sweeper.outcome("local")
    assert find_problems(address) == []


@pytest.mark.night
def test_passes_are_resumed_too(
    sweeper: Any, address: ObjectAddress, outcome_at: Callable[[Address], Any]
) -> None:
    """Errors against references are found from notes that lie in the bucket."""
    ask = replace(sweeper.ask(SMALL), store=address)

    began: list[int] = []

    def stop_in_second_pass(_: object) -> None:
        if len(began) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(ask, lambda _, done, *__: began.append(done), stop_in_second_pass)
    passes: list[tuple[int, int]] = []
    run_sweep(ask, lambda total, done, *_: passes.append((total, done)), lambda _: None)
    assert passes == [(6, 6), (6, 2)]
    sweeper.run(SMALL, "local")
    assert outcome_at(address) == sweeper.outcome("local")


@pytest.mark.night
def test_interrupted_and_resumed(
    command: Any,
    tmp_path: Path,
    address: ObjectAddress,
    client: "ObjectClient",
    until: Until,
    outcome_at: Callable[[Address], Any],
) -> None:
    (tmp_path / "long.yaml").write_text(LONG)
    asked = ("sweep", "long.yaml", "--limit", "60", "--workers", "2", "-o")
    process = command.start(*asked, str(address))
    until(lambda: rows(client) > 0)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert "Traceback" not in err
    assert process.returncode == 130, err
    assert (
        err.splitlines()[-1]
        == "interrupted; finished runs are kept: run the same command again to resume"
    )
    assert client.find_object("manifest.json") is None, "the sweep is too short for this test"
    code, _, err = command.run(*asked, str(address))
    assert code == 0, err
    assert "of 60 runs are stored already" in err
    assert find_problems(address) == []
    assert command.run(*asked, "local")[0] == 0
    assert outcome_at(address) == outcome_at(tmp_path / "local")


@pytest.mark.night
def test_killed_twice(
    command: Any,
    tmp_path: Path,
    address: ObjectAddress,
    client: "ObjectClient",
    until: Until,
    outcome_at: Callable[[Address], Any],
) -> None:
    (tmp_path / "long.yaml").write_text(LONG)
    asked = ("sweep", "long.yaml", "--limit", "160", "--workers", "2", "-o")
    for _ in range(2):
        before = rows(client)
        process = command.start(*asked, str(address))
        until(lambda before=before: rows(client) > before)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        assert client.find_object("manifest.json") is None, "the sweep is too short for this test"
    code, _, err = command.run(*asked, str(address))
    assert code == 0, err
    assert "of 160 runs are stored already" in err
    assert find_problems(address) == []
    assert command.run(*asked, "local")[0] == 0
    assert outcome_at(address) == outcome_at(tmp_path / "local")


@pytest.mark.long
def test_resumed_on_another_machine(
    sweeper: Any,
    ball: str,
    address: ObjectAddress,
    client: "ObjectClient",
    outcome_at: Callable[[Address], Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nothing is left here of the one that died; its lock has to be waited out."""
    ask = replace(sweeper.ask(ball), store=address)

    def die(_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(ask, lambda *_: None, die)
    theirs = LockHolder.current_process().model_copy(update={"machine": "another"})
    client.put_file(".lock", theirs.to_json_bytes())
    monkeypatch.setattr(lease, "LEASE", 0.5)
    began: list[tuple[int, int]] = []
    start = time.monotonic()
    run_sweep(ask, lambda total, done, *_: began.append((total, done)), lambda _: None)
    assert time.monotonic() - start >= 0.5
    assert began[0][0] == 18
    assert 0 < began[0][1] < 18
    sweeper.run(ball, "local")
    assert outcome_at(address) == sweeper.outcome("local")


@pytest.mark.long
def test_a_server_that_goes_away(
    sweeper: Any,
    ball: str,
    address: ObjectAddress,
    client: "ObjectClient",
    outcome_at: Callable[[Address], Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The sweep ends with one message, and goes on when the server is back."""
    ask = replace(sweeper.ask(ball), store=address)

    def unplug(_: object) -> None:
        monkeypatch.setattr(type(client), "put_file", away)

    def away(_: object, name: str, __: object) -> None:
        raise OutputError(f"cannot reach {address / name}")

    put = type(client).put_file
    with pytest.raises(OutputError, match=f"cannot reach {address}/traces/"):
        run_sweep(ask, lambda *_: None, unplug)
    monkeypatch.setattr(type(client), "put_file", put)
    assert client.find_object("manifest.json") is None
    began: list[int] = []
    run_sweep(ask, lambda _, done, *__: began.append(done), lambda _: None)
    assert began[0] > 0
    sweeper.run(ball, "local")
    assert outcome_at(address) == sweeper.outcome("local")


@pytest.mark.night
def test_a_command_whose_server_goes_away(
    command: Any,
    tmp_path: Path,
    until: Until,
    monkeypatch: pytest.MonkeyPatch,
    bucket: str,
    connect: Any,
) -> None:
    """Workers and parent notice; nobody hangs, and the exit code is that of an output error."""
    moto = pytest.importorskip("moto.server", reason="moto is needed to test object stores")
    server = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    port = server.get_host_and_port()[1]
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
    (tmp_path / "long.yaml").write_text(LONG)
    address = parse_address(f"{bucket}/one")
    assert isinstance(address, ObjectAddress)
    client = connect(address)
    process = command.start("sweep", "long.yaml", "--workers", "2", "-o", str(address))
    until(lambda: rows(client) > 1)
    server.stop()
    start = time.monotonic()
    _, err = process.communicate(timeout=120)
    assert process.returncode == 2, err
    assert time.monotonic() - start < 40
    assert "the server does not respond" in err.splitlines()[-1]
    assert "Traceback" not in err
    until(lambda: command.living(process.pid) == [])


@pytest.mark.night
def test_nothing_is_left_on_this_machine(
    command: Any, address: ObjectAddress, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither of the sweep nor of what reads it."""
    (tmp_path / "long.yaml").write_text(LONG)
    (tmp_path / "staging").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "staging"))
    asked = ("sweep", "long.yaml", "--limit", "8", "--workers", "2", "-o", str(address))
    assert command.run(*asked)[0] == 0
    assert command.run("verify", str(address))[0] == 0
    assert [each.name for each in (tmp_path / "staging").iterdir()] == []
