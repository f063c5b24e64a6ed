"""What the README shows runs as it stands there, one line after the other, in an empty folder."""

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.commands.conftest import contactlab
from tests.docs.test_commands_of_docs import blocks

from contactlab import resources

Run = Callable[..., Any]
__all__ = ["contactlab"]  # a fixture
README = Path(__file__).parents[2] / "README.md"
MODEL = """<mujoco><option timestep="0.005"/><worldbody>
  <geom name="floor" type="plane" size="1 1 .1"/>
  <body name="box" pos="0 0 .15"><freejoint/><geom name="box" type="box" size=".1 .1 .1"/></body>
</worldbody></mujoco>
"""
# A release of MuJoCo is downloaded, and runs of the README's own model take minutes. The command is
# found without a virtual environment.
CHANGED = {
    " --mujoco 3.11.0": "",
    "path/to/robot.xml": "robot.xml",
    "make bounce": "contactlab sweep bounce",
    ". .venv/bin/activate": "",
}
LEAST = {"sweep": ["--limit", "2", "--workers", "0"], "report": ["--traces", "none"]}


def lines() -> list[str]:
    """Return the command lines of blocks that are to be run, `make bounce` as what it runs."""
    text = "\n".join(blocks(README, "sh"))
    for shown, run in CHANGED.items():
        text = text.replace(shown, run)
    return [told for line in text.splitlines() if (told := line.partition("#")[0].strip())]


def test_it_is_short() -> None:
    assert len(README.read_text(encoding="utf-8").split()) < 900


@pytest.mark.long
def test_every_line_of_its_blocks_runs(contactlab: Run, tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(MODEL)
    told = lines()
    assert len(told) >= 8
    for line in told:
        name, command, *words = shlex.split(line)
        assert name == "contactlab"
        code, _, err = contactlab(command, *words, *LEAST.get(command, []))
        assert (line, code, err if code else "") == (line, 0, "")
    written = {path.name for path in tmp_path.rglob("*") if path.suffix in {".html", ".yaml"}}
    assert {"robot.yaml", "robot.html", "bounce.html"} <= written


def test_pictures_that_it_shows_are_there() -> None:
    text = README.read_text(encoding="utf-8")
    shown = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text)
    assert shown
    assert all((README.parent / name).is_file() for name in shown)
    assert resources.sweep_file("bounce").is_file()
