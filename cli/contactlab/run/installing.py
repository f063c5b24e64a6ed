"""Make a virtual environment with one version of MuJoCo, by uv or by venv and pip."""

import importlib.util
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from contactlab.errors import EngineError

_NAME = re.compile(r"[\w.-]+")
# Robots that sweeps may name; nothing else of what is optional steps a model.
_ALSO = ("mujoco-menagerie",)
_NO_SUCH = re.compile(
    r"no matching distribution found for mujoco|no version of mujoco|mujoco==\S+ has no wheels|"
    r"no wheels with a matching|mujoco==\S+ has no usable wheels",
    re.IGNORECASE,
)
_NO_NETWORK = re.compile(
    r"name resolution|dns error|connection (error|refused|reset|broken)|new connection|timed? ?out|"
    r"failed to fetch|error sending request|network (is unreachable|was disabled)|proxyerror",
    re.IGNORECASE,
)
_MOST_LINES = 6


def pins() -> list[str]:
    """Return what contactlab needs beside MuJoCo, each at the version that is installed here."""
    needed = [each for each in requires("contactlab") or () if "extra ==" not in each]
    names = [match[0] for each in needed if (match := _NAME.match(each))]
    return [f"{name}=={version(name)}" for name in names if name != "mujoco"] + [
        f"{name}=={found}" for name in _ALSO if (found := _installed(name))
    ]


def install(folder: Path, mujoco: str, others: Sequence[str]) -> None:
    """Make an environment of this Python in a folder.

    Args:
        folder: where.
        mujoco: the version of MuJoCo.
        others: further requirements.

    Raises:
        EngineError: it cannot be had.
    """
    for command in commands(folder, mujoco, others):
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode:
            raise EngineError(_failure(mujoco, done.stderr or done.stdout))


def commands(folder: Path, mujoco: str, others: Sequence[str]) -> list[list[str]]:
    """Return the commands that make the environment: with uv if there is one."""
    python = str(folder / "bin" / "python")
    # Building an old engine from its sources needs more than most machines have.
    wanted = ["--only-binary", "mujoco", f"mujoco=={mujoco}", *others]
    if uv := _uv():
        return [
            [*uv, "venv", "--quiet", "--python", sys.executable, str(folder)],
            [*uv, "pip", "install", "--quiet", "--python", python, *wanted],
        ]
    return [
        [sys.executable, "-m", "venv", str(folder)],
        [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *wanted],
    ]


def _uv() -> list[str] | None:
    if found := shutil.which("uv"):
        return [found]
    return [sys.executable, "-m", "uv"] if importlib.util.find_spec("uv") else None


def _failure(mujoco: str, told: str) -> str:
    """Return what went wrong, what to write instead, and what the installer said."""
    lines = [line for line in told.strip().splitlines() if line.strip()]
    said = "\n".join(f"  {line.rstrip()}" for line in lines[-_MOST_LINES:])
    return f"{_cause(mujoco, told)}\n{said}"


def _cause(mujoco: str, told: str) -> str:
    python = f"Python {platform.python_version()}"
    if _NO_NETWORK.search(told):
        return (
            f"cannot download MuJoCo {mujoco}: no connection to the package index; "
            "give --mujoco the path of a Python that has it"
        )
    if _NO_SUCH.search(told):
        return (
            f"there is no MuJoCo {mujoco} for {python} on this system; take another version "
            "(`pip index versions mujoco` lists them), or give --mujoco the path of a Python "
            "that has it"
        )
    return (
        f"MuJoCo {mujoco} cannot be installed for {python} beside what contactlab needs; "
        "give --mujoco the path of a Python that has it"
    )


def _installed(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
