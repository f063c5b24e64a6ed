"""The worker that a process of a node keeps between jobs, and so its engine and its models.

It is a process of its own: its death or hang is told of a job as on any machine, and the cluster
does not lose the process that waits for it.
"""

import pickle
import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager

from contactlab.run.cluster.parcel import own_folder, unpacked
from contactlab.run.job import Result
from contactlab.run.pool import KeptWorker
from contactlab.run.stop import Stop

# One at most.
_kept: dict[str, KeptWorker] = {}


def run_kept(token: str, parcel: Callable[[], bytes], job: bytes) -> Result | Exception:
    """Run a job by the kept worker; a new one if it is of another sweep.

    Args:
        token: what tells the sweep from others.
        parcel: gets what its jobs have in common.
        job: the runs, pickled.

    Returns:
        What comes of the job, or the failure that should end the sweep.
    """
    with _called_back() as stop:
        try:
            return _worker(token, parcel).run(pickle.loads(job), stop)  # noqa: S301 - our own
        except Exception as error:  # noqa: BLE001 - carried to where the sweep runs
            return error


def _worker(token: str, parcel: Callable[[], bytes]) -> KeptWorker:
    if token not in _kept:
        for other in _kept.values():
            other.end()
        _kept.clear()
        folder = own_folder()
        _kept[token] = KeptWorker(unpacked(parcel(), folder), folder / "marker")
    return _kept[token]


@contextmanager
def _called_back() -> Generator[Stop]:
    """Yield what is set when the cluster calls the job back, which it does as Ctrl-C would."""
    stop = Stop()
    before = signal.signal(signal.SIGINT, lambda *_: stop.set())
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)
