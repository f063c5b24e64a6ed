"""Each command of skills/contactlab/SKILL.md answers as it says."""

import json
import re
import subprocess
import sysconfig
from pathlib import Path

import pytest

import contactlab

TEXT = (Path(__file__).parents[2] / "skills/contactlab/SKILL.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| .* \| `contactlab (.*)` \| (.*) \|$", TEXT, re.MULTILINE)
ROBOT = """
<mujoco>
  <option timestep="0.004"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="slider" pos="0 0 .0499">
      <joint name="x" type="slide" axis="1 0 0" range="-.5 .5" damping="1"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <geom name="foot" type="sphere" size=".05" mass=".2"/>
    </body>
  </worldbody>
  <actuator><position name="push" joint="x" kp="20" ctrlrange="-.2 .2"/></actuator>
</mujoco>
"""
GRID = """
version: 1
scene: robot.xml
duration: 0.2
axes: {timestep: [2.0e-3, 4.0e-3]}
tolerances: {error_final: 1.0}
accuracy: {}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("skill")
    (folder / "robot.xml").write_text(ROBOT)
    (folder / "grid.yaml").write_text(GRID)
    return folder


def test_every_row_is_run() -> None:
    assert len(ROWS) == 8


def printed(folder: Path, *arguments: str) -> str:
    """Return what the command prints in a folder; what is asked holds or not, and no more."""
    program = str(Path(sysconfig.get_path("scripts")) / "contactlab")
    done = subprocess.run(
        [program, *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode in (0, 1), done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(("words", "fields"), ROWS, ids=[row[0].split()[0] for row in ROWS])
def test_a_command_answers_with_the_fields(words: str, fields: str, folder: Path) -> None:
    if words.startswith(("compare", "show")):
        for store in ("before", "after"):
            printed(folder, "sweep", "grid.yaml", "-o", store)
        runs = contactlab.open(str(folder / "after")).table["run_id"].to_pylist()
        words = words.replace("RUN", runs[0])
    answer = json.loads(printed(folder, *words.split()))
    first = answer[0] if isinstance(answer, list) else answer
    assert set(re.findall(r"`(\w+)`", fields)) <= set(first)
