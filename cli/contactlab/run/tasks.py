"""Tasks and jobs, what comes of them, and how to stop: all that workers and sweeps exchange.

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
from contactlab.plan.grid import Match
from contactlab.plugins import Plugin
from contactlab.registry import registry_fillers
from contactlab.scene.drive.located_drive import LocatedDrive
from contactlab.scene.run_spec import RunSpec
from contactlab.schema.evidence import Provenance, SweepIdentity
from contactlab.schema.sweep_schema import Expectation, Sweep
from contactlab.store.store_files import Address


class Stop:
    """A request to stop: runs in flight end by themselves, and no more begin.

    It is watched while runs are in flight.
    """

    is_set = is_watched = False

    def set(self) -> None:
        """Request to stop, from another thread or a signal handler too."""
        self.is_set = True

    @contextmanager
    def watched(self) -> Generator[None]:
        """Mark the time in which runs are in flight."""
        self.is_watched = True
        try:
            yield
        finally:
            self.is_watched = False


Purpose = Literal["record", "errors", "work", "times"]


@dataclass(frozen=True)
class Task:
    """Data that all jobs of a sweep share; sent to a worker once."""

    sweep: Sweep
    # Conditions, each with what is expected of the runs that it selects.
    expected: tuple[tuple[Match, Expectation], ...]
    identity: SweepIdentity
    store: Address
    scene_folder: Path  # the store's copy of the scene, on the machine that runs the sweep
    provenance: Provenance  # versions and machine that write the records
    plugins: tuple[Plugin, ...] = ()  # what workers load before their first job
    # The code that acts in the runs, which the user allows; None without.
    policy: LocatedDrive | None = None
    environment: Any = None  # likewise, where it has the runs as its episodes
    # What is done with the runs: they are recorded, compared with a reference, or their work is
    # counted; times are taken by the process of the sweep itself.
    purpose: Purpose = "record"
    # Functions that fill the registry of a worker, as they filled that of the sweep's process.
    fillers: tuple[Callable[[], None], ...] = field(default_factory=registry_fillers)


Job = tuple[RunSpec, ...]


class Finished(NamedTuple):
    """The row of a finished run, whose trace is stored; its worst label; how it ended.

    The row is JSON, without what it shares with others of its job: that is JSON of its own.
    """

    row: bytes
    label: str
    status: str
    expectation_met: bool | None
    shared: bytes = b""


@dataclass(frozen=True, slots=True)
class Crashed:
    """A job whose worker process died, and how; its own watchdog may have ended it."""

    job: Job
    reason: str
    timed_out: bool


Result = list[Finished] | Crashed


class Executor(Protocol):
    """Where jobs are run: this machine's worker processes, or a cluster."""

    @property
    def workers(self) -> int:
        """How many jobs run at once; 0 if they run in this process."""
        ...

    def run(self, task: Task, jobs: Iterable[Job], stop: Stop) -> Iterator[Result]:
        """Yield the results of jobs as they come, in any order.

        Jobs are taken lazily, as workers become idle. Once `stop` is set, no more begin; those in
        flight end, some with a part of their runs.
        """
        ...


# Called with the number of runs and how many of them are done already; then with finished runs.
BeginCallback = Callable[[int, int], None]
ProgressCallback = Callable[[Sequence[Finished]], None]


def results_of(task: Task, jobs: Iterable[Job], executor: Executor, stop: Stop) -> Iterator[Result]:
    """Yield the results of jobs as they come; then raise StoppedError if `stop` was set."""
    with stop.watched():
        yield from executor.run(task, jobs, stop)
    if stop.is_set:
        raise StoppedError("interrupted; run the same command again to resume")


_NOTE_LABELS: Mapping[Purpose, str] = {
    "record": "recorded",
    "errors": "held against references",
    "work": "counted",
    "times": "timed",
}


def note(purpose: Purpose, run_id: str, result: Note) -> Finished:
    """Return what a pass found of a run, as a worker returns it."""
    row = json.dumps({"pass": purpose, "run_id": run_id, "found": result}).encode()
    return Finished(row=row, label=_NOTE_LABELS[purpose], status="ok", expectation_met=None)


def noted(notes: Iterable[Note], purpose: Purpose) -> dict[str, Note]:
    """Return what a pass found, by run id."""
    return {entry["run_id"]: entry["found"] for entry in notes if entry.get("pass") == purpose}
