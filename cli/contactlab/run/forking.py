"""Start processes that signals meant for this one do not reach."""

import contextlib
import multiprocessing
import signal
import sys
import tempfile
import time
from collections.abc import Generator
from multiprocessing import resource_tracker
from multiprocessing.context import ForkServerContext
from multiprocessing.process import BaseProcess
from multiprocessing.util import get_temp_dir
from types import ModuleType

# What the fork server loads, once for all workers.
_PRELOAD = ["contactlab.run.attempt"]
WISHES = frozenset({signal.SIGINT, signal.SIGTERM})
# Of a folder's path, where 32 characters more and an end must fit into the 108 of an address.
_LONGEST = 75
# How often, and how far apart [s], a process is started where the fork server is ending.
_TRIES, _PAUSE = 20, 0.1


def fork_context() -> ForkServerContext:
    """Return what processes are forked by, with what workers need loaded already."""
    _place_sockets()
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_PRELOAD)
    return context


def _place_sockets() -> None:
    """Choose where the fork server's socket lies; the system takes short paths only.

    It would lie in the temporary folder, whose name a batch system may make long.
    """
    chosen = tempfile.gettempdir()
    if len(chosen) > _LONGEST:
        tempfile.tempdir = "/tmp"  # noqa: S108 - a private folder is made in it
        try:
            get_temp_dir()
        finally:
            tempfile.tempdir = chosen


def launch(process: BaseProcess) -> None:
    """Start a process; if the fork server was just killed, by the one that takes its place."""
    with _without_main():
        _start(process)


def _start(process: BaseProcess) -> None:
    for _ in range(_TRIES):
        with contextlib.suppress(ConnectionRefusedError):
            process.start()
            return
        time.sleep(_PAUSE)
    process.start()


@contextlib.contextmanager
def undisturbed() -> Generator[None]:
    """Hold back wishes to stop, also from processes that start meanwhile, for all of their lives.

    A terminal's Ctrl-C and a batch system's SIGTERM reach every process; workers are stopped by
    the one that started them.
    """
    # Its own start ends with signals let through; nothing happens where it runs already.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, WISHES)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _without_main() -> Generator[None]:
    """Hide the program that is running from processes that start meanwhile.

    They would else import it, and with it all that a command line needs; one without a guard
    would start its sweep once more in each worker.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
