"""Runs jobs as tasks of arrays that submitit submits; each counts once, even after failures."""

import os
import pickle
import shutil
import time
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import islice, takewhile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import submitit
from submitit.core.utils import FailedJobError, UncompletedJobError

from contactlab.run.slurm.part import BUNDLE, RESULT, STOP, Part, runs_of, unfinished_jobs
from contactlab.run.task_bundle import pack_bundle
from contactlab.run.tasks import MAX_LOSSES, CrashedJob, Job, Result, Stop, Task
from contactlab.temporary_folders import make_locked_folder

_POLL_SECONDS = 0.5  # between two checks for results [s]
_SAFE_PATH_VARIABLE = "PYTHONSAFEPATH"


@dataclass(frozen=True)
class SlurmExecutor:
    """Arrays of tasks, with a number of CPUs per task; submitit interprets the other parameters."""

    tasks: int
    cpus: int
    cluster: str
    parameters: dict[str, int | str]

    @property
    def workers(self) -> int:
        """Number of jobs that run at a time."""
        return self.tasks * self.cpus

    def run(self, task: Task, jobs: Iterable[Job], stop: Stop) -> Iterator[Result]:
        """Yield the results of jobs when they are ready; see `Executor`."""
        parent = task.store.absolute().parent if isinstance(task.store, Path) else Path.cwd()
        # Nodes may not see each other's locks, but tasks change the folder within a week.
        week = 7 * 86_400.0
        folder = make_locked_folder(parent, ".contactlab-slurm-", least_age=week)
        (folder / BUNDLE).write_bytes(pack_bundle(task))
        engine = task.identity.engine
        versions = {"contactlab": version("contactlab"), engine.name: engine.version}
        arrays = Arrays(self, folder, versions, takewhile(lambda _: not stop.is_set, jobs), stop)
        try:
            yield from arrays.iterate_results()
        finally:
            arrays.cancel_tasks()
            shutil.rmtree(folder, ignore_errors=True)

    def submit_parts(self, folder: Path, parts: Sequence[Part]) -> list[Any]:
        """Submit parts as the tasks of one array."""
        executor = self._create_submitter(folder)
        with _without_current_folder(), executor.batch():
            return [executor.submit(part) for part in parts]

    def check_parameters(self) -> None:
        """Raise submitit's own error if it knows no such parameters."""
        with TemporaryDirectory() as folder:
            self._create_submitter(Path(folder))

    def _create_submitter(self, folder: Path) -> submitit.AutoExecutor:
        executor = submitit.AutoExecutor(folder / "logs", self.cluster)
        executor.update_parameters(name="contactlab", cpus_per_task=self.cpus, **self.parameters)
        return executor


@contextmanager
def _without_current_folder() -> Generator[None]:
    """Keep Python from importing modules of a task's folder, which may be a stranger's."""
    before = os.environ.get(_SAFE_PATH_VARIABLE)
    os.environ[_SAFE_PATH_VARIABLE] = "1"
    try:
        yield
    finally:
        os.environ.pop(_SAFE_PATH_VARIABLE)
        if before is not None:
            os.environ[_SAFE_PATH_VARIABLE] = before


@dataclass
class Arrays:
    """The submitted tasks, the jobs of each that have no result yet, and their losses."""

    executor: SlurmExecutor
    folder: Path
    versions: dict[str, str]
    queue: Iterator[Job]
    stop: Stop
    _active: dict[Any, tuple[tuple[Job, ...], int]] = field(
        default_factory=dict[Any, tuple[tuple[Job, ...], int]]
    )

    def iterate_results(self) -> Iterator[Result]:
        """Yield the result of every job, once."""
        while self._submit_jobs():
            ended = [task for task in self._active if task.done()]
            yield from self._collect_results()
            for task in ended:
                lost = self._end_task(task)
                if lost is not None:
                    yield lost
            if not ended:
                time.sleep(_POLL_SECONDS)

    def cancel_tasks(self) -> None:
        """End all tasks."""
        for task in self._active:
            task.cancel()
        self._active.clear()

    def _submit_jobs(self) -> bool:
        """Submit jobs to the free tasks, or none; return whether any task is active."""
        if self.stop.is_set:
            (self.folder / STOP).touch()
            for task in self._active:
                if task.state == "PENDING":
                    task.cancel()
        elif free := self.executor.tasks - len(self._active):
            # Most jobs of a task at a time; a job has up to 32 runs, or 512 short ones.
            jobs = list(islice(self.queue, free * 256))
            self._submit_parts([tuple(jobs[place::free]) for place in range(free)], 0)
        return bool(self._active)

    def _submit_parts(self, several: Iterable[tuple[Job, ...]], losses: int) -> None:
        parts = [
            Part(self.folder, jobs, self.executor.cpus, self.versions) for jobs in several if jobs
        ]
        if parts:
            tasks = self.executor.submit_parts(self.folder, parts)
            self._active |= {
                task: (part.jobs, losses) for task, part in zip(tasks, parts, strict=True)
            }

    def _collect_results(self) -> Iterator[Result]:
        """Yield the new results, and remove them from the active jobs."""
        for file in sorted(self.folder.glob(f"*{RESULT}")):
            result: Result = pickle.loads(file.read_bytes())  # noqa: S301 - our own
            finished_ids = {*runs_of(result)}
            for task, (jobs, losses) in self._active.items():
                self._active[task] = unfinished_jobs(jobs, finished_ids), losses
            file.unlink()
            yield result

    def _end_task(self, task: Any) -> CrashedJob | None:  # noqa: ANN401 - as submitit types it
        """End a task; its remaining jobs are submitted again, or one is the cause of its loss."""
        jobs, losses = self._active.pop(task)
        try:
            if (error := task.result()) is not None:
                raise error
            reason = "it ended early"
        except (UncompletedJobError, FailedJobError) as error:
            reason = str(error).strip().splitlines()[-1]
        if not jobs or self.stop.is_set:
            return None
        if losses + 1 < MAX_LOSSES:
            self._submit_parts([jobs], losses + 1)
            return None
        self._submit_parts([jobs[1:]], 0)
        return CrashedJob(
            jobs[0], f"its task was lost {MAX_LOSSES} times: {reason}", timed_out=False
        )
