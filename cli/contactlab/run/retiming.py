"""Times stored runs again, in processes that `contactlab compare --remeasure` talks to.

Each line of such a process's input requests a run: {"run": id, "repeats": n}. Each line of its
output answers: {"seconds": CPU time, "steps": made}, or {"error": why not}. The first line names
the engine.
"""

import gc
import json
import subprocess
import sys
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any, NamedTuple

from contactlab.engines import ENGINES, Segments, TimesSteps, engine_of
from contactlab.errors import ContactlabError, PolicyError, StoreError
from contactlab.run.stored_runs import stored_run
from contactlab.scene import (
    MODEL_ENGINE,
    compile_without_sensors,
    prepare_without_sensors,
    silence_mujoco,
)
from contactlab.store import Store

MAX_STEPS = 2_000
"""Steps that are timed from each of the places along a run."""
_END_TIMEOUT = 10.0
"""How long a process may take to end once its input is closed [s]."""


def answers(store: Store, lines: Iterator[str]) -> Iterator[dict[str, Any]]:
    """Yield engine and version, then an answer to each line."""
    engine = ENGINES[MODEL_ENGINE]
    yield {
        "engine": f"{engine.name} {engine.version}",
        "timed_engines": [each.name for each in ENGINES.values() if isinstance(each, TimesSteps)],
        "contactlab": version("contactlab"),
    }
    prepared: dict[str, TimedRun] = {}
    for line in lines:
        request = json.loads(line)
        try:
            run = str(request["run"])
            if run not in prepared:
                # One at a time: two processes time the same run, interleaved.
                prepared = {run: timed_run(store, run)}
            timed, repeats = prepared[run], int(request["repeats"])
            seconds, steps = timed.engine.time_segments(timed.segments, MAX_STEPS, repeats)
            yield {"seconds": seconds, "steps": steps}
        except ContactlabError as error:
            yield {"error": str(error)}


class TimedRun(NamedTuple):
    """A stored run, ready to be timed: the segments of it, and the engine that steps them."""

    engine: TimesSteps
    segments: Segments


def timed_run(store: Store, run: str) -> TimedRun:
    """Return a stored run, ready to be timed.

    Raises:
        ContactlabError: there is no such run, its engine cannot time it, or it does not complete.
    """
    _, scene, resolved = stored_run(store, run)
    engine = engine_of(resolved)
    if not isinstance(engine, TimesSteps):
        raise ContactlabError(f"run {run}: the {resolved.engine} engine does not time its steps")
    start = scene.starts([resolved])
    model = prepare_without_sensors(
        scene, resolved, start, compile_without_sensors(scene, resolved)
    )
    work = engine.count_work(model, start, resolved.steps)
    if work is None:
        raise ContactlabError(f"run {run} does not complete")
    return TimedRun(engine, Segments(model, start, work.places, work.states, work.steps))


def main() -> None:
    """Answer until the input ends."""
    silence_mujoco()
    gc.disable()
    try:
        for answer in answers(Store.open(Path(sys.argv[1])), iter(sys.stdin.readline, "")):
            sys.stdout.write(json.dumps(answer) + "\n")
            sys.stdout.flush()
    except ContactlabError as error:
        raise SystemExit(f"error: {error}") from error


class TimingProcess:
    """Times runs; made by `timing_process`.

    Attributes:
        engine: the MuJoCo that steps its runs, with its version.
        timed_engines: names of the engines whose runs it can time.
    """

    def __init__(self, python: Path, requests: IO[str], answers: IO[str]) -> None:
        self._python = python
        self._requests = requests
        self._answers = answers
        greeting = self._answer()
        self.engine = str(greeting["engine"])
        # Older versions time their own engine alone.
        own = [self.engine.partition(" ")[0]]
        self.timed_engines = frozenset(map(str, greeting.get("timed_engines", own)))

    def time(self, run: str, repeats: int) -> tuple[float, float]:
        """Return the CPU time of all steps that were made of a run, and of one of them [s].

        Raises:
            StoreError: the run cannot be timed.
        """
        with suppress(BrokenPipeError):
            self._requests.write(json.dumps({"run": run, "repeats": repeats}) + "\n")
            self._requests.flush()
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
def timing_process(python: Path, store: Path) -> Generator[TimingProcess]:
    """Yield a process that times the runs of a store; it ends with the context.

    Raises:
        PolicyError: the interpreter cannot time runs.
    """
    command = [str(python), "-c", f"from {__name__} import main; main()", str(store)]
    try:
        process = subprocess.Popen(  # noqa: S603 - the user's own Python
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
    except OSError as error:
        raise PolicyError(f"cannot run {python}: {error.strerror}") from error
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield TimingProcess(python, process.stdin, process.stdout)
    finally:
        _end(process, process.stdin, process.stdout)


def _end(process: subprocess.Popen[str], requests: IO[str], answers: IO[str]) -> None:
    with suppress(BrokenPipeError):
        requests.close()
    try:
        process.wait(_END_TIMEOUT)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    answers.close()
