"""Replaces files as a whole or not at all."""

import ctypes
import errno
import hashlib
import os
import re
import secrets
from collections.abc import Generator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from threading import Timer

from contactlab.errors import OutputError

TEMPORARY_SUFFIX = ".tmp"
_TEMPORARY = re.compile(r"(\.[0-9a-f]{8})?\.tmp$")
_LIBC = ctypes.CDLL(None, use_errno=True)


@contextmanager
def atomic_write(target: Path, *, durable: bool = False) -> Generator[Path]:
    """Yield a temporary path next to the target, which replaces the target on success.

    No other process, and no link left by one, has its name. If `durable`, it is synced to the disk.
    Raises an OutputError if the file cannot be written; nothing is left behind.
    """
    temporary = target.with_name(_temporary_name(target.name))
    try:
        with write_errors(target):
            yield temporary
            if durable:
                sync_path(temporary)
            temporary.replace(target)
            if durable:
                sync_path(target.parent)
    except BaseException:
        _remove_if_possible(temporary)
        raise


def write_file(target: str, data: bytes) -> None:
    """Create or replace a file like `atomic_write`, without the cost of paths for small files."""
    temporary = _temporary_name(target)
    try:
        with write_errors(target):
            with FileIO(temporary, "x") as file:
                rest = memoryview(data)
                while rest:  # The system may take a part at a time.
                    rest = rest[file.write(rest) :]
            os.replace(temporary, target)  # noqa: PTH105 - a path would take as long as the rest
    except BaseException:
        _remove_if_possible(Path(temporary))
        raise


def _remove_if_possible(temporary: Path) -> None:
    """Remove a file if possible; the earlier error explains a failure."""
    with suppress(OSError):
        temporary.unlink()


def _temporary_name(target: str) -> str:
    return f"{target}.{secrets.token_hex(4)}{TEMPORARY_SUFFIX}"


def target_name(name: str) -> str:
    """Return the target name of a temporary file; other names are unchanged."""
    return _TEMPORARY.sub("", name)


def write_error(path: object, error: OSError) -> OutputError:
    """Return the error for a path that cannot be written, with advice."""
    remedy = "choose another folder with -o"
    if error.errno in {errno.ENOSPC, errno.EDQUOT}:
        remedy = "free some space and run the same command again; it resumes where it stopped"
    elif error.errno == errno.EFBIG:
        remedy = "raise the file size limit (ulimit -f) and run the same command again; it resumes"
    reason = os.strerror(error.errno) if error.errno else error
    return OutputError(f"cannot write {path}: {reason}; {remedy}")


@contextmanager
def write_errors(path: object, *, within: bool = False) -> Generator[None]:
    """Convert errors of the system into one that names a path that cannot be written.

    With `within`, the path is a folder, and the error names the file that the system names. A time
    limit of the caller, which Python raises without an error number, passes unchanged.
    """
    try:
        yield
    except OSError as error:
        if isinstance(error, TimeoutError) and error.errno is None:
            raise
        raise write_error((within and error.filename) or path, error) from error


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, in hex."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def hashes_below(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each file below a folder, by its path relative to it."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): sha256_of(path) for path in files}


def exchange_folders(new: Path, target: Path) -> None:
    """Exchange two folders, on Linux in one step.

    If the system or the file system cannot, the target is `old` next to the new one for a moment.
    """
    rename = getattr(_LIBC, "renameat2", None)
    paths = os.fsencode(new.absolute()), os.fsencode(target.absolute())
    # of renameat2(2), from linux/fcntl.h and linux/fs.h
    at_current_folder, rename_exchange = -100, 2
    if rename is None or rename(
        at_current_folder, paths[0], at_current_folder, paths[1], rename_exchange
    ):
        move_folder(target, old := new.with_name("old"))
        try:
            move_folder(new, target)
        except OSError:
            move_folder(old, target)
            raise


def move_folder(source: Path, target: Path) -> None:
    """Rename a folder, even if the system reports the failure of a success, as NFS may."""
    moved = source.stat()
    try:
        source.rename(target)
    except OSError:
        target_state = target.stat() if target.exists() and not source.exists() else None
        if target_state is None or (target_state.st_dev, target_state.st_ino) != (
            moved.st_dev,
            moved.st_ino,
        ):
            raise


def sync_filesystem(folder: Path) -> None:
    """Sync everything written to the folder's file system to disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        # Linux can sync one file system; other systems sync all of them.
        if (syncfs := getattr(_LIBC, "syncfs", None)) is None:
            os.sync()
        elif syncfs(handle):
            if ctypes.get_errno() != errno.ENOSYS:
                raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), str(folder))
            os.sync()
        os.fsync(handle)
    finally:
        os.close(handle)


class GroupCommit:
    """Syncs a file system half a second after the first of many changes, in a separate thread.

    Written data survives a power cut after one second, however fast it is written. Methods raise an
    OutputError once a change could not be synced.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._timer: Timer | None = None
        self._failure: OSError | None = None

    def request_sync(self) -> None:
        """Request a sync after a change."""
        self._raise_failure()
        if self._timer is None:
            # Pause between two syncs [s]; with the sync it is well below a second.
            self._timer = Timer(0.5, self._sync_changes)
            self._timer.daemon = True
            self._timer.start()

    def close(self) -> None:
        """Sync all remaining changes."""
        if (timer := self._timer) is not None:
            timer.cancel()
        # Even during another sync, this returns only after all data is on the disk.
        self._sync_changes()
        self._raise_failure()

    def _sync_changes(self) -> None:
        # Reset first, so that a change during the sync requests another one.
        self._timer = None
        try:
            sync_filesystem(self._folder)
        except OSError as error:
            self._failure = error

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise write_error(self._folder, self._failure) from self._failure


def sync_path(path: Path) -> None:
    """Sync a file, or the names in a folder, to disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
