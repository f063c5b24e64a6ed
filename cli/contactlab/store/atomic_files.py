"""Files that are replaced as a whole or not at all."""

import errno
import hashlib
import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from contactlab.errors import OutputError

TEMPORARY_SUFFIX = ".tmp"


@contextmanager
def atomic_write(target: Path, *, durable: bool = False) -> Generator[Path]:
    """Yield a temporary path beside the target, which replaces the target on success.

    Args:
        target: the file to create or replace.
        durable: whether to sync it to disk.

    Raises:
        OutputError: the file cannot be written; nothing is left behind.
    """
    temporary = target.with_name(target.name + TEMPORARY_SUFFIX)
    try:
        # One that was left may be a link to another place.
        temporary.unlink(missing_ok=True)
        yield temporary
        if durable:
            _sync(temporary)
        temporary.replace(target)
        if durable:
            _sync(target.parent)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise write_error(target, error) from error
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_error(path: object, error: OSError) -> OutputError:
    """Return the error for a path that cannot be written, with its remedy."""
    remedy = "choose another folder with -o"
    if error.errno in {errno.ENOSPC, errno.EDQUOT}:
        remedy = "free some space and run the same command again; it resumes where it stopped"
    elif error.errno == errno.EFBIG:
        remedy = "raise the file size limit (ulimit -f) and run the same command again; it resumes"
    reason = os.strerror(error.errno) if error.errno else error
    return OutputError(f"cannot write {path}: {reason}; {remedy}")


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, in hex."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sync_filesystem(folder: Path) -> None:
    """Sync everything written to the folder's file system to disk."""
    os.sync()
    _sync(folder)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
