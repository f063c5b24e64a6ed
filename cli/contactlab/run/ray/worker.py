"""The worker that a process of a Ray node keeps between jobs, with its engine and its models.

It is a separate process: if it dies or hangs, its job is reported like on any machine, and the
cluster does not lose the process that waits for it.
"""

import os
import pickle
import platform
import re
import shutil
import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from tempfile import gettempdir, mkdtemp

from contactlab.run.task_bundle import unpack_bundle
from contactlab.run.tasks import Result, Stop
from contactlab.run.worker_pool import WorkerPool

_FOLDER_END = re.compile(r"(\d+)-[^-]+")  # the process, and a suffix that makes its folder unique
_workers_by_token: dict[str, WorkerPool] = {}  # by the token of its sweep; one at most


def run_on_worker(token: str, bundle: Callable[[], bytes], job: bytes) -> Result | Exception:
    """Return the result of a pickled job, or the exception that should end the sweep.

    It runs on the persistent worker, or on a new one if that belongs to another sweep. The token
    identifies the sweep; the bundle is fetched only for a new worker.
    """
    with _stop_on_cancel() as stop:
        try:
            jobs = [pickle.loads(job)]  # noqa: S301 - our own
            # A cluster's worker keeps one pool, for the sweep that last sent it jobs.
            if token not in _workers_by_token:
                for other in _workers_by_token.values():
                    other.close()
                _workers_by_token.clear()
                folder = own_folder()
                _workers_by_token[token] = WorkerPool(unpack_bundle(bundle(), folder), folder, 1)
            return next(_workers_by_token[token].run_jobs(jobs, stop), [])
        except Exception as error:  # noqa: BLE001 - raised again where the sweep runs
            return error


def own_folder() -> Path:
    """Create a folder of this process; remove those of ended processes."""
    # Machines that share a folder for temporary files do not share their processes.
    name = f"contactlab-of-{platform.node()}-"
    for other in Path(gettempdir()).glob(name + "*-*"):
        # The name of a machine may begin with that of another.
        own = _FOLDER_END.fullmatch(other.name.removeprefix(name))
        if own and not Path("/proc", own[1]).exists():
            shutil.rmtree(other, ignore_errors=True)
    return Path(mkdtemp(prefix=f"{name}{os.getpid()}-"))


@contextmanager
def _stop_on_cancel() -> Generator[Stop]:
    """Yield a stop that is set when the cluster cancels the job, with the signal of Ctrl-C."""
    stop = Stop()
    before = signal.signal(signal.SIGINT, lambda *_: stop.request_stop())
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)
