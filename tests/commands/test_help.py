"""Help is instant, and stored evidence is read without the engine."""

import os
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from contactlab.command_line.declaration import TITLES
from contactlab.command_line.main import command_line

Run = Callable[..., Any]
COMMANDS = [
    each.name or getattr(each.callback, "__name__", "")
    for each in command_line().registered_commands
]
LOADED = """
import sys
from contactlab.__main__ import main
sys.argv = ["contactlab", *sys.argv[1:]]
try:
    main()
finally:
    heavy = {"mujoco", "numpy", "pyarrow", "scipy"} & set(sys.modules)
    print(",".join(sorted(heavy)) or "-", file=sys.stderr)
"""


def loaded(*arguments: str, folder: Path) -> str:
    """Return the heavy modules that a command loads in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", LOADED, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stderr.splitlines()[-1]


def test_all_commands_are_listed(contactlab: Run) -> None:
    code, out, _ = contactlab("--help")
    assert code == 0
    assert all(f"\n  {name} " in out for name in COMMANDS)
    assert len(COMMANDS) >= 8


def test_the_version_is_printed(contactlab: Run) -> None:
    assert contactlab("--version") == (0, f"contactlab {version('contactlab')}\n", "")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help(contactlab: Run, name: str) -> None:
    code, out, err = contactlab(name, "--help")
    assert (code, err) == (0, "")
    assert out.startswith(f"Usage: contactlab {name} ")
    assert f"  Examples:\n    contactlab {name}" in out
    assert "\n  Exit codes: 0 " in out


@pytest.mark.long
def test_help_loads_little() -> None:
    """Some 330 modules as it is; the engine's or Arrow's alone are hundreds more."""
    counted = f"{LOADED}    print(len(sys.modules), file=sys.stderr)\n"
    command = [sys.executable, "-c", counted, "sweep", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert int(done.stderr.splitlines()[-1]) < 450


@pytest.mark.long
@pytest.mark.parametrize(
    ("arguments", "modules"),
    [
        (["--help"], "-"),
        (["sweep", "--help"], "-"),
        (["list", "schemas", "record"], "-"),
        (["list", "sweeps"], "-"),
        (["show", "store"], "numpy,pyarrow"),
        (["verify", "store"], "mujoco,numpy,pyarrow"),
    ],
)
def test_commands_load_no_more_than_they_need(
    store: Path, tmp_path: Path, arguments: list[str], modules: str
) -> None:
    assert (tmp_path / store).is_dir()
    assert set(loaded(*arguments, folder=tmp_path).split(",")) <= set(modules.split(","))


@pytest.mark.long
def test_a_reader_that_leaves_is_no_error(store: Path, tmp_path: Path) -> None:
    """As in `contactlab show store | head -1`."""
    assert (tmp_path / store).is_dir()
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-c", "from contactlab.__main__ import main; main()"]
    with os.fdopen(write, "wb") as closed:
        done = subprocess.run(
            [*command, "show", "store", "--format", "json"],
            cwd=tmp_path,
            stdout=closed,
            stderr=subprocess.PIPE,
            check=False,
        )
    assert done.stderr == b""


def test_no_summary_is_cut(contactlab: Run) -> None:
    """All commands fit one screen of 80 columns, each with its whole summary."""
    _, out, _ = contactlab("--help")
    lines = out.partition("Options:")[2].splitlines()
    assert not [line for line in lines if "..." in line or len(line) > 80]
    assert all(f"\n{title}:\n" in out for title in TITLES.values())


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("check robot.xml", "examine MODEL --section checks"),
        ("replay store run", "verify STORE RUN"),
        ("merge a b -o c", "sweep SHARD... --merge -o STORE"),
        ("engines add bullet", "parity --install NAME"),
        ("baseline update a b", "compare BASELINE CANDIDATE --update"),
    ],
)
def test_old_commands_name_the_new_ones(contactlab: Run, old: str, new: str) -> None:
    code, out, err = contactlab(*old.split())
    assert (code, out) == (2, "")
    assert err == f"error: '{old.split(maxsplit=1)[0]}' is now `contactlab {new}`\n"
