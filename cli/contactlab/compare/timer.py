"""A process of some Python that times runs of a store, one on command."""

import json
import subprocess
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from contactlab.errors import PolicyError, StoreError

_MODULE = "contactlab.run.remeasuring"
_PATIENCE = 10.0
"""How long a process may take to end when it is told to [s]."""


class Timer:
    """Times runs; made by `timing`.

    Attributes:
        engine: the engine that steps the runs, with its version.
    """

    def __init__(self, python: Path, asks: IO[str], answers: IO[str]) -> None:
        self._python = python
        self._asks = asks
        self._answers = answers
        self.engine = str(self._answer()["engine"])

    def time(self, run: str, repeats: int) -> tuple[float, float]:
        """Return the CPU time of all steps that were made of a run, and of one of them [s].

        Raises:
            StoreError: the run cannot be timed.
        """
        with suppress(BrokenPipeError):
            self._asks.write(json.dumps({"run": run, "repeats": repeats}) + "\n")
            self._asks.flush()
        answer = self._answer()
        if "error" in answer:
            raise StoreError(f"{self._python} cannot time run {run}: {answer['error']}")
        seconds = float(answer["seconds"])
        return seconds, seconds / int(answer["steps"])

    def _answer(self) -> dict[str, Any]:
        try:
            return dict(json.loads(self._answers.readline()))
        except ValueError as error:
            raise PolicyError(
                f"{self._python} does not time runs: is this version of contactlab installed there?"
            ) from error


@contextmanager
def timing(python: Path, store: Path) -> Generator[Timer]:
    """Yield a process that times the runs of a store; it ends with the context.

    Raises:
        PolicyError: the interpreter cannot time runs.
    """
    command = [str(python), "-m", _MODULE, str(store)]
    try:
        process = subprocess.Popen(  # noqa: S603 - the user's own Python
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
    except OSError as error:
        raise PolicyError(f"cannot run {python}: {error.strerror}") from error
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield Timer(python, process.stdin, process.stdout)
    finally:
        _end(process, process.stdin, process.stdout)


def _end(process: subprocess.Popen[str], asks: IO[str], answers: IO[str]) -> None:
    with suppress(BrokenPipeError):
        asks.close()
    try:
        process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    answers.close()
