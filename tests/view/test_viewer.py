"""The viewer without a display."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.long

CODE = """
from contactlab.errors import SceneError
from contactlab.scene.scene import Scene
from contactlab.view.render import open_viewer
scene = Scene.open("ball_drop")
run = scene.resolve({}, 0, None)
try:
    open_viewer(scene.base({}).prepare(run.list_edits()).model, scene.initial_states([run]))
except SceneError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only there is a display easily taken away")
def test_without_a_display_there_is_a_clear_error() -> None:
    hidden = {"DISPLAY", "WAYLAND_DISPLAY"}
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    result = subprocess.run(
        [sys.executable, "-c", CODE],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert "no display" in result.stdout
