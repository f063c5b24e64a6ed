"""Runs whose worker died: found by running their job one by one, recorded without a trace."""

from collections.abc import Iterable, Iterator

from contactlab.pipeline.job import Executor, Finished, Job, Lost, Task
from contactlab.pipeline.stop import Stop
from contactlab.pipeline.worker import Worker
from contactlab.schema import LabelEntry


def run_all(
    task: Task, jobs: Iterable[Job], executor: Executor, stop: Stop
) -> Iterator[list[Finished]]:
    """Yield what comes of every job, once for each run.

    A job that is lost is run again, run by run; a run that is lost once more is the culprit.
    """
    lost: list[Job] = []
    for result in executor.run(task, jobs, stop):
        if isinstance(result, Lost):
            lost.append(result.job)
        else:
            yield result
    if not lost:
        return
    recorder = Worker(task, None)
    single = [(run,) for job in lost for run in job]
    for result in executor.run(task, single, stop):
        yield [_record_loss(task, recorder, result)] if isinstance(result, Lost) else result


def _record_loss(task: Task, recorder: Worker, lost: Lost) -> Finished:
    (run,) = lost.job
    label = "timeout" if lost.timed_out else "crashed"
    reason = f"over {task.sweep.timeout:g} s: {lost.reason}" if lost.timed_out else lost.reason
    return recorder.lost(run, LabelEntry(label=label, reason=reason, step=None))
