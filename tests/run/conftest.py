"""Small sweeps, run in this process or by workers, and what of their outcome must repeat."""

import contextlib
import json
import os
import random
import re
import signal
import subprocess
import sysconfig
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from tests.run.spoiled_workers import spoil_workers

MODULES = ("selectors", "signal", "numpy", "mujoco", "socket", "contactlab", "struct")
SLIDE = """
version: 1
scene: box_slide
duration: 0.2
seeds: [0, 7]
axes:
  timestep: [2.0e-3, 4.0e-3]
  cone: [pyramidal, elliptic]
"""
STACK = """
version: 1
scene: box_stack
duration: 0.1
seeds: 2
axes:
  boxes: [3]
  timestep: [2.0e-3, 5.0e-3]
  solver: [Newton, CG]
"""


def parent_of(process: int) -> int | None:
    """Return the parent of a process; None if it is gone."""
    with contextlib.suppress(OSError):
        return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    return None


class Command:
    """The installed command, each call in a session of its own, as a shell starts it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._started: list[subprocess.Popen[str]] = []

    def start(
        self, *arguments: str, first: Path | None = None, stderr: int = subprocess.PIPE
    ) -> subprocess.Popen[str]:
        """Start the command; `first` is where Python looks for modules before all else."""
        path = [str(first)] if first else []
        path += filter(None, [os.environ.get("PYTHONPATH")])
        process = subprocess.Popen(
            [str(Path(sysconfig.get_path("scripts")) / "contactlab"), *arguments],
            cwd=self.folder,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path)},
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
            start_new_session=True,
        )
        self._started.append(process)
        return process

    def run(self, *arguments: str, first: Path | None = None) -> tuple[int, str, str]:
        """Return exit code, stdout and stderr, without the progress that slow machines show."""
        process = self.start(*arguments, first=first)
        out, err = process.communicate(timeout=300)
        return process.returncode, out, re.sub(r"^[█░].*\n", "", err, flags=re.MULTILINE)

    def finish_under_kills(
        self, *arguments: str, dice: random.Random, longest: float, first: Path | None = None
    ) -> int:
        """Start the command and kill it after up to `longest` [s], until it ends by itself.

        By chance, its whole group is killed, or its main process alone. Return the number of kills.
        """
        killed = 0
        while True:
            process = self.start(*arguments, first=first)
            try:
                _, err = process.communicate(timeout=dice.uniform(0.1, longest))
            except subprocess.TimeoutExpired:
                dice.choice((os.kill, os.killpg))(process.pid, signal.SIGKILL)
                process.communicate()
                killed += 1
            else:
                assert process.returncode == 0, err
                return killed

    def living(self, session: int) -> list[int]:
        """Return the processes of a session that run, zombies left out."""
        living: list[int] = []
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = stat.read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[3]) == session and fields[0] != "Z":
                living.append(int(stat.parent.name))
        return living

    def servers(self, session: int) -> list[int]:
        """Return the processes that the workers of a session are forked from."""
        living = self.living(session)
        parents = set(map(parent_of, living))
        return [each for each in living if each in parents and parent_of(each) == session]

    def workers(self, session: int) -> list[int]:
        """Return the workers of a session."""
        servers = self.servers(session)
        return [each for each in self.living(session) if parent_of(each) in servers]

    def stop(self) -> None:
        """End what a failed test left behind."""
        for process in self._started:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


def outcome_but(
    outcome: tuple[dict[str, Any], dict[str, bytes]], left_out: Collection[int]
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return the outcome of all runs but those at some places of the plan."""
    table, traces = outcome
    kept = [row for row, index in enumerate(table["index"]) if index not in left_out]
    ids = {table["run_id"][row] for row in kept}
    return (
        {name: [values[row] for row in kept] for name, values in table.items()},
        {path: content for path, content in traces.items() if Path(path).stem in ids},
    )


@pytest.fixture(scope="session")
def but() -> Callable[[Any, Collection[int]], Any]:
    return outcome_but


@pytest.fixture
def inject(tmp_path: Path) -> Callable[..., Path]:
    """Return what makes workers fail at runs: a folder that the command looks in first."""

    def write(faults: Mapping[int, str], spare_bytes: int | None = None) -> Path:
        faulty = Path(__file__).with_name("injected_faults.py").read_text()
        folder = spoil_workers(tmp_path / "injected", faulty)
        plan = {"runs": dict(faults), "spare_bytes": spare_bytes}
        (folder / "faults.json").write_text(json.dumps(plan))
        return folder

    return write


@pytest.fixture
def command(tmp_path: Path) -> Iterator[Command]:
    command = Command(tmp_path)
    yield command
    command.stop()


@pytest.fixture
def hostile_folder(tmp_path: Path) -> Callable[[], list[Path]]:
    """Modules of a stranger's in the current folder; return which of them were run."""
    for name in MODULES:
        (tmp_path / f"{name}.py").write_text(f"open('{tmp_path}/ran-{name}', 'w').close()\n")
    return lambda: list(tmp_path.glob("ran-*"))


@pytest.fixture(scope="session")
def until() -> Callable[[Callable[[], bool]], None]:
    """Wait until something holds."""

    def wait(holds: Callable[[], bool]) -> None:
        deadline = time.monotonic() + 60
        while not holds():
            assert time.monotonic() < deadline, "waited for a minute"
            time.sleep(0.005)

    return wait


@pytest.fixture(autouse=True)
def _outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work outside of any repository, whose state records would name."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def _short_clocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Time runs for a moment only, where their times are not what a test is about."""
    for name in ("MIN_SECONDS", "MAX_SECONDS", "STEP_SECONDS"):
        monkeypatch.setattr(f"contactlab.accuracy.timing.{name}", 1e-4)


@pytest.fixture(params=["ball", "slide", "stack"])
def sweep_text(request: pytest.FixtureRequest, ball: str) -> str:
    return {"ball": ball, "slide": SLIDE, "stack": STACK}[request.param]


@pytest.fixture(scope="session")
def stack() -> str:
    return STACK
