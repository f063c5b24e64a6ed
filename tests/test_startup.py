"""What is loaded, and when: counted by modules, since times depend on the machine."""

import subprocess
import sys
from pathlib import Path

import pytest
from tests.commands.sweep_index import sweep_index

from contactlab import resources

BALL = """
version: 1
scene: ball_drop
duration: 0.05
checks: none
"""
GLFW = """
import sys
import contactlab.startup
import mujoco, glfw
assert "glfw.library" not in sys.modules
assert not hasattr(glfw, "__warningregistry__")
assert "glfw.library" not in sys.modules
assert glfw.get_version()
assert "glfw.library" in sys.modules
"""
# What a sweep without second passes, pictures and references has no use for.
SWEEP = """
import sys
from contactlab.__main__ import main
sys.argv = ["contactlab", "sweep", "ball.yaml", "-o", "store", "--workers", "0"]
main()
unused = {"altair", "av", "glfw.library", "jinja2", "numpy.ma", "obstore", "ray", "scipy"}
assert not unused & set(sys.modules), unused & set(sys.modules)
"""
# Prints the size of each row that is stored, and fails for one with nulls.
ROWS = """
import json
from contactlab.store.store_writer import StoreWriter
append = StoreWriter.append
def watched(writer, rows):
    for row in rows:
        assert None not in json.loads(row).values()
        print(len(row))
    append(writer, rows)
StoreWriter.append = watched
"""
# Where the server would start, prints whether this process has loaded the engine.
SERVER = """
import sys
from multiprocessing import forkserver

def start():
    print("mujoco" in sys.modules)
    raise SystemExit

forkserver.ensure_running = start
from contactlab.__main__ import main
sys.argv = ["contactlab", *sys.argv[1:]]
main()
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "ball.yaml").write_text(BALL)
    return tmp_path


def run(code: str, folder: Path, *arguments: str) -> str:
    """Return what code prints in a process of its own."""
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_glfw_runs_when_it_is_used(folder: Path) -> None:
    pytest.importorskip("glfw")
    run(GLFW, folder)


def test_a_sweep_loads_no_more_than_it_needs(folder: Path) -> None:
    run(SWEEP, folder)


def test_the_fork_server_starts_before_the_engine_is_loaded(folder: Path) -> None:
    assert run(SERVER, folder, "sweep", "ball.yaml", "-o", "store") == "False\n"


def test_what_runs_nothing_starts_no_fork_server(folder: Path) -> None:
    assert "True" not in run(SERVER, folder, "sweep", "ball.yaml", "--plan")
    run(SWEEP, folder)
    assert "1 runs, 1 traces" in run(SERVER, folder, "sweep", "ball.yaml", "-o", "store")


def test_a_row_of_the_journal_has_no_nulls(folder: Path) -> None:
    """It is 4.8 kB, of which effects and settings are half; 1.4 kB more with what is not known."""
    program = SWEEP.replace("main()", f"{ROWS}main()", 1)
    sizes = [int(each) for each in run(program, folder).splitlines() if each.isdecimal()]
    assert sizes
    assert max(sizes) < 5500


def test_the_index_of_sweeps_is_that_of_the_files() -> None:
    stored = {key: list(row) for key, row in resources.sweep_index().items()}
    assert stored == sweep_index(), "make it anew: python -m tests.commands.sweep_index"
