"""What goes to a worker and what comes back; all of it pickles."""

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import Pipe
from pathlib import Path
from typing import Literal, Protocol

from contactlab.errors import StoppedError
from contactlab.plan import Match
from contactlab.schema import Engine, Expectation, Provenance, Sweep
from contactlab.store import Address


class Stop:
    """Set once, from a signal handler or another thread; then runs in flight end and no more begin.

    It can be waited for beside pipes, since it has a `fileno`.
    """

    def __init__(self) -> None:
        self._reader, self._writer = Pipe(duplex=False)
        self._wished = self._heeded = False

    @property
    def is_set(self) -> bool:
        """Whether to stop."""
        return self._wished

    @property
    def is_heeded(self) -> bool:
        """Whether runs are under way that end by themselves once it is set."""
        return self._heeded

    def set(self) -> None:
        """Wish to stop; safe in a signal handler."""
        if not self._wished:
            self._wished = True
            self._writer.send_bytes(b"stop")

    @contextmanager
    def heeded(self) -> Generator[None]:
        """Say that it is looked at for as long as this lasts."""
        self._heeded = True
        try:
            yield
        finally:
            self._heeded = False

    def fileno(self) -> int:
        """Return what becomes readable when it is set."""
        return self._reader.fileno()


Purpose = Literal["record", "errors", "work", "times"]


@dataclass(frozen=True)
class Task:
    """What all jobs of a sweep have in common; sent to a worker once.

    Attributes:
        sweep: the sweep file.
        expected: conditions, with what is expected of the runs that each picks.
        name: the sweep's name.
        runs: how many runs there are in all.
        store: where the store is.
        scene: the scene's name.
        scene_folder: the store's copy of the scene, on the machine that runs the sweep.
        scene_model: the model file, relative to it.
        engine: what computes.
        provenance: what writes.
        purpose: what is done with the runs: recorded, held against a reference, or counted;
            times are taken where the sweep itself runs.
    """

    sweep: Sweep
    expected: tuple[tuple[Match, Expectation], ...]
    name: str
    runs: int
    store: Address
    scene: str
    scene_folder: Path
    scene_model: str
    engine: Engine
    provenance: Provenance
    purpose: Purpose = "record"


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """One run of a plan.

    Attributes:
        index: its place in the plan.
        run_id: its identity.
        values: canonical axis values by name.
        seed: what perturbs its start.
    """

    index: int
    run_id: str
    values: Mapping[str, object]
    seed: int


# The engine of our own, beside MuJoCo.
IMPULSE = "impulse"
Job = tuple[PlannedRun, ...]


@dataclass(frozen=True, slots=True)
class Finished:
    """A run that is done; its trace, if one is kept, is in the store.

    Attributes:
        row: its journal line.
        label: its worst label.
        status: whether it went through.
        expectation_met: whether what was expected came out; None if nothing was.
    """

    row: bytes
    label: str
    status: str
    expectation_met: bool | None


@dataclass(frozen=True, slots=True)
class Crashed:
    """A job whose worker died.

    Attributes:
        job: its runs.
        reason: how the worker died.
        timed_out: whether its own watchdog ended it.
    """

    job: Job
    reason: str
    timed_out: bool


Result = list[Finished] | Crashed


class Executor(Protocol):
    """Where jobs are run: this machine's worker processes, or a cluster."""

    @property
    def workers(self) -> int:
        """How many jobs run at once; 0 if each is run by who asks for it."""
        ...

    def run(self, task: Task, jobs: Iterable[Job], stop: Stop) -> Iterator[Result]:
        """Yield the results of jobs as they come, in any order.

        Args:
            task: what the jobs have in common.
            jobs: taken lazily, as workers become idle.
            stop: once it is set, no more jobs begin; those in flight end, some with a part of
                their runs.
        """
        ...


# Told how many runs there are and how many of them are done already; then of runs as they finish.
BeginCallback = Callable[[int, int], None]
ProgressCallback = Callable[[Sequence[Finished]], None]


def results_of(task: Task, jobs: Iterable[Job], executor: Executor, stop: Stop) -> Iterator[Result]:
    """Yield the results of jobs as they come.

    Raises:
        StoppedError: the sweep was wished to stop; what was in flight then has been yielded.
    """
    with stop.heeded():
        yield from executor.run(task, jobs, stop)
    if stop.is_set:
        raise StoppedError("interrupted; the same command goes on where it stopped")
