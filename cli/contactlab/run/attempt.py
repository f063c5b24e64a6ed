"""Run a job where it was sent to, and tell what its failure means."""

import re

from contactlab.run.job import Job, Lost, Result
from contactlab.run.worker import Worker

# As the engine, zstandard and the operating system put it.
_NO_MEMORY = re.compile("(allocate|not enough|out of) memory", re.IGNORECASE)


def attempt(worker: Worker, job: Job) -> Result | Exception:
    """Return a job's results, or why there are none.

    Returns:
        Its results; or the job as lost if memory did not suffice, which another process, or fewer
        runs at once, may mend; or the failure, which should end the sweep.
    """
    try:
        return worker.run(job)
    except Exception as error:  # noqa: BLE001 - carried to who sent the job
        if isinstance(error, MemoryError) or _NO_MEMORY.search(str(error)):
            return Lost(job, f"out of memory: {_said(error)}", timed_out=False)
        return error


def _said(error: Exception) -> str:
    return " / ".join(str(error).split("\n")) or "the worker can have no more"
