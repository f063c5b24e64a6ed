"""Commands that run models run a policy only where they are told so."""

from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.long

COMMANDS: dict[str, list[str]] = {
    "examine": ["examine", "arm.xml", "--drive", "still.py:Still", "--duration", "0.05"],
    "sweep": ["sweep", "sweep.yaml", "--workers", "0"],
    "tradeoff": ["tradeoff", "sweep.yaml", "--workers", "0"],
}
SWEEP = """\
version: 1
scene: {scene}
duration: 0.05
drive: {{policy: still.py:Still}}
axes: {{timestep: [0.002, 0.004]}}
accuracy: {{error: trajectory, refine: 2}}
timing: {{}}
"""
STILL = """
import numpy as np

class Still:
    def __init__(self, model):
        open("ran", "w").close()
        print("not a word of this belongs to the output")
        self.actuators = model.nu

    def __call__(self, time, qpos, qvel, sensordata):
        return np.zeros((len(time), self.actuators))
"""
MODEL = """
<mujoco>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/>
    </body>
  </worldbody>
  <actuator><motor joint="hinge"/></actuator>
</mujoco>
"""


@pytest.fixture
def here(tmp_path: Path) -> Path:
    (tmp_path / "arm.xml").write_text(MODEL)
    (tmp_path / "still.py").write_text(STILL)
    (tmp_path / "sweep.yaml").write_text(SWEEP.format(scene="arm.xml"))
    return tmp_path


@pytest.mark.parametrize("command", COMMANDS)
def test_code_runs_where_it_is_allowed(command: str, here: Path, contactlab: Any) -> None:
    refused = contactlab(*COMMANDS[command])
    assert refused.code == 2
    assert "--allow-code" in refused.err
    assert refused.err.count("\n") == 1
    assert not (here / "ran").exists()
    done = contactlab(*COMMANDS[command], "--allow-code", "--format", "json")
    assert done.code == 0, done.err
    assert (here / "ran").exists()
    assert "not a word" not in done.out
