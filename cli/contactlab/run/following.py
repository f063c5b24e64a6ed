"""A worker ends with the process that it works for, even in the middle of a long call."""

import fcntl
import multiprocessing
import os
import signal
import threading


def follow_parent() -> None:
    """End this worker as soon as its parent, which is not the fork server, has ended."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    _end_with(parent.sentinel)
    threading.Thread(target=_wait_and_end, daemon=True).start()


def _end_with(pipe: int) -> None:
    """Have the kernel end this process when the pipe's other end closes, where it can.

    Python itself gets no turn as long as C code holds its lock.
    """
    if hasattr(fcntl, "F_SETSIG"):
        fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)


def _wait_and_end() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
