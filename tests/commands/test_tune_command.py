"""`contactlab tune`: one answer in text, data, patch and figure."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest
from tests.commands.conftest import Run

PENDULUM = """
<mujoco>\r
  <!-- a comment stays -->
  <option timestep="0.001" integrator="RK4"/>
  <worldbody>
    <body pos="0 0 1">
      <joint name="hinge" axis="0 1 0" damping="0.05"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>
    </body>
  </worldbody>
</mujoco>
"""
LONG_ENOUGH = ("--duration", "2s", "--drive", "none", "--workers", "1")  # to fall
SHORT = ("--duration", "0.2s", "--drive", "none", "--workers", "1")


@pytest.fixture
def pendulum(tmp_path: Path) -> Path:
    """A pendulum whose steps are several times as short as they have to be."""
    path = tmp_path / "pendulum.xml"
    path.write_bytes(PENDULUM.encode())
    return path


@pytest.mark.long
def test_text_data_patch_and_figure_say_the_same(
    contactlab: Run, pendulum: Path, tmp_path: Path
) -> None:
    asked = (pendulum.name, "-o", "out", "--max-cpu", "60s", *SHORT)
    code, out, err = contactlab("tune", *asked, "--figure", "a.svg")
    assert code == 0, err
    stored: Any = json.loads((tmp_path / "out" / "tune.json").read_text())
    point = stored["recommended"]
    (step,) = [each for each in stored["changed_settings"] if each["name"] == "timestep"]
    assert step["after"] == point["timestep"] > 4e-3
    assert f"{point['timestep']:g}" in out
    written = (tmp_path / "out" / stored["file"]).read_bytes()
    assert f'timestep="{point["timestep"]}"'.encode() in written
    assert b"<!-- a comment stays -->" in written
    assert (tmp_path / "a.svg").stat().st_size > 1000
    code, drawn_again, err = contactlab("tune", *asked, "--figure", "b.svg")
    assert (code, drawn_again) == (0, out)
    assert "not searching again" in err
    assert json.loads((tmp_path / "out" / "tune.json").read_text()) == stored
    made = ["patch", "-p1", "--binary", pendulum.name]
    patch = (tmp_path / "out" / "tuned" / "tuned.patch").read_bytes()
    done = subprocess.run(made, input=patch, cwd=tmp_path, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert pendulum.read_bytes() == written != PENDULUM.encode()


@pytest.mark.long
def test_a_robot_that_falls_is_said_to_fall(contactlab: Run, tmp_path: Path) -> None:
    """A trunk on two hinged legs without torque; the answer is valid for its fall alone."""
    (tmp_path / "walker.xml").write_text(
        """<mujoco><option timestep=".004"/><worldbody><geom type="plane" size="2 2 .1"/>
        <body name="trunk" pos="0 0 .53"><freejoint/><geom type="box" size=".1 .1 .05" mass="5"/>
        <body pos="0 0 -.05"><joint name="hip" axis="0 1 0" damping=".1"/>
        <geom type="box" pos=".03 0 -.24" size=".02 .1 .24" mass="1"/></body></body></worldbody>
        <actuator><motor joint="hip"/></actuator></mujoco>"""
    )
    code, out, err = contactlab("tune", "walker.xml", "--max-cpu", "20s", *LONG_ENOUGH)
    assert code == 0, err
    assert "the drive of this task does not hold the robot up" in " ".join(out.split())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--error", "0"), "--error 0: write a share of the real forces, such as 2%"),
        (("--error", "near"), "--error near: write a share of the real forces, such as 2%"),
        (("--error", "5mm"), "--observe BODY --error-at end"),
        (("--observe", "hand", "--error-at", "end", "--error", "2%"), "leave it out for a share"),
        (("--error", "2"), "--error 2 is not a fraction"),
        (("--max-cpu", "soon"), "--max-cpu soon: write a time, such as 90s, 5min or 1h"),
        (("--tolerance", "slip=1mm"), "--tolerance slip=: tune uses the error budget"),
        (("--tolerance", "slip"), "'--tolerance slip' is not a tolerance"),
        (("--real-time", "-1"), "--real-time -1: write a number above 0"),
        (("--error-at", "end", "--error", "1e-5"), "--error-at needs --observe"),
        (("--observe", "hand", "--error-at", "end", "--error", "1e-5"), "nothing is called 'hand'"),
        (("--drive", "push"), "push"),
    ],
)
def test_a_wrong_option_is_one_line(
    contactlab: Run, pendulum: Path, options: tuple[str, ...], words: str
) -> None:
    code, out, err = contactlab("tune", pendulum.name, "-o", "out", "--workers", "0", *options)
    assert (code, out) == (2, "")
    assert words in err.splitlines()[-1]


def test_a_folder_with_results_of_another_model_is_left_alone(
    contactlab: Run, pendulum: Path, tmp_path: Path
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "sources.json").write_text('{"tune": "/elsewhere/robot.xml"}')
    done = contactlab("tune", pendulum.name, "-o", "out", *SHORT)
    assert done.code == 2
    assert "has the results of /elsewhere/robot.xml" in done.err
    assert [each.name for each in (tmp_path / "out").iterdir()] == ["sources.json"]
