"""The journal of an unfinished store: one row a line, appended as runs finish.

A process killed in mid-write leaves at most one torn line, which is cut off on resuming.
"""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from contactlab.evidence.files import cannot_write

JOURNAL = "journal.jsonl"


class Journal:
    """Appends rows to a store's journal."""

    def __init__(self, store: Path) -> None:
        self._path = store / JOURNAL
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
            raise cannot_write(self._path, error) from error

    def close(self) -> None:
        """Close the file; safe to call when the disk is full."""
        try:
            self._file.close()
        except OSError as error:
            raise cannot_write(self._path, error) from error


def read_journal(store: Path) -> Iterator[dict[str, Any]]:
    """Yield the rows of a journal; a store without one has none."""
    path = store / JOURNAL
    if path.is_file():
        with path.open("rb") as lines:
            for line in lines:
                yield json.loads(line)


def mend_journal(store: Path) -> None:
    """Cut off a torn last line."""
    path = store / JOURNAL
    if not path.is_file():
        return
    data = path.read_bytes()
    whole = data.rfind(b"\n") + 1
    if whole < len(data):
        with path.open("r+b") as file:
            file.truncate(whole)
