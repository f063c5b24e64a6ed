"""The journal of an unfinished store: one row a line, appended as runs finish.

A process killed in mid-write leaves a torn line, which is left out on resuming. What is found out
of runs later lies in notes beside the journal, until the store is finished.
"""

import itertools
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from pydantic_core import from_json

from contactlab.store.atomic_files import atomic_write, write_error

JOURNAL = "journal.jsonl"
NOTES = "notes.jsonl"


class Journal:
    """Appends rows to a store's journal, or to the notes beside it."""

    def __init__(self, store: Path, name: str = JOURNAL) -> None:
        self._path = store / name
        self._file = self._path.open("ab")

    def append(self, rows: Iterable[bytes]) -> None:
        """Append rows, each one line of JSON, and hand them to the operating system.

        Raises:
            OutputError: they cannot be written.
        """
        try:
            self._file.write(b"".join(row + b"\n" for row in rows))
            self._file.flush()
        except OSError as error:
            raise write_error(self._path, error) from error

    def close(self) -> None:
        """Close the file; safe to call when the disk is full."""
        try:
            self._file.close()
        except OSError as error:
            raise write_error(self._path, error) from error


def mend_journal(store: Path, is_whole: Callable[[Mapping[str, Any]], bool]) -> set[str]:
    """Leave out the lines that are torn, and those of runs that are not stored whole.

    Args:
        store: the store's folder; without a journal, it has no runs.
        is_whole: whether all that a row names is in the store.

    Returns:
        The ids of the runs that stay.

    Raises:
        OutputError: the journal cannot be written anew.
    """
    path = store / JOURNAL
    if not path.is_file():
        return set()
    kept: set[str] = set()
    good = bytearray()
    with path.open("rb") as lines:
        for line in lines:
            run_id = _id_of_whole(line, is_whole)
            # A run that is there twice counts once.
            good.append(bool(run_id) and run_id not in kept)
            if run_id:
                kept.add(run_id)
    if not all(good):
        with (
            path.open("rb") as lines,
            atomic_write(path) as temporary,
            temporary.open("wb") as mended,
        ):
            mended.writelines(itertools.compress(lines, good))
    return kept


def _id_of_whole(line: bytes, is_whole: Callable[[Mapping[str, Any]], bool]) -> str | None:
    try:
        row = from_json(line)
    except ValueError:
        return None
    return row["run_id"] if line.endswith(b"\n") and is_whole(row) else None


def mend_notes(store: Path) -> None:
    """End a torn line, so that the next note does not become part of it."""
    path = store / NOTES
    if path.is_file() and not path.read_bytes().endswith(b"\n"):
        with path.open("ab") as notes:
            notes.write(b"\n")


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the whole lines of a journal or of notes; none if there is no such file."""
    if not path.is_file():
        return
    with path.open("rb") as lines:
        for line in lines:
            with suppress(ValueError):
                yield json.loads(line)


def amend_journal(store: Path, found: Mapping[str, Mapping[str, Any]]) -> None:
    """Write into the journal's rows what was found out later.

    Args:
        store: the store's folder.
        found: run id to values by column.

    Raises:
        OutputError: the journal cannot be written anew.
    """
    if not found:
        return
    path = store / JOURNAL
    rewrite_lines(path, (row | dict(found.get(row["run_id"], {})) for row in read_lines(path)))


def rewrite_lines(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Put other rows in the place of a journal's, all or none; they may be made of its own.

    Raises:
        OutputError: it cannot be written anew.
    """
    with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8") as lines:
        lines.writelines(json.dumps(row) + "\n" for row in rows)
