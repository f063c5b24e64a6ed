"""Commands that may take long show their progress on a terminal, and Ctrl-C says what is kept.

The cases follow the declarations: a command that declares what it keeps needs a case here, and a
new command that declares nothing must be one that ends at once.
"""

import os
import pty
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.command_line.declaration import Command
from contactlab.command_line.modules import command_modules, commands_of
from contactlab.commands.sweep import sweep

SLOW_STEPS = Path(__file__).with_name("slow_steps.py")
AT_ONCE = {"advisories", "explain", "init", "list", "show"}
MODEL = "falling.xml"
# Two fingers on slides, which their motors press on a cube.
GRIPPER = """<mujoco><option timestep="0.002"/>
<worldbody><body name="hand" pos="0 0 .3"><geom type="box" size=".05 .02 .01" pos="0 0 .05"/>
{fingers}
</body></worldbody><actuator>
<position joint="left" kp="200" ctrlrange="0 .05" forcerange="-20 20"/>
<position joint="right" kp="200" ctrlrange="0 .05" forcerange="-20 20"/></actuator></mujoco>
"""
FINGER = (
    '<body name="{name}" pos="{x} 0 0"><joint name="{name}" type="slide" axis="{axis} 0 0" '
    'range="0 .05" damping="5"/><geom type="box" size=".005 .01 .02" mass=".05"/></body>'
)
SWEEP = """version: 1
scene: falling.xml
duration: 0.3
seeds: 3
checks: none
axes: {timestep: [1e-3, 2e-3], friction.slide: {linspace: [0.2, 1, 20]}}
"""
CASES = {
    "advisories check": ("advisories", "check"),
    "advisories find": ("advisories", "find", "--mujoco", "3.10.0,4.0.0"),
    "bisect": ("bisect", "sweep.yaml", "--good", "3.10.0", "--bad", "4.0.0"),
    "compare": ("compare", "store", "other", "--thorough"),
    "diff": ("diff", MODEL, "other.xml"),
    "effects": ("effects", MODEL),
    "examine": ("examine", MODEL),
    "fit": ("fit", "tossed"),
    "gradients": (
        *("gradients", MODEL, "--output-coordinate", "box.z", "--input", "box.z,box.x"),
        *("--drive", "none"),
    ),
    "grip": ("grip", "gripper.xml"),
    "lint": ("lint", MODEL, "other.xml", "gripper.xml"),
    "lock": ("lock", "long.yaml"),
    "parity": ("parity", "--closed-forms"),
    "render": ("render", "store", "-o", "messages"),
    "report": ("report", "store"),
    "shrink": ("shrink", "failing", "RUN"),
    "stability": ("stability",),
    "success": ("success", "sweep.yaml"),
    "sweep": ("sweep", "long.yaml", "-o", "again"),
    "tradeoff": ("tradeoff", "sweep.yaml"),
    "tune": ("tune", MODEL, "--max-cpu", "30s"),
    "verify": ("verify", "store", "--simulate", "20"),
}
MERGE = ("sweep", "--merge", "shard1", "shard2", "-o", "merged")
NEEDS_MORE = {
    "advisories find": "installs two releases of MuJoCo",
    "bisect": "installs releases of MuJoCo",
    "fit": "needs a recording",
    "success": "needs a policy",
}
"""Cases that run elsewhere, and why."""


def declared_commands() -> list[Command]:
    return [each for name in command_modules() for each in commands_of(name)]


def test_each_command_declares_its_interruption() -> None:
    declared = {command.name for command in declared_commands() if command.keeps}
    assert declared == CASES.keys()
    rest = {command.name for command in declared_commands() if not command.keeps}
    assert rest == AT_ONCE


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Models, a sweep, and stores of all kinds of commands."""
    folder = tmp_path_factory.mktemp("long")
    box = '<geom name="b" type="box" size=".05 .05 .05"/>'
    for name, size in ((MODEL, "1 1 .1"), ("other.xml", "1 2 .1")):
        floor = f'<geom name="floor" type="plane" size="{size}"/>'
        body = f'<body name="box" pos="0 0 .2"><freejoint/>{box}</body>'
        (folder / name).write_text(f"<mujoco><worldbody>{floor}{body}</worldbody></mujoco>")
    fingers = [
        FINGER.format(name=name, x=x, axis=axis)
        for name, x, axis in (("left", -0.06, 1), ("right", 0.06, -1))
    ]
    (folder / "gripper.xml").write_text(GRIPPER.format(fingers="\n".join(fingers)))
    source = folder / "sweep.yaml"
    source.write_text(SWEEP)
    # More runs than workers have at once, however many there are.
    (folder / "long.yaml").write_text(SWEEP.replace("seeds: 3", "seeds: 100"))
    for store in ("store", "other"):
        sweep(source, output=folder / store, workers=0)
    for part in (1, 2):
        sweep(source, output=folder / f"shard{part}", shard=f"{part}/2", workers=0)
    steps = ("timestep=0.1", "duration=1", "friction.slide=1")
    sweep(source, output=folder / "failing", set=steps, workers=0)
    return folder


class OnTerminal:
    """A command with slow steps and with a terminal as its stderr."""

    def __init__(self, folder: Path, *words: str) -> None:
        self._ours, theirs = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, SLOW_STEPS, *words],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=theirs,
            env={**os.environ, "TERM": "xterm", "COLUMNS": "150"},
            start_new_session=True,
        )
        os.close(theirs)
        self.shown = ""

    def read_until(self, holds: Callable[[str], bool], seconds: float = 120.0) -> bool:
        """Return whether the shown text fulfills a condition before the end."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if holds(self.shown):
                return True
            if select.select([self._ours], [], [], 0.2)[0]:
                try:
                    data = os.read(self._ours, 1 << 16)
                except OSError:
                    data = b""
                if not data:
                    return holds(self.shown)
                self.shown += data.decode(errors="replace")
        return False

    def close(self) -> None:
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        os.close(self._ours)


def shows_progress(text: str) -> bool:
    return "░" in text or "█" in text


def words_of(name: str, folder: Path) -> tuple[str, ...]:
    if "RUN" not in CASES.get(name, ()):
        return CASES.get(name, MERGE)
    from contactlab.store.finished_store import Store  # noqa: PLC0415 - collection is quick

    records = Store.open(folder / "failing").records()
    run = next(each.run_id for each in records if each.label != "stable")
    return tuple(run if word == "RUN" else word for word in CASES[name])


@pytest.fixture
def started(folder: Path, tmp_path: Path) -> Any:
    """Start a command in a copy of the folder."""
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    begun = list[OnTerminal]()

    def start(name: str) -> OnTerminal:
        begun.append(OnTerminal(copy, *words_of(name, folder)))
        return begun[-1]

    yield start
    for each in begun:
        each.close()


LONG = [
    pytest.param(name, marks=pytest.mark.night if name == "stability" else pytest.mark.long)
    for name in [*sorted(CASES.keys() - NEEDS_MORE.keys()), "merge"]
]


@pytest.mark.parametrize("name", LONG)
def test_progress_has_an_estimate_and_ctrl_c_says_what_is_kept(
    started: Any, name: str, tmp_path: Path
) -> None:
    command = started(name)
    assert command.read_until(lambda text: shows_progress(text) and " left" in text), command.shown
    os.kill(command.process.pid, signal.SIGINT)
    command.read_until(lambda _: False)
    code, last = command.process.wait(), command.shown.splitlines()[-1]
    assert code == 130, command.shown
    assert "interrupted; " in last, command.shown
    assert "Traceback" not in command.shown
    assert not list((tmp_path / "copy").rglob("*.tmp*"))
