"""What an interrupted store in object storage holds, brought into a folder of this machine."""

import shutil
import uuid
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from contactlab.store.objects.object_client import ObjectClient
from contactlab.store.retry_failed import drop_failed, failed_traces
from contactlab.store.row_journal import JOURNAL, NOTES, mend_journal
from contactlab.store.store_writer import TRACES

ROWS = "journal"
FOUND = "notes"
THREADS = 16
_WINDOW = 128


def pull_rows(client: ObjectClient, folder: Path, *, retry_failed: bool) -> set[str]:
    """Bring all whole rows into a folder's journal; those of lost traces are left out for good.

    Args:
        client: where the store lies.
        folder: where the journal is written.
        retry_failed: whether to leave out failed runs too.

    Returns:
        The ids of the runs that they are of.
    """
    names = [name for name, _ in client.sizes(ROWS)]
    if not names:
        return set()
    journal = folder / JOURNAL
    _bring(client, names, journal)
    with journal.open("rb") as lines:
        rows = sum(1 for _ in lines)
    if retry_failed:
        client.delete(failed_traces(folder))
        drop_failed(folder)
    done = mend_journal(folder, _has_trace(client))
    if len(done) < rows:
        # What is left out must stay so, also where its trace comes to lie there again.
        keep_rows(client, journal)
        client.delete(names)
    return done


def keep_rows(client: ObjectClient, journal: Path) -> None:
    """Put all rows of a journal as one object."""
    client.put(f"{ROWS}/{uuid.uuid4().hex}.jsonl", journal)


def pull_notes(client: ObjectClient, folder: Path) -> None:
    """Bring all notes into a folder."""
    if names := [name for name, _ in client.sizes(FOUND)]:
        _bring(client, names, folder / NOTES)


def fetch_all(client: ObjectClient, names: Sequence[str], folder: Path) -> list[str]:
    """Fetch objects into a folder, many at a time; return the names of those that are not there."""
    with ThreadPoolExecutor(THREADS) as pool:
        fetched = pool.map(lambda name: client.fetch(name, folder / name), names)
        return [name for name, there in zip(names, fetched, strict=True) if not there]


def _bring(client: ObjectClient, names: Sequence[str], target: Path) -> None:
    """Join objects of lines into one file, so many on this machine at a time."""
    with target.open("wb") as joined, TemporaryDirectory(dir=target.parent) as name:
        for first in range(0, len(names), _WINDOW):
            some = names[first : first + _WINDOW]
            fetch_all(client, some, Path(name))
            for part in (Path(name) / each for each in some):
                if part.is_file():
                    with part.open("rb") as lines:
                        shutil.copyfileobj(lines, joined)
                    part.unlink()


def _has_trace(client: ObjectClient) -> Callable[[Mapping[str, Any]], bool]:
    sizes = dict(client.sizes(TRACES))
    return lambda row: (
        row["trace_file"] is None or (sizes.get(row["trace_file"]) == row["trace_bytes"])
    )
