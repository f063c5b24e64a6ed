"""What is loaded, and when: counted by modules, since times depend on the machine."""

import os
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from tests.commands.sweep_index import sweep_index
from tests.run.spoiled_workers import spoil_workers

from contactlab import resources

BALL = """
version: 1
scene: ball_drop
duration: 0.05
checks: none
"""
TUNNELING = """
version: 1
scene: ball_drop
duration: 1
axes: {timestep: [2.0e-2]}
"""
# Runs a command, which ends the process, and fails if it has loaded what it has no use for.
COMMAND = """
import sys
from contactlab.__main__ import main
unused = set(sys.argv[1].split())
sys.argv[1:] = sys.argv[2:]
try:
    main()
except SystemExit as end:
    assert not end.code
    assert not unused & set(sys.modules), unused & set(sys.modules)
else:
    raise AssertionError("it did not end")
"""
SCRIPT = str(Path(sysconfig.get_path("scripts")) / "contactlab")
SWEEP = ["sweep", "ball.yaml", "-o", "store", "--workers", "0"]
# Prints the size of each row that is stored, and fails for one with nulls.
ROWS = """
import contactlab.startup
import json
from contactlab.store.store_writer import StoreWriter
append = StoreWriter.append_rows
def watched(writer, rows, shared=b""):
    for row in rows:
        assert None not in json.loads(row).values()
        print(len(row))
    append(writer, rows, shared)
StoreWriter.append_rows = watched
"""
# Prints a line for each Python that starts, and one for each process that is forked from it. Where
# there is a display, GLFW starts more.
STARTS = """
import os
os.write(2, b"started\\n")
os.environ["MUJOCO_GL"] = "disable"
os.register_at_fork(before=lambda: os.write(2, b"forked\\n"))
"""
# A plug-in with a thread, which waits as long as its process lives.
THREADED = """
import threading
from contactlab.measure import metric
threading.Thread(target=threading.Event().wait, daemon=True).start()
@metric(unit="1")
def nothing(context):
    \"\"\"Nothing.\"\"\"
    return context.trace.timestep
"""
# Prints what a worker loads that the server had not; a process needs two modules to become one.
LOADED = """
import os, sys
from contactlab.run.worker import Worker
before, run, start = set(), Worker.run, Worker.__init__

def starting(self, *arguments):
    before.update(sys.modules)
    start(self, *arguments)

def watched(self, job):
    found = run(self, job)
    added = {each for each in set(sys.modules) - before if not each.startswith("multiprocessing.")}
    os.write(2, f"{sorted(added - {'encodings.utf_8_sig'})}\\n".encode())
    return found

Worker.run, Worker.__init__ = watched, starting
"""


# As every so many-th module is looked for, from the first after the command's own, a copy of the
# process has Ctrl-C; noted are the module's name, how the copy ends, and what it says.
INTERRUPTED = """
import os, signal, sys
from itertools import count
own, begun, number, ends = {"contactlab", "contactlab.__main__"}, set(), count(), open("ends", "a")

class Interrupter:
    def find_spec(name, path=None, target=None):
        begun.update({name} & own)
        if name in own or not begun or next(number) % EVERY:
            return
        copy = os.fork()
        if copy == 0:
            sys.meta_path.remove(Interrupter)
            said = os.open("said", os.O_CREAT | os.O_WRONLY | os.O_TRUNC)
            os.dup2(said, 1), os.dup2(said, 2)
            signal.raise_signal(signal.SIGINT)
            return
        end = os.waitstatus_to_exitcode(os.waitpid(copy, 0)[1])
        print(name, end, os.stat("said").st_size, file=ends, flush=True)

sys.meta_path.insert(0, Interrupter)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "ball.yaml").write_text(BALL)
    return tmp_path


def run(code: str, folder: Path, *arguments: str) -> str:
    """Return what code prints in a process of its own."""
    return finish([sys.executable, "-c", code, *arguments], folder).stdout


def finish(command: list[str], folder: Path) -> "subprocess.CompletedProcess[str]":
    """Return what a command printed that finds modules in a folder."""
    path = os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        command,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done


def starts(folder: Path, *arguments: str) -> list[str]:
    """Return the Pythons that a sweep starts, and the forks of each, in order."""
    (folder / "sitecustomize.py").write_text(STARTS)
    command = [sys.executable, "-m", "contactlab", "sweep", "ball.yaml", *arguments]
    return re.findall("started|forked", finish(command, folder).stderr)


def interrupted(folder: Path, every: int, *command: str) -> list[tuple[str, str, str]]:
    """Return the module, the exit code and the bytes said of each copy that had Ctrl-C."""
    (folder / "sitecustomize.py").write_text(f"EVERY = {every}{INTERRUPTED}")
    finish([sys.executable, *command], folder)
    name_end_said = re.compile(r"(\S+) (\S+) (\d+)")
    return name_end_said.findall((folder / "ends").read_text())


@pytest.mark.parametrize(
    ("entry", "every"),
    [
        (["-m", "contactlab"], 20),
        ([SCRIPT], 20),
        pytest.param(["-m", "contactlab"], 1, marks=pytest.mark.long),
        pytest.param([SCRIPT], 1, marks=pytest.mark.long),
    ],
)
def test_ctrl_c_is_quiet_whatever_is_loaded(folder: Path, entry: list[str], every: int) -> None:
    first, *rest = interrupted(folder, every, *entry, "list", "sweeps")
    assert first == ("contactlab.startup", "130", "0"), "something is loaded before it is heard"
    assert len(rest) > 200 // every
    assert {(end, said) for _, end, said in rest} == {("130", "0")}


@pytest.mark.long
def test_ctrl_c_is_quiet_where_libraries_in_c_are_loaded(folder: Path) -> None:
    """They lose an exception, or tell of it as an ImportError; a sweep says how to resume."""
    found = interrupted(folder, 1, "-m", "contactlab", *SWEEP)
    assert {"mujoco._structs", "mujoco._callbacks"} <= {name for name, *_ in found}
    resume = "interrupted; finished runs are kept: run the same command again to resume\n"
    assert {end for _, end, _ in found} == {"130"}
    said = [int(size) for *_, size in found]
    assert set(said) == {0, len(resume)}
    assert said == sorted(said), "a sweep that has begun ends without a word"


@pytest.mark.long
def test_a_sweep_loads_no_more_than_it_needs(folder: Path) -> None:
    """It has no second passes, pictures and references."""
    (folder / "pandas.py").touch()
    unused = "altair av jinja2 obstore pandas ray scipy"
    run(COMMAND, folder, unused, *SWEEP)


@pytest.mark.long
def test_a_command_loads_no_more_than_it_prints(folder: Path) -> None:
    (folder / "ball.yaml").write_text(f"{BALL}seeds: 13\n")
    run(COMMAND, folder, "", *SWEEP)
    (folder / "pandas.py").touch()
    engine = "mujoco scipy ruamel.yaml mcap pandas zstandard"
    run(COMMAND, folder, engine, "show", "store")
    table = "numpy pyarrow contactlab.plugins contactlab.commands.sweep"
    run(COMMAND, folder, f"{engine} {table}", "list", "sweeps")


@pytest.mark.long
def test_each_worker_is_forked(folder: Path) -> None:
    """Started are the command, the resource tracker and the server, from which a worker forks."""
    found = starts(folder, "-o", "store", "--workers", "2")
    assert sorted(found) == ["forked", *["started"] * 3]


@pytest.mark.long
def test_threads_of_plugins_are_no_hindrance(folder: Path) -> None:
    """A fork has none of a process's threads, but what they hold; the server has no plug-ins."""
    (folder / "busy.py").write_text(THREADED)
    arguments = ("-o", "store", "--workers", "1", "--plugin", "busy.py")
    assert sorted(starts(folder, *arguments)) == ["forked", *["started"] * 3]


@pytest.mark.long
def test_what_runs_nothing_forks_nothing(folder: Path) -> None:
    assert starts(folder, "--plan") == ["started"]
    run(COMMAND, folder, "", *SWEEP)
    assert starts(folder, "-o", "store") == ["started"]


@pytest.mark.long
def test_a_worker_loads_nothing_of_its_own(folder: Path) -> None:
    """Not even where runs are flagged, and checked in a second pass: here as they fall through."""
    (folder / "ball.yaml").write_text(TUNNELING)
    spoil_workers(folder, LOADED)
    command = [sys.executable, "-m", "contactlab", "sweep", "ball.yaml", "-o", "store"]
    done = finish([*command, "--workers", "1"], folder)
    assert "tunneling" in done.stdout
    assert "[]\n" in done.stderr
    assert "['" not in done.stderr


@pytest.mark.long
def test_a_row_of_the_journal_has_no_nulls(folder: Path) -> None:
    """It is 4.8 kB, of which effects and settings are half; 1.4 kB more with what is not known."""
    printed = run(ROWS + COMMAND, folder, "", *SWEEP).splitlines()
    sizes = [int(each) for each in printed if each.isdecimal()]
    assert sizes
    assert max(sizes) < 5500


@pytest.mark.long
def test_the_index_of_sweeps_is_that_of_the_files() -> None:
    stored = {key: list(row) for key, row in resources.sweep_index().items()}
    assert stored == sweep_index(), "make it anew: python -m tests.commands.sweep_index"


def test_an_older_mujoco_loads_without_a_display() -> None:
    """Up to 3.x it imports the context of GLFW without asking whether it is there."""
    code = """
import contactlab.startup
from mujoco.glfw import GLContext
try:
    GLContext(1, 1)
except ImportError as error:
    print(error)
"""
    named = {name: value for name, value in os.environ.items() if "DISPLAY" not in name}
    named.pop("MUJOCO_GL", None)
    done = subprocess.run(
        [sys.executable, "-c", code], env=named, capture_output=True, text=True, check=True
    )
    assert done.stdout == "GLFW needs a display; set MUJOCO_GL to egl or osmesa\n"


# Frees blocks of 24 MB between small ones that stay, and prints the megabytes that the system has
# back. The first block raises glibc's threshold for blocks that are mapped alone.
FREED_BLOCKS = """
import contactlab.startup
import os
import numpy as np
def used():
    with open("/proc/self/statm") as pages:
        return int(pages.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
first = np.ones(15 << 18)
del first
blocks, small = [], []
for _ in range(8):
    blocks.append(np.ones(3 << 20))
    small.append(np.ones(1 << 13))
before = used()
del blocks
print((before - used()) / 1e6)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's heap")
def test_freed_models_go_back_to_the_system() -> None:
    """All but a tenth of 201 MB; in glibc's usual heap the small blocks keep all of them."""
    done = subprocess.run(
        [sys.executable, "-c", FREED_BLOCKS], capture_output=True, text=True, check=True
    )
    assert float(done.stdout) > 0.9 * 8 * 25.2
