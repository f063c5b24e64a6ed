"""Temporary folders that a killed process does not leave for ever.

Each process has one folder for all of its temporary ones, with a locked file in it. The system
releases the lock however the process ends, and the next process removes folders without a lock.
"""

import fcntl
import os
import shutil
import tempfile
import time
from contextlib import suppress
from functools import cache
from multiprocessing.util import Finalize
from pathlib import Path

_PREFIX = "contactlab-"
_LOCK = "lock"


def temporary_folder() -> tempfile.TemporaryDirectory[str]:
    """Return a new folder that is removed at the end of its context."""
    return tempfile.TemporaryDirectory(dir=temporary_root())


def temporary_root() -> Path:
    """Return the folder of this process; it is removed when the process ends."""
    return _open_root(tempfile.gettempdir(), os.getpid())


def names_temporary_file(text: str) -> bool:
    """Return whether a text names a temporary file, which a user cannot edit."""
    return f"{tempfile.gettempdir()}{os.sep}{_PREFIX}" in text


@cache
def _open_root(place: str, process: int) -> Path:
    del process  # a forked process has a folder of its own
    root = make_locked_folder(Path(place))
    # Unlike `atexit`, it acts at the end of worker processes, too.
    Finalize(None, shutil.rmtree, (root,), {"ignore_errors": True}, exitpriority=0)
    return root


def make_locked_folder(place: Path, prefix: str = _PREFIX, least_age: float = 3600.0) -> Path:
    """Return a new folder, and remove older ones that ended processes have left in its place."""
    remove_left_folders(place, least_age, prefix)
    folder = Path(tempfile.mkdtemp(prefix=prefix, dir=place))
    # It stays open, and so locked, as long as the process or one that it forked lives.
    lock = os.open(folder / _LOCK, os.O_CREAT | os.O_RDWR, 0o600)
    with suppress(OSError):  # some network file systems have no locks
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return folder


def remove_left_folders(place: Path, least_age: float = 3600.0, prefix: str = _PREFIX) -> None:
    """Remove folders of this user's processes that have ended.

    Args:
        place: folder of temporary files.
        least_age: least age of a removed folder [s]; a new one may not be locked yet.
        prefix: start of their names.
    """
    for folder in place.glob(f"{prefix}*"):
        with suppress(OSError):
            status = folder.lstat()
            if status.st_uid != os.geteuid() or time.time() - status.st_mtime < least_age:
                continue
            lock = os.open(folder / _LOCK, os.O_RDWR | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder)
            finally:
                os.close(lock)
