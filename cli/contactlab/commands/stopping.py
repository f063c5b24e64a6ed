"""Signals that end a sweep: the first lets the runs in flight end, the second does not wait."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands.terminal import say
from contactlab.errors import StoppedError, SweepFileError

if TYPE_CHECKING:
    from contactlab.run import Stop

_WISHES = (signal.SIGINT, signal.SIGTERM)
_SAID = "finishing the runs in flight; again to stop at once\n"

Handler = Callable[[int, FrameType | None], None]


@contextmanager
def stop_on_signals(stop: "Stop") -> Generator[None]:
    """Turn Ctrl-C and SIGTERM into a wish to stop, where runs are under way that heed it.

    Elsewhere, and the second time, they raise KeyboardInterrupt. A signal that is ignored, as
    Ctrl-C is by what a shell runs in the background, stays so; only a main thread hears any.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _WISHES}
    heard = [number for number, handler in before.items() if handler is not signal.SIG_IGN]
    for number in heard:
        signal.signal(number, _handler(stop))
    try:
        yield
    finally:
        for number in heard:
            signal.signal(number, before[number])


def _handler(stop: "Stop") -> Handler:
    def handle(number: int, frame: FrameType | None) -> None:
        del number, frame
        again = stop.is_set or not stop.is_heeded
        # Where an exception gets lost, as in a finalizer, the wish stays.
        stop.set()
        if again:
            raise KeyboardInterrupt
        _say()

    return handle


def _say() -> None:
    """Say that the first signal was heard, past all buffers, in which it may have come."""
    # On a terminal the cursor stands behind the live display.
    begin = "\n" if os.isatty(2) else ""
    with contextlib.suppress(OSError):
        os.write(2, (begin + _SAID).encode())


RESULTS = Path("results")
GOES_ON, AGAIN = "goes on where it stopped", "starts anew"

MujocoOption = Annotated[
    str | None,
    typer.Option(
        metavar="VERSION|PYTHON",
        help="Run on another MuJoCo: a version, or the path of a Python that has it.",
    ),
]


def rerun_with_mujoco(asked: str | None, store: Path | None) -> None:
    """Go on with another MuJoCo, where one is asked for, as the same command.

    Args:
        asked: a version or the path of a Python; nothing happens for None and this version.
        store: where results go if nothing else is said; its name is followed by the version.

    Raises:
        EngineError: there is no such version, or it cannot be had.
    """
    if asked is None:
        return
    from contactlab.run import exec_with, find_interpreter, without_option

    other = find_interpreter(asked, say)
    if other is None:
        return
    target = ["-o", f"{store}-{other.mujoco}"] if store else []
    exec_with(other, [*without_option(sys.argv[1:], "--mujoco"), *target])


@contextmanager
def resumable(then: str = GOES_ON) -> Generator["Stop"]:
    """Yield what Ctrl-C and SIGTERM set, and turn an early end into a word on how to go on.

    Args:
        then: what the same command does.
    """
    from contactlab.run import Stop

    stop = Stop()
    try:
        with stop_on_signals(stop):
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
