"""What commands share that run a sweep: its file, and what an interruption says."""

import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands.output import say
from contactlab.commands.stopping import obeying
from contactlab.errors import StoppedError, SweepFileError

if TYPE_CHECKING:
    from contactlab.run import Stop

RESULTS = Path("results")
GOES_ON, AGAIN = "goes on where it stopped", "starts anew"

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
    from contactlab.run import find_engine, run_on, without_option

    other = find_engine(asked, say)
    if other is None:
        return
    target = ["-o", f"{store}-{other.mujoco}"] if store else []
    run_on(other, [*without_option(sys.argv[1:], "--mujoco"), *target])


@contextmanager
def resumable(then: str = GOES_ON) -> Generator["Stop"]:
    """Yield what Ctrl-C and SIGTERM set, and turn an early end into a word on how to go on.

    Args:
        then: what the same command does.
    """
    from contactlab.run import Stop

    stop = Stop()
    try:
        with obeying(stop):
            yield stop
    except (KeyboardInterrupt, StoppedError) as error:
        say(f"interrupted; the same command {then}")
        raise typer.Exit(StoppedError.exit_code) from error


def sweep_path(name: str) -> Path:
    """Return the path of a sweep file, given by path or by shipped name.

    Raises:
        SweepFileError: there is none.
    """
    from contactlab import resources

    path = Path(name)
    if path.suffix in {".yaml", ".yml"} or "/" in name:
        if not path.is_file():
            raise SweepFileError(f"no sweep file {path}")
        return path
    return resources.sweep_file(name)
