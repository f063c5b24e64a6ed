"""The worker that a process of a Ray node keeps between jobs, with its engine and its models.

It is a process of its own: if it dies or hangs, its job is reported as on any machine, and the
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

_OWN_END = re.compile(r"(\d+)-[^-]+")  # the process, and what makes the name of its folder unique
_workers: dict[str, WorkerPool] = {}  # by the token of its sweep; one at most


def run_on_worker(token: str, bundle: Callable[[], bytes], job: bytes) -> Result | Exception:
    """Return the result of a pickled job, or the exception that should end the sweep.

    It runs on the persistent worker, or on a new one if that is of another sweep. The token
    identifies the sweep; the bundle is fetched only for a new worker.
    """
    with _cancellation() as stop:
        try:
            jobs = [pickle.loads(job)]  # noqa: S301 - our own
            return next(_worker(token, bundle).run(jobs, stop), [])
        except Exception as error:  # noqa: BLE001 - raised again where the sweep runs
            return error


def own_folder() -> Path:
    """Make a folder of this process; remove those of processes that are gone."""
    # Machines that share a folder for temporary files do not share their processes.
    name = f"contactlab-of-{platform.node()}-"
    for other in Path(gettempdir()).glob(name + "*-*"):
        # A machine's name may go on where that of another ends.
        own = _OWN_END.fullmatch(other.name.removeprefix(name))
        if own and not Path("/proc", own[1]).exists():
            shutil.rmtree(other, ignore_errors=True)
    return Path(mkdtemp(prefix=f"{name}{os.getpid()}-"))


def _worker(token: str, bundle: Callable[[], bytes]) -> WorkerPool:
    if token not in _workers:
        for other in _workers.values():
            other.close()
        _workers.clear()
        folder = own_folder()
        _workers[token] = WorkerPool(unpack_bundle(bundle(), folder), folder, 1)
    return _workers[token]


@contextmanager
def _cancellation() -> Generator[Stop]:
    """Yield a stop that is set when the cluster cancels the job, which it does as Ctrl-C would."""
    stop = Stop()
    before = signal.signal(signal.SIGINT, lambda *_: stop.set())
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)
