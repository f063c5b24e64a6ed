"""Another version of the engine: how its environment is made, and what goes wrong clearly."""

import importlib.util
import os
import re
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import distribution, requires, version
from pathlib import Path

import pytest
from tests.grip.grippers import claw

from contactlab.errors import EngineError
from contactlab.run import mujoco_environment
from contactlab.run.mujoco_environment import find_interpreter, without_option
from contactlab.store.finished_store import Store
from contactlab.studies.lock.versions import run_python

HERE = version("mujoco")
OTHER = "3.17.0" if HERE != "3.17.0" else "3.16.0"
MAIN = [sys.executable, "-c", "from contactlab.__main__ import main; main()"]
# Notes what it is told, and makes a Python that says what a real one would.
UV = """#!/bin/sh
echo "$@" >> "$NOTES"
case "$1" in
  venv)
    for folder; do :; done
    mkdir -p "$folder/bin"
    cat > "$folder/bin/python" <<'END'
#!/bin/sh
case "$2" in *print*) echo VERSION; exit 0;; esac
shift 2
echo "arguments: $@"
echo "path: $PYTHONPATH"
echo "to stderr" >&2
exit 7
END
    chmod +x "$folder/bin/python";;
  pip) [ -z "$FAILS" ] || { echo "$FAILS" >&2; exit 2; };;
esac
"""
Fake = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "contactlab"


@pytest.fixture
def notes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cache: Path) -> Path:
    """Put an uv on the path that installs nothing."""
    assert not cache.exists()
    program = tmp_path / "bin" / "uv"
    program.parent.mkdir()
    program.write_text(UV.replace("VERSION", OTHER))
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(program.parent), prepend=os.pathsep)
    monkeypatch.setenv("NOTES", str(tmp_path / "notes"))
    monkeypatch.setenv("FAILS", "")
    return tmp_path / "notes"


def run(*arguments: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [*MAIN, *arguments], cwd=folder, capture_output=True, text=True, check=False
    )


def test_uv_makes_the_environment(notes: Path) -> None:
    told: list[str] = []
    found = find_interpreter(OTHER, told.append)
    assert found is not None
    assert found.mujoco == OTHER
    assert found.python.is_file()
    made, installed = notes.read_text().splitlines()
    assert made.startswith(f"venv --quiet --python {sys.executable} ")
    assert installed.startswith("pip install --quiet --python ")
    wanted = installed.split()
    assert f"mujoco=={OTHER}" in wanted
    assert wanted[wanted.index("--only-binary") + 1] == "mujoco"
    # The rest is as it is here, so that nothing but the engine differs.
    for name in ("numpy", "pyarrow", "pydantic", "scipy", "typer"):
        assert f"{name}=={version(name)}" in wanted
    assert len([each for each in wanted if each.startswith("mujoco==")]) == 1
    assert len(told) == 1


def test_it_is_made_once_and_again_where_its_python_is_gone(notes: Path, cache: Path) -> None:
    first = find_interpreter(OTHER, lambda _: None)
    again = find_interpreter(OTHER, lambda _: pytest.fail("said that it is made again"))
    assert again == first
    assert len(notes.read_text().splitlines()) == 2
    assert first is not None
    first.python.unlink()
    assert find_interpreter(OTHER, lambda _: None) == first
    assert first.python.exists()
    assert not list(cache.glob("new-*"))


def test_venv_and_pip_do_without_uv(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    made, installed = mujoco_environment.install_commands(
        tmp_path, ["mujoco==3.9.0", "numpy==2.2.0"]
    )
    assert made == [sys.executable, "-P", "-m", "venv", str(tmp_path)]
    assert installed[:5] == [str(tmp_path / "bin" / "python"), "-P", "-m", "pip", "install"]
    assert installed[-2:] == ["mujoco==3.9.0", "numpy==2.2.0"]


def test_uv_as_a_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name)
    made, _ = mujoco_environment.install_commands(tmp_path, [])
    assert made[:5] == [sys.executable, "-P", "-m", "uv", "venv"]


@pytest.mark.night
@pytest.mark.parametrize("option", [["--mujoco", OTHER], [f"--mujoco={OTHER}"]])
def test_the_other_one_takes_over(option: list[str], notes: Path, tmp_path: Path) -> None:
    done = run("sweep", "bounce", *option, "--limit", "2", folder=tmp_path)
    assert done.returncode == 7
    arguments, path = done.stdout.splitlines()
    assert arguments == f"arguments: sweep bounce --limit 2 -o results/bounce-{OTHER}"
    assert done.stderr.endswith("to stderr\n")
    linked = Path(path.removeprefix("path: "))
    # Nothing but this very code can be imported from there, with the packages beside it.
    own = {each.module.partition(".")[0] for each in distribution("contactlab").entry_points}
    metadata = f"contactlab-{version('contactlab')}.dist-info"
    assert {each.name for each in linked.iterdir()} == {*own, metadata}
    assert (linked / "contactlab" / "py.typed").is_file()
    assert notes.is_file()


@pytest.mark.night
@pytest.mark.usefixtures("notes")
def test_a_store_that_is_named_stays_so(tmp_path: Path) -> None:
    done = run("sweep", "bounce", "-o", "mine", "--mujoco", OTHER, folder=tmp_path)
    assert done.stdout.splitlines()[0] == "arguments: sweep bounce -o mine"
    done = run("stability", "tower_20", "--mujoco", OTHER, folder=tmp_path)
    expected = f"arguments: stability tower_20 -o results/stability-{OTHER}"
    assert done.stdout.splitlines()[0] == expected


def test_the_engine_of_this_process_needs_no_other(notes: Path) -> None:
    assert find_interpreter(HERE, lambda _: None) is None
    assert not notes.exists()


def test_a_failing_installer_speaks_for_itself(
    notes: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = "Because there is no version of mujoco==3.17.0\nand you require it"
    monkeypatch.setenv("FAILS", said)
    with pytest.raises(EngineError) as caught:
        find_interpreter(OTHER, lambda _: None)
    assert f"MuJoCo {OTHER} cannot be installed" in str(caught.value)
    assert str(caught.value).endswith("".join(f"\n  {line}" for line in said.splitlines()))
    assert "--mujoco the path of a Python" in str(caught.value)
    # Nothing half made is left, so that the next try starts anew.
    assert list(cache.glob("mujoco-*")) == []
    assert notes.is_file()


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ("2.3.7", "runs on MuJoCo 3.3.4 and newer"),
        ("5.0.0", "below 5"),
        ("nowhere/python", "neither a version of MuJoCo"),
        ("latest", "neither a version of MuJoCo"),
    ],
)
def test_what_is_no_engine(asked: str, message: str, cache: Path) -> None:
    with pytest.raises(EngineError, match=message):
        find_interpreter(asked, lambda _: None)
    assert not cache.exists()


@pytest.mark.long
def test_a_mistake_is_one_line(cache: Path, tmp_path: Path) -> None:
    done = run("sweep", "bounce", "--mujoco", "2.3.7", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: contactlab runs on MuJoCo 3.3.4 and newer")
    assert len(done.stderr.splitlines()) == 1
    assert not cache.exists()


def test_a_python_without_mujoco(cache: Path, tmp_path: Path) -> None:
    bare = tmp_path / "python"
    bare.write_text(f'#!/bin/sh\nexec "{Path(sys.executable).resolve()}" -S "$@"\n')
    bare.chmod(0o755)
    with pytest.raises(EngineError, match="No module named 'mujoco'") as caught:
        find_interpreter(str(bare), lambda _: None)
    assert "it needs: mujoco" in str(caught.value)
    assert cache.exists()


@pytest.mark.night
def test_a_python_that_is_given(cache: Path) -> None:
    found = find_interpreter(sys.executable, lambda _: None)
    assert found is not None
    assert (found.python, found.mujoco) == (Path(sys.executable), HERE)
    assert list(cache.glob("mujoco-*")) == []


def test_options_are_taken_out() -> None:
    given = ["sweep", "x", "--mujoco", "3.9.0", "--set", "a=1", "--mujoco=3.8.0"]
    assert without_option(given, "--mujoco") == ["sweep", "x", "--set", "a=1"]


# The oldest that is promised, the last before flags were split (3.3.6), and minor releases since.
PROMISED = ("3.3.4", "3.3.7", "3.6.0", "3.11.0", "3.14.0")


@pytest.mark.night
@pytest.mark.parametrize("mujoco", PROMISED)
def test_bounce_under_another_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mujoco: str
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    options = ("--limit", "6", "--workers", "1", "-o", "store")
    done = run("sweep", "bounce", "--mujoco", mujoco, *options, folder=tmp_path)
    if "cannot be installed" in done.stderr:
        pytest.skip(done.stderr)
    assert done.returncode == 0, done.stderr
    assert "6 runs, 6 traces in store" in done.stdout
    store = Store.open(tmp_path / "store")
    assert {record.engine.version for record in store.records()} == {mujoco}
    assert all(record.cost and record.cost.cpu_s > 0 for record in store.records())
    again = run("sweep", "bounce", "--mujoco", mujoco, *options, folder=tmp_path)
    assert "6 of 6 runs are stored already" in again.stderr


@pytest.mark.night
def test_all_ways_to_simulate_work_under_the_oldest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An examination holds and replays controls; a grip deletes parts of its model."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    Path("claw.xml").write_text(claw())
    for command in ("examine", "grip"):
        done = run_python(
            ["-P", "-m", "contactlab", command, "claw.xml"], PROMISED[0], lambda _: None
        )
        assert done.returncode in {0, 1}, "sound or not"
        assert "claw" in done.stdout


def test_the_range_that_is_tried_begins_where_the_promise_does() -> None:
    """What pyproject asks for, and the oldest that `--mujoco` takes."""
    needed = next(each for each in requires("contactlab") or () if re.match("mujoco[<>]", each))
    assert needed.partition(">=")[2].partition(",")[0] == PROMISED[0] == mujoco_environment.OLDEST
