"""Workers import nothing of the program that starts a sweep."""

import subprocess
import sys
from pathlib import Path

import pytest

# A script without the usual guard: whoever imports it, runs it.
SCRIPT = """
from pathlib import Path
from contactlab.run.sweep_request import SweepRequest, SceneLoader
from contactlab.run.sweep_runner import run_sweep
from contactlab.parts import register_parts
from contactlab.plan.sweep_file import read_sweep

register_parts()
folder = Path(__file__).parent
with (folder / "began").open("a") as log:
    print("once more", file=log)
text = (folder / "small.yaml").read_text()
scenes = SceneLoader(folder)
read = read_sweep(text, scenes.vocabulary)
ask = SweepRequest(read.plan, scenes.open(read.sweep.scene), "small", text, (), folder / "store", 2)
manifest = run_sweep(ask, lambda *_: None, lambda _: None)
print(manifest.runs)
"""


@pytest.mark.night
def test_a_script_without_a_guard_sweeps_once(tmp_path: Path, ball: str) -> None:
    (tmp_path / "small.yaml").write_text(ball)
    (tmp_path / "script.py").write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, str(tmp_path / "script.py")], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, "18\n"), done.stderr
    assert (tmp_path / "began").read_text() == "once more\n"
