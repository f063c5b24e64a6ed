"""Each command of docs/skills/contactlab/SKILL.md answers as it says."""

import json
import re
import subprocess
import sysconfig
from pathlib import Path

import pytest

import contactlab

TEXT = (Path(__file__).parents[2] / "docs/skills/contactlab/SKILL.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| .* \| `contactlab (.*)` \| (.*) \|$", TEXT, re.MULTILINE)
HERE = [row for row in ROWS if not row[0].startswith("bisect")]
# docs/how-to/upgrading.md: implicitfast loses the energy of free rotation since 3.11.0.
TUMBLE = """
version: 1
scene: tumbling_box
duration: 20
axes: {integrator: [implicitfast], timestep: [0.01]}
"""
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
drive: none
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
    assert len(ROWS) == 16


def printed(folder: Path, *arguments: str) -> str:
    """Return what the command prints in a folder; what is asked holds or not, and no more."""
    done = ended(folder, *arguments)
    assert done.returncode in (0, 1), done.stderr
    return done.stdout


def ended(folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    program = str(Path(sysconfig.get_path("scripts")) / "contactlab")
    command = [program, *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.night
@pytest.mark.parametrize(("words", "fields"), HERE, ids=[row[0].split()[0] for row in HERE])
def test_a_command_answers_with_the_fields(words: str, fields: str, folder: Path) -> None:
    if words.startswith(("compare", "show", "render")):
        for store in ("before", "after"):
            printed(folder, "sweep", "grid.yaml", "-o", store)
        runs = contactlab.open(str(folder / "after")).table["run_id"].to_pylist()
        words = words.replace("RUN", runs[0])
    if "--check" in words:
        printed(folder, "lock", "grid.yaml")
    # An engine that is here, and fewer recorded runs and settings than by default.
    words = words.replace("warp", "impulse")
    words = words.replace("cube_toss", "cube_toss --fitted 2 --free friction.slide=0.1:0.5")
    told, named = printed(folder, *words.split()), set(re.findall(r"`(\w+)`", fields))
    answer = json.loads(told) if named else {}
    first = answer[0] if isinstance(answer, list) else answer
    assert told
    assert named <= set(first)


@pytest.mark.night
def test_a_release_is_looked_for(folder: Path) -> None:
    ((words, fields),) = (row for row in ROWS if row[0].startswith("bisect"))
    (folder / "tumble.yaml").write_text(TUMBLE)
    words = words.replace("grid", "tumble").replace("3.11.0", "3.10.0").replace("4.0.0", "3.11.0")
    done = ended(folder, *words.split(), "--versions", "3.10.0,3.11.0")
    if "cannot be installed" in done.stderr:
        pytest.skip(done.stderr.splitlines()[-1])
    assert set(re.findall(r"`(\w+)`", fields)) <= set(json.loads(done.stdout))
