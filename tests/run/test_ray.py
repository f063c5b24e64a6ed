"""A sweep on a Ray cluster of three nodes leaves what one on this machine does."""

import json
import os
import random
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from textwrap import dedent
from typing import Any

import pytest
from tests.run.spoiled_workers import spoil_workers

from contactlab.store.row_journal import SHARED, row_extent
from contactlab.store.verify_store import find_problems

pytest.importorskip("ray", reason="contactlab[ray] is not installed")
pytestmark = pytest.mark.night

Until = Callable[[Callable[[], bool]], None]
Outcome = Callable[[Path], Any]

CULPRITS = """
import os, signal, time
from contactlab.run.worker import Worker
run = Worker.run

def deadly(self, job):
    beside, places = self._task.store.parent, {each.index for each in job}
    if 7 in places and (beside / "deadly").exists():
        os.kill(os.getpid(), signal.SIGSEGV)
    hangs = beside / "hangs"
    if 3 in places and ((beside / "deadly").exists() or hangs.exists()):
        hangs.unlink(missing_ok=True)
        with self._preparer.start_watchdog() as watch:
            watch()
            signal.pause()
    return run(self, job)

Worker.run = deadly
"""
# As if another version were installed where the sweep is started, and on no node.
NEWER = """
import sys
import time
if any(each.endswith("contactlab") for each in sys.orig_argv):
    import contactlab.run.ray.connection as connecting
    enter = connecting._connect_ray

    def entering(address, workers):
        enter(address, workers)
        from contactlab.run.ray import executor as ray_executor
        ray_executor.version = lambda name: "9.9"

    connecting._connect_ray = entering
"""
PASSES = """
version: 1
scene: ball_drop
duration: 0.1
axes:
  timestep: [1.0e-3, 2.0e-3]
  drop_height: [0.02, 0.03]
accuracy: {error: auto, refine: 4}
timing: {rounds: 3}
"""
# Some seconds of work on three nodes.
LONG = """
version: 1
scene: box_stack
duration: 0.5
seeds: 16
trace: sample:16
axes:
  boxes: [3]
  timestep: [1.0e-3, 2.0e-3]
  solver: [Newton, CG]
  cone: [pyramidal, elliptic]
"""
RUNS = 128


class Nodes:
    """A cluster, and the words that change it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        spoil_workers(folder, CULPRITS)
        self.environment = {
            "RAY_AUTH_MODE": "token",
            "RAY_AUTH_TOKEN": secrets.token_hex(32),
            "RAY_worker_niceness": "0",
            "RAY_USAGE_STATS_ENABLED": "0",
            "RAY_USAGE_STATS_REPORT_URL": "http://127.0.0.1:9/",
        }
        self._process = subprocess.Popen(
            [sys.executable, Path(__file__).with_name("three_nodes.py")],
            env=os.environ | self.environment | {"PYTHONPATH": str(folder)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self.options = ("--executor", "ray", "--address", self._answer())

    def say(self, word: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(word + "\n")
        self._process.stdin.flush()
        self._answer()

    def _answer(self) -> str:
        assert self._process.stdout is not None
        answer = self._process.stdout.readline().strip()
        assert answer, "the cluster is gone"
        return answer

    def end(self) -> None:
        self._process.communicate(timeout=60)


@pytest.fixture(scope="module")
def nodes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Nodes]:
    nodes = Nodes(tmp_path_factory.mktemp("nodes"))
    yield nodes
    nodes.end()


@pytest.fixture
def on_nodes(nodes: Nodes, monkeypatch: pytest.MonkeyPatch) -> tuple[str, ...]:
    """The options that run a sweep there."""
    for name, value in nodes.environment.items():
        monkeypatch.setenv(name, value)
    return nodes.options


def test_three_nodes_do_as_two_processes(
    command: Any, tmp_path: Path, on_nodes: Any, outcome: Outcome
) -> None:
    (tmp_path / "small.yaml").write_text(PASSES)
    code, _, err = command.run("sweep", "small.yaml", "-o", "nodes", *on_nodes)
    assert code == 0, err
    assert command.run("sweep", "small.yaml", "-o", "here", "--workers", "2")[0] == 0
    assert outcome(tmp_path / "nodes") == outcome(tmp_path / "here")
    assert find_problems(tmp_path / "nodes") == []


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, make_sweeper: Any) -> Any:
    """What the long sweep leaves on this machine."""
    sweeper = make_sweeper(tmp_path_factory.mktemp("here"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(sweeper.folder)
        sweeper.run(LONG, workers=2)
    return sweeper.outcome()


def test_a_sweep_killed_forty_times_is_resumed_on_the_nodes(
    command: Any, tmp_path: Path, on_nodes: Any, outcome: Outcome
) -> None:
    """The cluster outlives the command that is killed at random times, as one of a lab does."""
    dice, killed, lives = random.Random("nodes"), 0, 0  # noqa: S311
    (tmp_path / "long.yaml").write_text(LONG)
    assert command.run("sweep", "long.yaml", "-o", "whole", "--workers", "2")[0] == 0
    began = time.monotonic()
    assert command.run("sweep", "long.yaml", "-o", "first", *on_nodes)[0] == 0
    takes, whole = time.monotonic() - began, outcome(tmp_path / "whole")
    while killed < 40:
        lives += 1
        words = ("sweep", "long.yaml", "-o", f"store{lives}", *on_nodes)
        killed += command.finish_under_kills(*words, dice=dice, longest=takes)
        assert outcome(tmp_path / f"store{lives}") == whole, (killed, lives)
        assert find_problems(tmp_path / f"store{lives}") == []


@pytest.mark.parametrize("loss", ["remove", "kill"])
@pytest.mark.usefixtures("on_nodes")
def test_a_node_lost_in_mid_sweep_loses_no_run(
    command: Any,
    tmp_path: Path,
    nodes: Nodes,
    until: Until,
    *,
    undisturbed: Any,
    outcome: Outcome,
    loss: str,
) -> None:
    (tmp_path / "small.yaml").write_text(LONG)
    process = command.start("sweep", "small.yaml", "-o", "store", *nodes.options)
    until(lambda: stored(tmp_path) > 0)
    assert stored(tmp_path) < RUNS / 2, "the sweep is too short"
    nodes.say(loss)
    _, err = process.communicate(timeout=120)
    nodes.say("add")
    assert process.returncode == 0, err
    assert outcome(tmp_path / "store") == undisturbed
    assert len(undisturbed[0]["run_id"]) == RUNS
    assert find_problems(tmp_path / "store") == []


def stored(folder: Path) -> int:
    """Return how many runs the store in a folder holds."""
    journal = folder / "store" / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True) if journal.exists() else []
    return sum(row_extent(line)[1] != SHARED for line in lines if line.endswith(b"\n"))


@pytest.mark.usefixtures("on_nodes")
def test_culprits_are_labelled_as_on_one_machine(
    command: Any, tmp_path: Path, nodes: Nodes, ball: str, outcome: Outcome
) -> None:
    (tmp_path / "small.yaml").write_text(ball + "timeout: 1\n")
    (tmp_path / "deadly").touch()
    code, out, err = command.run(
        "sweep", "small.yaml", "-o", "store", *nodes.options, "--format", "json"
    )
    assert (code, err.splitlines()[-1]) == (4, "error: 2 of 18 runs crashed or timed out")
    assert json.loads(out)["statuses"] == {"ok": 16, "crashed": 1, "timeout": 1}
    here = ("-o", "here", "--workers", "2")
    assert command.run("sweep", "small.yaml", *here, first=nodes.folder)[0] == 4
    found, expected = outcome(tmp_path / "store"), outcome(tmp_path / "here")
    assert found == expected
    assert found[0]["status_reason"][7] == "the worker was ended by SIGSEGV"
    assert found[0]["label"][3] == "timeout"
    assert find_problems(tmp_path / "store") == []


def test_other_versions_are_refused(command: Any, tmp_path: Path, on_nodes: Any, ball: str) -> None:
    (tmp_path / "small.yaml").write_text(ball)
    (tmp_path / "sitecustomize.py").write_text(dedent(NEWER))
    code, out, err = command.run("sweep", "small.yaml", "-o", "store", *on_nodes, first=tmp_path)
    assert (code, out) == (2, "")
    assert err.startswith("error: node ")
    assert "but the sweep was started with contactlab 9.9" in err
    assert len(err.splitlines()) == 1
    assert list((tmp_path / "store").rglob("*.tmp")) == []


def test_a_stop_waits_for_what_runs_and_a_second_does_not(
    command: Any, tmp_path: Path, on_nodes: Any, until: Until, undisturbed: Any, outcome: Outcome
) -> None:
    (tmp_path / "small.yaml").write_text(LONG)
    (tmp_path / "hangs").touch()
    process = command.start("sweep", "small.yaml", "-o", "store", *on_nodes)
    until(lambda: not (tmp_path / "hangs").exists() and stored(tmp_path) > 0)
    process.send_signal(signal.SIGINT)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(timeout=2)
    kept = stored(tmp_path)
    assert kept < RUNS - 1, "the sweep is too short"
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out) == (130, "")
    assert (
        err.splitlines()[-1]
        == "interrupted; finished runs are kept: run the same command again to resume"
    )
    assert "Traceback" not in err
    code, _, err = command.run("sweep", "small.yaml", "-o", "store", "--workers", "2")
    assert code == 0, err
    assert f"{kept} of {RUNS} runs are stored already" in err
    assert outcome(tmp_path / "store") == undisturbed
    assert find_problems(tmp_path / "store") == []
