"""Callers of a command: Python, where it is silent, or a terminal.

Through its surroundings a command prints messages, shows progress and can be interrupted. Python
receives the answer as data, and the progress on request.
"""

from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from contactlab.errors import EngineError
from contactlab.step_progress import StepCount, listening_to_steps

if TYPE_CHECKING:
    from contactlab.run.tasks import BeginCallback, FinishedRun, Stop
    from contactlab.tasks.session import Session

Progress = Callable[[int, int], None]
"""Called with the runs done and the runs in all, as they finish."""


@dataclass(frozen=True)
class Watch:
    """Watcher of runs: it counts them, and may ask them to stop."""

    # Called with the runs in all, those stored already, and the name of a pass over them.
    begin: "BeginCallback"
    advance: "Callable[[Sequence[FinishedRun]], None]"  # called with runs as they finish
    stop: "Stop | None" = None


class Surroundings:
    """Those of a call from Python: nothing is printed, and a signal is the caller's."""

    def __init__(self, progress: Progress | None = None) -> None:
        self._progress, self._counts_runs = progress, False

    def say(self, message: str) -> None:
        """Tell people a message."""

    def fork_workers(self, count: int | None) -> None:
        """Start the process that worker processes are forked from, if any are wanted."""

    def announce(self, markdown: Callable[[], str], annotations: Callable[[], str]) -> None:
        """Tell a CI job's summary and its annotations, each made when there is a job."""

    def rerun_with_mujoco(self, version: str, target: object) -> None:
        """Run the same command with another MuJoCo, and end with it."""
        del target
        raise EngineError(
            f"mujoco={version}: this process has its MuJoCo already; run it with another by "
            f"`contactlab ... --mujoco {version}`, or call it in a Python that has that one"
        )

    def watching(self) -> AbstractContextManager[Watch]:
        """Follow runs."""
        done_count = total = 0

        def begin(runs: int, stored: int, phase: str = "", /) -> None:
            del phase
            nonlocal done_count, total
            done_count, total = stored, runs
            advance(())

        def advance(finished: "Sequence[FinishedRun]") -> None:
            nonlocal done_count
            done_count += len(finished)
            if self._progress is not None:
                self._progress(done_count, total)

        self._counts_runs = True
        return nullcontext(Watch(begin, advance))

    def show_steps(self, nested: Sequence[StepCount]) -> None:
        """Follow counted work; steps between runs are not reported."""
        if self._progress is not None and not self._counts_runs:
            self._progress(round(nested[0].finished_steps), round(nested[0].total))


_PYTHON = Surroundings()
_current: ContextVar[Surroundings | None] = ContextVar("surroundings", default=None)


def surroundings() -> Surroundings:
    """Return the surroundings of the command that is being called."""
    return _current.get() or _PYTHON


@contextmanager
def within(place: Surroundings) -> Generator[None]:
    """Let commands be called from a place."""
    token = _current.set(place)
    try:
        with listening_to_steps(place.show_steps):
            yield
    finally:
        _current.reset(token)


def progress(report: Progress | None) -> AbstractContextManager[None]:
    """Let commands tell a function the runs done and the runs in all, as they finish."""
    return nullcontext() if report is None else within(Surroundings(report))


def say(message: str) -> None:
    """Tell people a message: on stderr, if the command line calls."""
    surroundings().say(message)


def rerun_with_mujoco(version: str | None, target: object) -> None:
    """Run the same command with another MuJoCo, if a version is given, and end with it.

    The version is added to the name of the target, a store, unless the user named one. An
    EngineError says that there is no such version, or that it cannot be installed.
    """
    if version is not None:
        surroundings().rerun_with_mujoco(version, target)


@contextmanager
def study_session(
    folder: Path, workers: int | None, *, allow_code: bool = False
) -> "Generator[Session]":
    """Yield a session that the surroundings follow."""
    surroundings().fork_workers(workers)
    from contactlab.run.worker_pool import worker_count
    from contactlab.tasks.session import Session

    count = worker_count(workers)
    with surroundings().watching() as watch:
        yield Session(folder, count, watch.begin, watch.advance, say, watch.stop, allow_code)
