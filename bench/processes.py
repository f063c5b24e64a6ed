"""CPU time of a command with all processes that it leaves behind; Linux only."""

import ctypes
import os
import resource
import subprocess
from collections.abc import Collection, Sequence
from contextlib import suppress

_SET_CHILD_SUBREAPER = 36
_NO_BYTECODE = "PYTHONDONTWRITEBYTECODE"


def adopt_orphans() -> None:
    """Make this process the parent of what its children leave behind.

    A fork server outlives the command that started it, if only by a moment; unless someone waits
    for it, its CPU time, and that of the workers that it waited for, is in nobody's account.
    """
    if ctypes.CDLL(None, use_errno=True).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl")


def cpu_of(command: Sequence[str], expected: Collection[int] = (0,)) -> float:
    """Return the CPU time, user and system, of a command and of everything it started [s].

    It may write bytecode, as what is installed has it.

    Raises:
        RuntimeError: the command has another exit code than the expected ones.
    """
    before = _spent()
    others = {name: value for name, value in os.environ.items() if name != _NO_BYTECODE}
    done = subprocess.run(command, env=others, capture_output=True, text=True, check=False)
    if done.returncode not in expected:
        raise RuntimeError(f"{' '.join(command)} failed:\n{done.stdout}{done.stderr}")
    with suppress(ChildProcessError):
        while True:
            os.wait()
    return _spent() - before


def _spent() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
