"""One task of an array: runs jobs on worker processes of its node, and writes results to a folder.

The folder is on a file system that all nodes share. A result is a file in it, renamed into its
place when it is complete, so that finished results outlive the task.
"""

import pickle
import threading
import uuid
from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from pydantic_core import from_json
from submitit.helpers import DelayedSubmission

from contactlab.errors import ClusterError, ContactlabError
from contactlab.run.task_bundle import unpack_bundle
from contactlab.run.tasks import CrashedJob, Job, Result, Stop
from contactlab.run.worker_pool import LocalPool
from contactlab.store.atomic_files import write_file
from contactlab.temporary_folders import temporary_folder

BUNDLE, STOP = "task.bundle", "stop"
RESULT = ".result"
_STOP_INTERVAL = 1.0  # longest delay until a request to stop is noticed [s]


@dataclass(frozen=True)
class Part:
    """Some jobs of a sweep, which one task of an array runs; a requeued task begins again."""

    folder: Path
    jobs: tuple[Job, ...]
    workers: int
    versions: Mapping[str, str]

    def __call__(self) -> ContactlabError | None:
        """Run the jobs without a result; return the error that should end the sweep."""
        try:
            for name, ours in self.versions.items():
                if (theirs := version(name)) != ours:
                    raise ClusterError(
                        f"a node has {name} {theirs}, but the sweep was started with {ours}; "
                        "install the same versions on every node"
                    )
            with temporary_folder() as own, self._watch_stop_file() as stop:
                task = unpack_bundle((self.folder / BUNDLE).read_bytes(), Path(own))
                remaining_jobs = unfinished_jobs(self.jobs, stored_runs(self.folder))
                for result in LocalPool(self.workers).run(task, remaining_jobs, stop):
                    name = f"{self.folder}/{uuid.uuid4().hex}{RESULT}"
                    write_file(name, pickle.dumps(result))
        except ContactlabError as error:
            return error
        return None

    def checkpoint(self) -> DelayedSubmission:
        """Return the continuation of this task after a preemption or its time limit."""
        return DelayedSubmission(self)

    @contextmanager
    def _watch_stop_file(self) -> Generator[Stop]:
        """Yield a stop that is set once the sweep asks its tasks to stop."""
        stop, ended = Stop(), threading.Event()

        def watch() -> None:
            while not ended.wait(_STOP_INTERVAL):
                if (self.folder / STOP).exists():
                    stop.request_stop()

        thread = threading.Thread(target=watch, daemon=True)
        thread.start()
        try:
            yield stop
        finally:
            ended.set()
            thread.join()


def runs_of(result: Result) -> Iterator[str]:
    """Yield the ids of the runs in a result."""
    if isinstance(result, CrashedJob):
        yield from (run.run_id for run in result.job)
    else:
        yield from (from_json(finished.row)["run_id"] for finished in result)


def unfinished_jobs(jobs: tuple[Job, ...], finished_ids: set[str]) -> tuple[Job, ...]:
    """Return the jobs with runs without a result, reduced to these runs."""
    remaining_jobs = (tuple(run for run in job if run.run_id not in finished_ids) for job in jobs)
    return tuple(filter(None, remaining_jobs))


def stored_runs(folder: Path) -> set[str]:
    """Return the ids of the runs that have a result in a folder."""
    files = folder.glob(f"*{RESULT}")
    # Our own; the folder is made for one sweep, and readable by its user alone.
    results: Iterator[Result] = (pickle.loads(file.read_bytes()) for file in files)  # noqa: S301
    return {run for result in results for run in runs_of(result)}
