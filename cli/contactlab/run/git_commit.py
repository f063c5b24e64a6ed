"""Read the commit of a folder from the files of its repository.

git itself is never started. It runs programs that a repository's configuration names, such as
filters, hooks and watchers, and the current folder may be a stranger's.
"""

import os
import re
import stat
from pathlib import Path

_COMMIT = re.compile(r"[0-9a-f]{40}|[0-9a-f]{64}")  # SHA-1 or SHA-256
_REFERENCE = re.compile(r"ref:\s*(refs/[^\s\x00-\x1f]+)")


def commit_of(folder: Path) -> str | None:
    """Return the commit that the working tree around a folder is at; None without one.

    Whether files differ from that commit is not asked. A repository without a working tree, one
    without a commit and one in the format `reftable` count as none. Only regular files inside of
    the repository are read, and only a commit's hexadecimal digits are returned.
    """
    for parent in (folder, *folder.parents):
        repository = _find_repository(parent / ".git")
        line = None if repository is None else _read_line(repository / "HEAD", repository)
        if repository is not None and line:
            break
    else:
        return None
    # A linked worktree has a HEAD of its own and shares the references of its main one.
    shared = _read_line(repository / "commondir", repository)
    common = (repository / shared).resolve() if shared else repository
    if not (common / "objects").is_dir():
        return None
    # References that name another one in a row, as in git itself.
    for _ in range(5):
        if _COMMIT.fullmatch(line):
            return line
        if (reference := _REFERENCE.fullmatch(line)) is None:
            return None
        name = reference[1]
        loose = _read_line(repository / name, repository) or _read_line(common / name, common)
        if loose:
            line = loose
            continue
        # A file of a million packed references [bytes].
        packed = _read_text(common / "packed-refs", common, 1 << 26) or ""
        match = re.search(rf"^([0-9a-f]+) {re.escape(name)}$", packed, re.MULTILINE)
        if match is None:
            return None
        line = match[1]
    return None


def _find_repository(place: Path) -> Path | None:
    """Return the folder that holds HEAD: `.git` itself, or the one that a file `.git` names."""
    if place.is_dir():
        return place.resolve()
    line = _read_line(place, place.parent)
    if line is None or not line.startswith("gitdir:"):
        return None
    return (place.parent / line.removeprefix("gitdir:").strip()).resolve()


def _read_line(path: Path, within: Path) -> str | None:
    # A file with one line is as long as the longest path of Linux [bytes].
    text = _read_text(path, within, 1 << 12)
    return None if text is None else text.strip()


def _read_text(path: Path, within: Path, limit: int) -> str | None:
    """Return the text of a regular file inside of a folder; None for anything else."""
    try:
        # A link or `..` could lead to any file of the user's.
        if not path.resolve().is_relative_to(within.resolve()):
            return None
        # Opening a pipe would wait for its writer.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as file:
            about = os.fstat(descriptor)
            if not stat.S_ISREG(about.st_mode) or about.st_size > limit:
                return None
            return file.read(limit).decode("utf-8")
    except (OSError, RuntimeError, ValueError):  # unreadable, links in a circle, not UTF-8
        return None
