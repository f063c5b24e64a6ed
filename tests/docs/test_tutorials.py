"""The tutorials run one after the other in one folder, with the files that they show."""

import os
import re
import shlex
import subprocess
import sysconfig
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "docs/tutorials"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
FAILS = "exits with 1"


def write_files(text: str, folder: Path) -> None:
    """Write the model, and the blocks that begin with the name of a file."""
    for language, block in BLOCK.findall(text):
        name = re.match(r"# (\S+\.\w+)\n", block)
        if language == "xml":
            (folder / "pusher.xml").write_text(block)
        elif name:
            (folder / name[1]).write_text(block)


def commands(text: str) -> list[tuple[str, int]]:
    """Return the lines of shell blocks with their exit codes."""
    lines = [
        line for kind, block in BLOCK.findall(text) if kind == "sh" for line in block.split("\n")
    ]
    return [(line, int(FAILS in line)) for line in lines if line.strip()]


@pytest.mark.night
def test_the_tutorials_run(tmp_path: Path) -> None:
    programs = sysconfig.get_path("scripts")
    environment = {**os.environ, "PATH": os.pathsep.join([programs, os.environ["PATH"]])}
    for page in sorted(FOLDER.glob("*.md")):
        text = page.read_text(encoding="utf-8")
        write_files(text, tmp_path)
        for line, code in commands(text):
            done = subprocess.run(
                ["bash", "-c", line], cwd=tmp_path, env=environment, capture_output=True, text=True,
                check=False,
            )  # fmt: skip
            assert done.returncode == code, f"{page.name}: {line}\n{done.stdout}\n{done.stderr}"


def test_every_command_is_of_a_known_program() -> None:
    for page in FOLDER.glob("*.md"):
        for line, _ in commands(page.read_text(encoding="utf-8")):
            assert shlex.split(line)[0] in {"contactlab", "python", "sed"}
