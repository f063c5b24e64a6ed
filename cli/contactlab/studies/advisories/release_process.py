"""A process that computes windows of models under another release than the installed one.

It imports that release of MuJoCo, and answers pickled messages.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import IO, Self, cast

import mujoco

from contactlab.errors import EngineError
from contactlab.studies.advisories.release_windows import (
    State,
    Windows,
    evaluate_windows,
    record_states,
)
from contactlab.studies.lock.versions import variables_of_release


class ReleaseProcess:
    """A process that computes windows under a release of MuJoCo, until it is closed."""

    def __init__(self, release: str, notify: Callable[[str], None]) -> None:
        self.release = release
        self._variables = variables_of_release(release, notify)
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        """Return the process."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End it."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()  # it closes the pipes

    def evaluate_model(self, text: str, states: Sequence[State]) -> Windows:
        """Return the windows of a model from states.

        Raises:
            EngineError: the release refuses the model, or the process ended.
        """
        return cast("Windows", self._ask_process(("evaluate", text, states)))

    def record_model(self, text: str, start: State, steps: Sequence[int]) -> list[State]:
        """Return states of a model; see `record_states`."""
        return cast("list[State]", self._ask_process(("record", text, start, steps)))

    def _ask_process(self, message: tuple[object, ...]) -> object:
        if self._process is None or self._process.poll() is not None:
            self._process = subprocess.Popen(  # noqa: S603
                [sys.executable, "-P", "-m", __name__],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=self._variables,
            )
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            pickle.dump(message, process.stdin)
            process.stdin.flush()
            answer = pickle.load(process.stdout)  # noqa: S301 - a process of this program
        except (EOFError, BrokenPipeError, pickle.UnpicklingError) as error:
            process.kill()
            raise EngineError(f"MuJoCo {self.release} ended the process") from error
        if isinstance(answer, EngineError):
            raise answer
        return answer


def _serve_requests(requests: IO[bytes], answers: IO[bytes]) -> None:
    while True:
        try:
            name, *arguments = pickle.load(requests)  # noqa: S301 - the parent process
        except EOFError:
            return
        try:
            answer = (evaluate_windows if name == "evaluate" else record_states)(*arguments)
        except (EngineError, mujoco.FatalError, ValueError) as error:
            answer = EngineError(str(error))
        pickle.dump(answer, answers)
        answers.flush()


if __name__ == "__main__":
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries must not mix with the answers
    _serve_requests(sys.stdin.buffer, answers)
