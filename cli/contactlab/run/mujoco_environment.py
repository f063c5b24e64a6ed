"""Run contactlab on another version of MuJoCo: this very code, in an environment of its own."""

import hashlib
import importlib.util
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, distribution, requires, version
from pathlib import Path
from typing import NamedTuple, NoReturn

import contactlab
from contactlab.errors import EngineError
from contactlab.run.evidence_record import engine

_VERSION = re.compile(r"\d+(\.\w+)+")
_OLDEST, _TOO_NEW = (3, 3), (5,)
_MAIN = "from contactlab.commands.main import main; main()"
_PROBE = "import mujoco, contactlab.run, contactlab.commands.main; print(mujoco.__version__)"


class Interpreter(NamedTuple):
    """A Python that has another engine and all that contactlab needs.

    Attributes:
        python: its path.
        mujoco: the engine's version.
    """

    python: Path
    mujoco: str


def exec_with(other: Interpreter, arguments: Sequence[str]) -> NoReturn:
    """Go on as contactlab on another engine; this process becomes the other one.

    So exit codes, signals and all output are the other's own.

    Args:
        other: what has the engine.
        arguments: of contactlab.
    """
    command = [str(other.python), "-c", _MAIN, *arguments]
    os.execve(other.python, command, _surroundings(_linked()))  # noqa: S606


def find_interpreter(asked: str, tell: Callable[[str], None]) -> Interpreter | None:
    """Return a Python that has another engine; None if this process has what is asked for.

    Args:
        asked: a version of MuJoCo, or the path of a Python that has one.
        tell: told of what takes time.

    Raises:
        EngineError: there is no such version, or it cannot be had.
    """
    if asked == engine().version:
        return None
    if not _VERSION.fullmatch(asked):
        return _given(asked)
    numbers = tuple(int(part) for part in asked.split(".") if part.isdigit())
    if not _OLDEST <= numbers < _TOO_NEW:
        raise EngineError(f"contactlab runs on MuJoCo 3.3.0 and newer, below 5; not on {asked}")
    others = pins()
    folder = _cache() / f"mujoco-{asked}-py{platform.python_version()}-{_short(others)}"
    if not folder.is_dir():
        tell(f"setting up MuJoCo {asked} in {folder}, once")
        _make(folder, asked, others)
    return Interpreter(folder / "bin" / "python", asked)


def without_option(arguments: Sequence[str], option: str) -> list[str]:
    """Return arguments without an option and its value."""
    left: list[str] = []
    rest = iter(arguments)
    for argument in rest:
        if argument == option:
            next(rest, None)
        elif not argument.startswith(f"{option}="):
            left.append(argument)
    return left


def _given(asked: str) -> Interpreter:
    """Return an interpreter that the user names, after trying it."""
    python = Path(asked).expanduser().absolute()
    if not (python.is_file() and os.access(python, os.X_OK)):
        raise EngineError(
            f"'{asked}' is neither a version of MuJoCo, such as 3.17.0, nor the path of a Python"
        )
    return Interpreter(python, _try(python, asked))


def _make(folder: Path, mujoco: str, others: Sequence[str]) -> None:
    """Make an environment beside where it goes, and move it there when it is whole."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix="new-") as beside:
        made = Path(beside) / "environment"
        install(made, mujoco, others)
        _try(made / "bin" / "python", f"MuJoCo {mujoco}")
        if not folder.exists():
            made.rename(folder)


def _try(python: Path, name: str) -> str:
    """Return the version of the engine that contactlab finds there."""
    done = subprocess.run(  # noqa: S603
        [python, "-c", _PROBE],
        capture_output=True,
        text=True,
        check=False,
        env=_surroundings(_linked()),
    )
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
        needs = " ".join(["mujoco", *pins()])
        raise EngineError(f"{name} cannot run contactlab: {said}\nit needs: {needs}")
    return done.stdout.strip()


def _linked() -> Path:
    """Return a folder that holds this contactlab, and nothing else that could be imported.

    Another environment must not see what is installed here beside it, least of all MuJoCo.
    """
    package = Path(contactlab.__file__).resolve().parent
    own = distribution("contactlab")
    described = Path(str(own.locate_file(f"contactlab-{own.version}.dist-info"))).resolve()
    folder = _cache() / f"contactlab-{own.version}-{_short([str(package), str(described)])}"
    folder.mkdir(parents=True, exist_ok=True)
    for target, name in ((package, "contactlab"), (described, described.name)):
        link = folder / name
        if not link.exists():
            _replace_link(link, target)
    return folder


def _replace_link(link: Path, target: Path) -> None:
    """Make a link in one step, so that another process that makes it too does no harm."""
    beside = Path(tempfile.mkdtemp(dir=link.parent, prefix="new-"))
    (beside / "link").symlink_to(target, target_is_directory=True)
    (beside / "link").replace(link)
    shutil.rmtree(beside)


def _surroundings(folder: Path) -> dict[str, str]:
    """Return the environment variables of the other process."""
    kept = {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}
    return {**kept, "PYTHONPATH": str(folder)}


def _cache() -> Path:
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "contactlab"


def _short(parts: Sequence[str]) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:12]


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
