"""Tasks, jobs, their results, and stop requests: all data that workers and sweeps exchange.

All data here can be pickled.
"""

import json
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

from contactlab.accuracy.discretization import Note
from contactlab.errors import StoppedError
from contactlab.plan.grid import Expected
from contactlab.plugins import Plugin
from contactlab.registry import registry_fillers
from contactlab.scene.drive.located_drive import LocatedDrive
from contactlab.scene.run_spec import RunSpec
from contactlab.schema.evidence import Provenance, SweepIdentity
from contactlab.schema.sweep_schema import Sweep
from contactlab.store.store_files import Address


class Stop:
    """A request to stop: runs in flight finish, and no more begin.

    It is watched while runs are in flight.
    """

    is_set = is_watched = False

    def request_stop(self) -> None:
        """Request a stop; other threads and signal handlers may call it, too."""
        self.is_set = True

    @contextmanager
    def watch_runs(self) -> Generator[None]:
        """Mark the time while runs are in flight."""
        self.is_watched = True
        try:
            yield
        finally:
            self.is_watched = False


Purpose = Literal["record", "outcomes", "errors", "work", "times"]


@dataclass(frozen=True)
class Task:
    """Data that all jobs of a sweep share; sent to a worker once."""

    sweep: Sweep
    expected: Expected
    identity: SweepIdentity
    store: Address
    scene_folder: Path  # the store's copy of the scene, on the machine that runs the sweep
    provenance: Provenance  # versions and machine that write the records
    plugins: tuple[Plugin, ...] = ()  # plug-ins that workers load before their first job
    # The policy code that acts in the runs, which the user allows; None without a policy.
    policy: LocatedDrive | None = None
    environment: Any = None  # likewise, the environment with the runs as its episodes
    # The purpose of the runs: record them, play episodes without a record, compare them with a
    # reference, or count their work. The process of the sweep itself measures times.
    purpose: Purpose = "record"
    # The pairs that were detected where the sweep began, so that no worker detects them again.
    detected: Mapping[tuple[object, ...], tuple[Any, ...]] = field(
        default_factory=dict[tuple[object, ...], tuple[Any, ...]]
    )
    # Functions that fill the registry of a worker, as they filled that of the sweep's process.
    fillers: tuple[Callable[[], None], ...] = field(default_factory=registry_fillers)


Job = tuple[RunSpec, ...]


MAX_LOSSES = 3
"""Lost nodes or tasks until a job, the first of them, is considered the cause."""


class FinishedRun(NamedTuple):
    """The row of a finished run with a stored trace; its worst label; and its status.

    The row is JSON without the fields shared with others of its job, which are separate JSON.
    """

    row: bytes
    label: str
    status: str
    expectation_met: bool | None
    shared: bytes = b""


@dataclass(frozen=True, slots=True)
class CrashedJob:
    """A job with a worker process that died, and the reason; its own watchdog may have ended it."""

    job: Job
    reason: str
    timed_out: bool


Result = list[FinishedRun] | CrashedJob


class Executor(Protocol):
    """Runs jobs on worker processes of this machine, or on a cluster."""

    @property
    def workers(self) -> int:
        """Number of jobs that run at once; 0 if they run in this process."""
        ...

    def run(self, task: Task, jobs: Iterable[Job], stop: Stop) -> Iterator[Result]:
        """Yield the results of jobs as they finish, in any order.

        Jobs are consumed lazily, as workers become idle. Once `stop` is set, no more begin; those
        in flight end, some with a part of their runs.
        """
        ...


class BeginCallback(Protocol):
    """Called as runs, or a pass over them, begin."""

    def __call__(self, total: int, done_count: int, phase: str = ..., /) -> None:
        """Take the number of runs, that of finished ones, and the name of a pass."""


# Called with finished runs.
ProgressCallback = Callable[[Sequence[FinishedRun]], None]


def results_of(task: Task, jobs: Iterable[Job], executor: Executor, stop: Stop) -> Iterator[Result]:
    """Yield the results of jobs as they finish.

    Raises a StoppedError at the end if `stop` was set.
    """
    with stop.watch_runs():
        yield from executor.run(task, jobs, stop)
    if stop.is_set:
        raise StoppedError("interrupted; run the same command again to resume")


_NOTE_LABELS: Mapping[Purpose, str] = {
    "record": "recorded",
    "outcomes": "played",
    "errors": "compared with references",
    "work": "counted",
    "times": "timed",
}


def note_result(purpose: Purpose, run_id: str, result: Note) -> FinishedRun:
    """Return a pass's result for a run, in the form that a worker returns."""
    row = json.dumps({"pass": purpose, "run_id": run_id, "found": result}).encode()
    return FinishedRun(row=row, label=_NOTE_LABELS[purpose], status="ok", expectation_met=None)


def notes_by_run(notes: Iterable[Note], purpose: Purpose) -> dict[str, Note]:
    """Return the results of a pass, by run id."""
    return {entry["run_id"]: entry["found"] for entry in notes if entry.get("pass") == purpose}
