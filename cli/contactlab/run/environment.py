"""Run contactlab on another version of MuJoCo: this very code, in an environment of its own."""

import hashlib
import os
import platform
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from importlib.metadata import distribution
from pathlib import Path
from typing import NamedTuple, NoReturn

import contactlab
from contactlab.errors import EngineError
from contactlab.run.installing import install, pins
from contactlab.run.provenance import engine

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


def run_on(other: Interpreter, arguments: Sequence[str]) -> NoReturn:
    """Go on as contactlab on another engine; this process becomes the other one.

    So exit codes, signals and all output are the other's own.

    Args:
        other: what has the engine.
        arguments: of contactlab.
    """
    command = [str(other.python), "-c", _MAIN, *arguments]
    os.execve(other.python, command, _surroundings(_linked()))  # noqa: S606


def find_engine(asked: str, tell: Callable[[str], None]) -> Interpreter | None:
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
