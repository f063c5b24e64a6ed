"""The journal of an unfinished store: one row a line, appended as runs finish.

A process killed in mid-write leaves a torn line, which is dropped on resuming. Results of later
passes go to notes beside the journal until the store is finished.
"""

import itertools
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from pydantic_core import from_json

from contactlab.store.atomic_files import atomic_write, write_error
from contactlab.store.backend_protocol import JOURNAL, NOTES

FAILED_STATUSES = frozenset({"crashed", "error", "timeout"})

Row = Mapping[str, Any]


class Journal:
    """Appends lines to a journal, or to the notes beside it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("ab")

    def append(self, lines: Iterable[bytes]) -> None:
        """Append lines of JSON, given without line ends, and hand them to the operating system.

        Raises:
            OutputError: they cannot be written.
        """
        try:
            self._file.write(b"".join(line + b"\n" for line in lines))
            self._file.flush()
        except OSError as error:
            raise write_error(self._path, error) from error

    def close(self) -> None:
        """Close the file; safe to call when the disk is full."""
        try:
            self._file.close()
        except OSError as error:
            raise write_error(self._path, error) from error


def mend_journal(folder: Path, is_complete: Callable[[Row], bool]) -> set[str]:
    """Drop lines that are torn or repeated, and those of runs that are not stored completely.

    Args:
        folder: the journal's folder; without a journal there are no runs.
        is_complete: whether all that a row names is in the store.

    Returns:
        The ids of the remaining runs.

    Raises:
        OutputError: the journal cannot be rewritten.
    """
    path = folder / JOURNAL
    if not path.is_file():
        return set()
    kept: set[str] = set()
    good = bytearray()
    with path.open("rb") as lines:
        for line in lines:
            run_id = _complete_run(line, is_complete)
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


def _complete_run(line: bytes, is_complete: Callable[[Row], bool]) -> str | None:
    try:
        row = from_json(line)
    except ValueError:
        return None
    return row["run_id"] if line.endswith(b"\n") and is_complete(row) else None


def mend_notes(folder: Path) -> None:
    """End a torn line, so that the next note does not become part of it."""
    path = folder / NOTES
    if path.is_file() and not path.read_bytes().endswith(b"\n"):
        with path.open("ab") as notes:
            notes.write(b"\n")


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the complete lines of a journal or of notes; none if there is no such file."""
    if not path.is_file():
        return
    with path.open("rb") as lines:
        for line in lines:
            with suppress(ValueError):
                yield json.loads(line)


def amend_journal(folder: Path, amendments: Mapping[str, Row]) -> None:
    """Set columns of rows that are already in the journal.

    Args:
        folder: the journal's folder.
        amendments: run id to values by column.

    Raises:
        OutputError: the journal cannot be rewritten.
    """
    if amendments:
        path = folder / JOURNAL
        rows = (row | dict(amendments.get(row["run_id"], {})) for row in read_lines(path))
        _rewrite(path, rows)


def failed_traces(folder: Path) -> list[str]:
    """Return the names of the traces of failed runs in a journal."""
    rows = read_lines(folder / JOURNAL)
    return [row["trace_file"] for row in rows if _has_failed(row) and row["trace_file"]]


def drop_failed_rows(folder: Path) -> None:
    """Remove the rows of failed runs from a journal.

    Raises:
        OutputError: the journal cannot be rewritten.
    """
    path = folder / JOURNAL
    if any(map(_has_failed, read_lines(path))):
        _rewrite(path, (row for row in read_lines(path) if not _has_failed(row)))


def _has_failed(row: Row) -> bool:
    return row["status"] in FAILED_STATUSES


def _rewrite(path: Path, rows: Iterable[Row]) -> None:
    """Replace a journal's rows, all or none; the new ones may be read from the journal itself."""
    with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8") as lines:
        lines.writelines(json.dumps(row) + "\n" for row in rows)
