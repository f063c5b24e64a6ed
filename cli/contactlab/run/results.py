"""What comes of jobs, until all are done or the sweep is wished to stop."""

from collections.abc import Iterable, Iterator

from contactlab.errors import StoppedError
from contactlab.run.job import Executor, Job, Result, Task
from contactlab.run.stop import Stop


def results_of(task: Task, jobs: Iterable[Job], executor: Executor, stop: Stop) -> Iterator[Result]:
    """Yield the results of jobs as they come.

    Raises:
        StoppedError: the sweep was wished to stop; what was in flight then has been yielded.
    """
    with stop.heeded():
        yield from executor.run(task, jobs, stop)
    if stop.is_set:
        raise StoppedError("interrupted; the same command goes on where it stopped")
