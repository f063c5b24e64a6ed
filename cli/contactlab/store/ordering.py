"""The lines of a journal in the order of their runs, without holding more than a part of them."""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

# How every row begins, so that it need not be read to its end.
_HEAD = re.compile(rb'\{"run_id": ?"\w*", ?"index": ?(\d+),')
_BLOCK = 8 << 20


class OrderedLines:
    """A journal's rows by their place in the plan; of each, only that and where it lies is held.

    Args:
        journal: one row a line, as JSON, in any order, none of them torn.
    """

    def __init__(self, journal: Path) -> None:
        self._path = journal
        with journal.open("rb") as lines:
            found = np.fromiter(_spans(lines), _SPAN)
        self._spans = found[np.argsort(found["index"], kind="stable")]

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._spans)

    def blocks(self, first: int, stop: int) -> Iterator[bytes]:
        """Yield some rows, in order, as blocks of whole lines of some MiB."""
        spans = self._spans[first:stop]
        # A row goes to the block in which its first byte would be, were they all of one length.
        block = (np.cumsum(spans["size"]) - spans["size"]) // _BLOCK
        with self._path.open("rb") as file:
            for part in np.split(spans, np.flatnonzero(np.diff(block)) + 1):
                yield _read(file, part)


_SPAN = np.dtype([("index", np.int64), ("start", np.int64), ("size", np.int64)])


def _spans(lines: BinaryIO) -> Iterator[tuple[int, int, int]]:
    start = 0
    for line in lines:
        yield _index(line), start, len(line)
        start += len(line)


def _index(line: bytes) -> int:
    head = _HEAD.match(line)
    return int(head[1]) if head else int(from_json(line)["index"])


def _read(file: BinaryIO, spans: NDArray[np.void]) -> bytes:
    where = zip(spans["start"].tolist(), spans["size"].tolist(), strict=True)
    return b"".join([os.pread(file.fileno(), size, start) for start, size in where])
