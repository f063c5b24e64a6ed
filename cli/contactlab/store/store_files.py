"""The files of a store, which may come from a stranger: their names, and the way to them.

Names are relative and lead nowhere else; below the store's folder, which may itself be a link,
only folders and regular files are used, up to a size that no honest store reaches.
"""

import os
import stat
from pathlib import Path

from contactlab.errors import StoreError
from contactlab.schema.strict_model import is_inner_name

MANIFEST = "manifest.json"
IDENTITY = "sweep.json"
TABLE = "runs.parquet"
JOURNAL = "journal.jsonl"
NOTES = "notes.jsonl"
SCENES = "scenes"
TRACES = "traces"
CONTROLS = "controls"
LOCK = ".lock"

MOST_DOCUMENT = 64 << 20
"""Bytes of a file that is read at once: identity, manifest, lock."""
MOST_TRACE = 2 << 30
MOST_BYTES = 64 << 30
"""Bytes of any file."""
_FLAGS = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


def read_stored(folder: Path, name: str, most: int = MOST_DOCUMENT) -> bytes | None:
    """Return the content of a store's file; see `stored_file`."""
    path = stored_file(folder, name, most)
    if path is None:
        return None
    with os.fdopen(os.open(path, _FLAGS), "rb") as file:
        # Once more: another one may have come into its place.
        _check(path, os.fstat(file.fileno()), most)
        return file.read(most)


def stored_file(folder: Path, name: str, most: int = MOST_BYTES) -> Path | None:
    """Return the path of a store's file of at most so many bytes; None if there is none.

    Raises:
        StoreError: the name leads out of the store, the file or a folder on the way is something
            else, or it is too large.
    """
    return None if stored_size(folder, name, most) is None else folder / name


def stored_size(folder: Path, name: str, most: int = MOST_BYTES) -> int | None:
    """Return the size of a store's file [bytes]; see `stored_file`."""
    if not is_inner_name(name):
        raise StoreError(f"{folder} is damaged: it names a file '{name}'")
    path = str(folder)
    *folders, last = name.split("/")
    try:
        for each in folders:
            path = f"{path}/{each}"
            if stat.S_ISLNK(os.lstat(path).st_mode):
                raise _foreign(path)
        path = f"{path}/{last}"
        status = os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise StoreError(f"cannot read {path}: {error.strerror}") from error
    _check(path, status, most)
    return status.st_size


def check_tree(folder: Path) -> None:
    """Raise a StoreError if a folder of a store is, or holds, anything but folders and files."""
    left = [folder]
    while left:
        path = left.pop()
        try:
            mode = path.lstat().st_mode
            if stat.S_ISDIR(mode):
                with os.scandir(path) as inside:
                    left += [Path(e) for e in inside if not e.is_file(follow_symlinks=False)]
        except FileNotFoundError:
            continue
        except OSError as error:
            raise StoreError(f"cannot read {path}: {error.strerror}") from error
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise _foreign(path)


def _check(path: object, status: os.stat_result, most: int) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise _foreign(path)
    if status.st_size > most:
        raise StoreError(f"{path} is damaged: {status.st_size:,} bytes are more than {most:,}")


def _foreign(path: object) -> StoreError:
    return StoreError(
        f"{path} is a symbolic link or no regular file; a store holds folders and files only"
    )
