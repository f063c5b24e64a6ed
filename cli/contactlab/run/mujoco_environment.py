"""Virtual environments: of another MuJoCo under this contactlab, and of other engines."""

import importlib.util
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, distribution, requires, version
from pathlib import Path
from typing import NamedTuple, NoReturn

from contactlab import resources
from contactlab.errors import EngineError
from contactlab.run.evidence_record import find_engine
from contactlab.schema.advisory import numbers_of

_VERSION = re.compile(r"\d+(\.\w+)+")
_NAME = re.compile(r"[\w.-]+")
PACKAGES = "CONTACTLAB_PACKAGES"
"""The environment variable that names the packages of the Python that ran another one instead."""
OLDEST = "3.3.4"
"""The first release of MuJoCo with specs that can drop a part; every command runs on it."""
_ROBOTS = "mujoco-menagerie"  # robots that sweeps may name; no other optional package steps a model
_UV_OF_MACHINE = (Path("/etc/uv/uv.toml"),)


class Interpreter(NamedTuple):
    """The path of a Python with the packages of contactlab, and its version of MuJoCo."""

    python: Path
    mujoco: str


def find_interpreter(request: str, notify: Callable[[str], None]) -> Interpreter | None:
    """Return a Python with another version of MuJoCo; None if this one has the right version.

    The request is a version, or the path of a Python that has one. An environment is made when it
    is needed for the first time, after a notification, and kept in the user's cache. Raises an
    EngineError if there is no such version, or it cannot be installed.
    """
    if request == find_engine().version:
        return None
    if not _VERSION.fullmatch(request):
        # An interpreter that the user names is tried.
        path = Path(request).expanduser().absolute()
        if not (path.is_file() and os.access(path, os.X_OK)):
            raise EngineError(
                f"'{request}' is neither a version of MuJoCo, such as 3.17.0, nor the path of a "
                "Python"
            )
        return Interpreter(path, _find_mujoco(path, request))
    if not numbers_of(OLDEST) <= numbers_of(request) < (5,):
        raise EngineError(
            f"contactlab runs on MuJoCo {OLDEST} and newer, below 5; not on {request}"
        )
    others = _pinned_requirements()
    name = f"mujoco-{request}-py{platform.python_version()}-{resources.short_hash(others)}"
    folder = resources.user_cache() / name
    python = folder / "bin" / "python"
    if not python.exists():
        notify(f"setting up MuJoCo {request} in {folder}, once")
        # Building an old engine from its sources needs more than most machines have.
        packages = ["--only-binary", "mujoco", f"mujoco=={request}", *others]
        name = f"MuJoCo {request}"
        advice = (
            "take another version (`pip index versions mujoco` lists them), or give --mujoco the "
            "path of a Python that has it"
        )
        make_environment(folder, packages, name, advice, lambda python: _find_mujoco(python, name))
    return Interpreter(python, request)


def exec_with(interpreter: Interpreter, arguments: Sequence[str]) -> NoReturn:
    """Become contactlab on another interpreter: exit code, signals and output are its own."""
    command = [str(interpreter.python), "-m", "contactlab", *arguments]
    variables = {**_environment_variables(), PACKAGES: sysconfig.get_path("purelib")}
    os.execve(interpreter.python, command, variables)  # noqa: S606


def without_option(arguments: Sequence[str], option: str) -> list[str]:
    """Return arguments without an option and its value."""
    other_arguments: list[str] = []
    rest = iter(arguments)
    for argument in rest:
        if argument == option:
            next(rest, None)
        elif not argument.startswith(f"{option}="):
            other_arguments.append(argument)
    return other_arguments


def install_commands(folder: Path, packages: Sequence[str]) -> list[list[str]]:
    """Return the commands that make an environment: by uv if it exists, otherwise by venv and pip.

    It gets the wanted packages, named as for pip.
    """
    python = str(folder / "bin" / "python")
    if uv := _find_uv():
        return [
            [*uv, "venv", "--quiet", "--python", sys.executable, str(folder)],
            [*uv, "pip", "install", "--quiet", "--python", python, *packages],
        ]
    return [
        [sys.executable, "-P", "-m", "venv", str(folder)],
        [python, "-P", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages],
    ]


def run_installer(command: Sequence[str], folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run uv or pip in a folder of ours, so that only the user configures them.

    The current folder may be a stranger's. A `uv.toml` or `pyproject.toml` in it or above it could
    name the package index, so that foreign code is installed.
    """
    # uv reads the user's configuration, and none of a folder.
    named_file = os.environ.get("UV_CONFIG_FILE")
    home = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    config_files = (
        [Path(named_file).absolute()]
        if named_file
        else [Path(home, "uv", "uv.toml"), *_UV_OF_MACHINE]
    )
    own = next((file for file in config_files if file.is_file()), None)
    # A file that is named is read alone; uv itself reports a missing one.
    chosen = (
        {"UV_CONFIG_FILE": str(own or config_files[0])}
        if own or named_file
        else {"UV_NO_CONFIG": "1"}
    )
    return subprocess.run(  # noqa: S603
        command,
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env={**os.environ, **chosen},
    )


def make_environment(
    folder: Path, packages: Sequence[str], name: str, advice: str, check: Callable[[Path], object]
) -> None:
    """Make an environment next to its folder, and move it there when it is complete.

    It replaces one without its Python, as after an upgrade of the system's Python. Raises an
    EngineError, with this advice, if a package cannot be installed, and the error of the check.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix="new-") as work_folder:
        new_folder = Path(work_folder) / "environment"
        for command in install_commands(new_folder, packages):
            installation = run_installer(command, Path(work_folder))
            if installation.returncode:
                output = (installation.stderr or installation.stdout).strip().splitlines()
                # Number of reported lines of a failing installer.
                lines = [line.rstrip() for line in output if line.strip()][-6:]
                raise EngineError(
                    f"{name} cannot be installed for Python {platform.python_version()}; {advice}. "
                    "The installer says:\n" + "\n".join(f"  {line}" for line in lines)
                )
        check(new_folder / "bin" / "python")
        if not (folder / "bin" / "python").exists():
            shutil.rmtree(folder, ignore_errors=True)
            new_folder.rename(folder)


def _find_mujoco(python: Path, name: str) -> str:
    """Return the version of MuJoCo that contactlab finds there."""
    code = f"import mujoco, {__name__}; print(mujoco.__version__)"
    process = subprocess.run(  # noqa: S603
        [python, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env=_environment_variables(),
    )
    if process.returncode:
        last = (process.stderr.strip().splitlines() or ["it printed nothing"])[-1]
        needs = " ".join(["mujoco", *_pinned_requirements()])
        raise EngineError(f"{name} cannot run contactlab: {last}\nit needs: {needs}")
    return process.stdout.strip()


def _pinned_requirements() -> list[str]:
    """Return the packages that contactlab needs besides MuJoCo, at their installed versions."""
    needed = [
        requirement for requirement in requires("contactlab") or () if "extra ==" not in requirement
    ]
    names = [match[0] for requirement in needed if (match := _NAME.match(requirement))]
    pinned = [f"{name}=={version(name)}" for name in names if name != "mujoco"]
    with suppress(PackageNotFoundError):
        pinned.append(f"{_ROBOTS}=={version(_ROBOTS)}")
    return pinned


def _find_uv() -> list[str] | None:
    if path := shutil.which("uv"):
        return [path]
    return [sys.executable, "-P", "-m", "uv"] if importlib.util.find_spec("uv") else None


def _environment_variables() -> dict[str, str]:
    """Return the variables of a process of another interpreter, which runs this contactlab."""
    variables = {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}
    # Nothing is imported from the current folder, which may be a stranger's.
    # Another environment must not see the other packages installed here, least of all MuJoCo. So
    # this folder has contactlab alone.
    packages = Path(resources.__file__).resolve().parent.parent
    own = distribution("contactlab")
    metadata = Path(str(own.locate_file(f"contactlab-{own.version}.dist-info"))).resolve()
    name = f"contactlab-{own.version}-{resources.short_hash([str(packages), str(metadata)])}"
    folder = resources.user_cache() / name
    folder.mkdir(parents=True, exist_ok=True)
    plugin_files = {packages / entry.module.partition(".")[0] for entry in own.entry_points}
    for target in (metadata, *plugin_files):
        # Another process may make it, too.
        with suppress(FileExistsError):
            (folder / target.name).symlink_to(target, target_is_directory=True)
    return {**variables, "PYTHONPATH": str(folder), "PYTHONSAFEPATH": "1"}
