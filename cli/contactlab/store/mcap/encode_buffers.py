"""Buffers and a compressor that encoding reuses."""

import threading

import numpy as np
import zstandard
from numpy.typing import NDArray


class Scratch(threading.local):
    """Buffers and a compressor that a thread reuses from run to run.

    The system provides fresh memory page by page, which takes longer than filling the page; without
    reuse, encoding a file takes one and a half times as long.
    """

    def __init__(self) -> None:
        self._buffers: dict[str, NDArray[np.uint8]] = {}
        # Matches of at least six bytes, found by a table that fits the L1 cache: files of the same
        # size as at level -3 in 0.7 (one body) to 0.85 (a stack) of the time. The window is a
        # chunk's length.
        fast_compression = zstandard.ZstdCompressionParameters(
            strategy=zstandard.STRATEGY_FAST,
            window_log=20,
            hash_log=11,
            chain_log=6,
            search_log=1,
            min_match=6,
            target_length=3,
            write_checksum=True,
        )
        self.compressor = zstandard.ZstdCompressor(compression_params=fast_compression)

    def take_buffer(self, name: str, size: int) -> NDArray[np.uint8]:
        """Return `size` bytes of arbitrary content, valid until the name is taken again."""
        buffer = self._buffers.get(name)
        if buffer is None or len(buffer) < size:
            buffer = self._buffers[name] = np.empty(size, np.uint8)
        return buffer[:size]

    def drop_buffers(self) -> None:
        """Free all buffers, after a run that is much longer than others."""
        self._buffers.clear()


SCRATCH = Scratch()
