"""Runs whose worker died: found by running their job one by one, recorded without a trace."""

from collections.abc import Iterable, Iterator

from contactlab.run.job import Executor, Finished, Job, Lost, Task
from contactlab.run.results import results_of
from contactlab.run.stop import Stop
from contactlab.run.worker import Worker
from contactlab.schema import LabelEntry


def run_all(
    task: Task, jobs: Iterable[Job], executor: Executor, stop: Stop
) -> Iterator[list[Finished]]:
    """Yield what comes of every job, once for each run.

    A job that is lost is run again, run by run. A run that then runs out of time is the culprit, or
    one that is lost twice by itself: once may be chance, as when others need the memory.

    Raises:
        StoppedError: the sweep was wished to stop; lost jobs are left for another time.
    """
    lost: list[Job] = []
    for result in results_of(task, jobs, executor, stop):
        if isinstance(result, Lost):
            lost.append(result.job)
        else:
            yield result
    for last in (False, True):
        if not lost:
            return
        recorder = Worker(task, None)
        alone, lost = [(run,) for job in lost for run in job], []
        for result in results_of(task, alone, executor, stop):
            if not isinstance(result, Lost):
                yield result
            elif last or result.timed_out:
                yield [_record_loss(task, recorder, result)]
            else:
                lost.append(result.job)


def _record_loss(task: Task, recorder: Worker, lost: Lost) -> Finished:
    (run,) = lost.job
    label = "timeout" if lost.timed_out else "crashed"
    reason = f"over {task.sweep.timeout:g} s: {lost.reason}" if lost.timed_out else lost.reason
    return recorder.lost(run, LabelEntry(label=label, reason=reason, step=None))
