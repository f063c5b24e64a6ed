"""The server that worker processes are forked from, once it has loaded their modules."""

import contextlib
import multiprocessing
import os
import signal
import sys
import tempfile
import time
from collections.abc import Generator, MutableMapping
from multiprocessing import forkserver, resource_tracker, util
from multiprocessing.process import BaseProcess
from types import ModuleType
from typing import TypeVar

from contactlab.registry import own_parts, registry_fillers

Value = TypeVar("Value")

CONTEXT = multiprocessing.get_context("forkserver")
STOP_SIGNALS = frozenset({signal.SIGINT, signal.SIGTERM})
IN_FORK_SERVER = "CONTACTLAB_IN_FORK_SERVER"
"""An environment variable that the fork server has when it starts, and removes."""
# A worker has a core: BLAS's threads would share it, and wait for ever where none can be started.
_ENVIRONMENT = {"PYTHONSAFEPATH": "1", "OPENBLAS_NUM_THREADS": "1", IN_FORK_SERVER: "1"}
# Number of attempts to start a process while the fork server is being replaced, and pause [s].
_START_ATTEMPTS, _START_PAUSE = 20, 0.1


def start_server() -> None:
    """Start the server, if it does not run, and go on while it loads."""
    # The system wants the socket's path to be short; the temporary folder of a batch system is not.
    chosen = tempfile.gettempdir()
    # Longest path of a folder: 32 more characters and an end must fit into the 108 of an address.
    if len(chosen) > 75:
        tempfile.tempdir = "/tmp"  # noqa: S108 - a private folder is made in it
        try:
            util.get_temp_dir()
        finally:
            tempfile.tempdir = chosen
    # Workers call the functions that fill the registry: their modules are loaded for them, too.
    preloaded = own_parts("fork server")["preloaded"].load()
    fillers = [filler.__module__ for filler in registry_fillers()]
    CONTEXT.set_forkserver_preload([preloaded.__name__, *fillers])
    with _own_imports(), signals_blocked():
        forkserver.ensure_running()


def start_process(process: BaseProcess) -> None:
    """Start a process; if the fork server was just killed, from the one that replaces it."""
    start_server()
    with _own_imports():
        for _ in range(_START_ATTEMPTS):
            with contextlib.suppress(ConnectionError, EOFError):
                process.start()
                return
            time.sleep(_START_PAUSE)
        process.start()


@contextlib.contextmanager
def signals_blocked() -> Generator[None]:
    """Block Ctrl-C and SIGTERM, also for all of the life of processes that start meanwhile.

    A terminal's Ctrl-C and a batch system's SIGTERM reach every process; workers are stopped by
    the process that started them.
    """
    # Starting the tracker ends with signals let through; if it runs already, nothing happens.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _own_imports() -> Generator[None]:
    """Let processes that start meanwhile import nothing of the command's folder, nor `__main__`.

    The current folder may be a stranger's, with its own `selectors.py`. `__main__` has all
    that a command line needs; a script without `if __name__ == "__main__"` would start its sweep
    again in each worker.
    """
    blank = ModuleType("__main__")
    with (
        _replace_entries(os.environ, **_ENVIRONMENT),
        _replace_entries(sys.modules, __main__=blank),
    ):
        yield


@contextlib.contextmanager
def _replace_entries(entries: MutableMapping[str, Value], **others: Value) -> Generator[None]:
    """Have other entries of these names for a while, here and in processes that start meanwhile."""
    before = {name: entries[name] for name in others if name in entries}
    entries.update(others)
    try:
        yield
    finally:
        for name in others:
            del entries[name]
        entries.update(before)
