"""Memory that is reused from run to run.

The system hands out fresh memory page by page, which takes longer than to fill a page; without
reuse a file costs one and a half times as much.
"""

import threading

import numpy as np
import zstandard
from numpy.typing import NDArray

# Matches of six bytes or more, by a table that fits the first cache: of level -3 it takes 0.7 (one
# body) to 0.85 (a stack) of the time for files of the same size. The window is a chunk's length.
_FAST = zstandard.ZstdCompressionParameters(
    strategy=zstandard.STRATEGY_FAST,
    window_log=20,
    hash_log=11,
    chain_log=6,
    search_log=1,
    min_match=6,
    target_length=3,
    write_checksum=True,
)


class Scratch(threading.local):
    """Buffers and a compressor, each thread its own."""

    def __init__(self) -> None:
        self._buffers: dict[str, NDArray[np.uint8]] = {}
        self.compressor = zstandard.ZstdCompressor(compression_params=_FAST)

    def take(self, name: str, size: int) -> NDArray[np.uint8]:
        """Return `size` bytes of any content; they hold until the name is taken again."""
        buffer = self._buffers.get(name)
        if buffer is None or len(buffer) < size:
            buffer = self._buffers[name] = np.empty(size, np.uint8)
        return buffer[:size]


SCRATCH = Scratch()
