"""What commands share that run a sweep: its file, and what an interruption says."""

import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from contactlab.commands.output import say
from contactlab.errors import SweepFileError

RESULTS = Path("results")
# As a shell reports a command that Ctrl-C ended.
_INTERRUPTED = 130

MujocoOption = Annotated[
    str | None,
    typer.Option(
        metavar="VERSION|PYTHON",
        help="Run on another MuJoCo: a version, or the path of a Python that has it.",
    ),
]


def go_elsewhere(asked: str | None, store: Path | None) -> None:
    """Go on with another MuJoCo, where one is asked for, as the same command.

    Args:
        asked: a version or the path of a Python; nothing happens for None and this version.
        store: where results go if nothing else is said; its name is followed by the version.

    Raises:
        EngineError: there is no such version, or it cannot be had.
    """
    if asked is None:
        return
    from contactlab.pipeline import find_engine, run_on, without_option

    other = find_engine(asked, say)
    if other is None:
        return
    target = ["-o", f"{store}-{other.mujoco}"] if store else []
    run_on(other, [*without_option(sys.argv[1:], "--mujoco"), *target])


@contextmanager
def resumable() -> Generator[None]:
    """Turn Ctrl-C into a word on how to go on."""
    try:
        yield
    except KeyboardInterrupt as error:
        say("interrupted; the same command goes on where it stopped")
        raise typer.Exit(_INTERRUPTED) from error


def sweep_path(name: str) -> Path:
    """Return the path of a sweep file, given by path or by shipped name.

    Raises:
        SweepFileError: there is none.
    """
    from contactlab import shipped

    path = Path(name)
    if path.suffix in {".yaml", ".yml"} or "/" in name:
        if not path.is_file():
            raise SweepFileError(f"no sweep file {path}")
        return path
    return shipped.sweep_file(name)
