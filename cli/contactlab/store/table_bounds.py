"""Sizes of tables in compressed files, read from their headers before anything is unpacked."""

import struct
import zipfile
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

_ARROW_MAGIC = b"ARROW1\0\0"


def check_extent(size: int, most: int = 1 << 30) -> None:
    """Raise a ValueError for a size in bytes that no table has.

    By default, the limit is 1 GiB: thirty controls for a million steps take a quarter of it.
    """
    if size > most:
        raise ValueError(f"its header declares {size:,} bytes, more than {most:,}")


def check_archive(path: Path) -> None:
    """Check the unpacked size of the arrays of an .npz file; see `check_extent`."""
    with zipfile.ZipFile(path) as archive:
        check_extent(sum(each.file_size for each in archive.infolist()))


def check_parquet(path: Path) -> None:
    """Check the unpacked size of a Parquet file; see `check_extent`."""
    meta = pq.read_metadata(path)
    groups = (meta.row_group(group) for group in range(meta.num_row_groups))
    check_extent(sum(group.total_byte_size for group in groups))
    # Repeated values take no bytes in the file, but in memory.
    check_extent(8 * meta.num_rows * meta.num_columns)


def check_arrow(data: pa.Buffer) -> None:
    """Check the unpacked size of an Arrow file's numbers; see `check_extent`."""
    if data.slice(0, len(_ARROW_MAGIC)).to_pybytes() != _ARROW_MAGIC:
        raise ValueError("not an Arrow file")
    messages = pa.ipc.MessageReader.open_stream(data.slice(len(_ARROW_MAGIC)))
    size = 0
    while True:
        try:
            message = messages.read_next_message()
        except (StopIteration, EOFError):
            return
        if message.type in {"record batch", "dictionary"}:
            size += _count_numbers(message.metadata.to_pybytes())
            check_extent(8 * size)


def _count_numbers(metadata: bytes) -> int:
    # A message is a table of FlatBuffers: its header, field 2, is a batch with its length, field 0,
    # and its columns, field 1. A dictionary has a batch as field 1.
    root = struct.unpack_from("<I", metadata)[0]
    kind = metadata[_find_field(metadata, root, 1)]
    batch = _follow_offset(metadata, _find_field(metadata, root, 2))
    if kind == 2:
        batch = _follow_offset(metadata, _find_field(metadata, batch, 1))
    length = _find_field(metadata, batch, 0)
    columns = _find_field(metadata, batch, 1)
    if not length or not columns:
        return 0
    (rows,) = struct.unpack_from("<q", metadata, length)
    (nodes,) = struct.unpack_from("<I", metadata, _follow_offset(metadata, columns))
    if rows < 0:
        raise ValueError("a batch has fewer than no rows")
    return rows * nodes


def _find_field(metadata: bytes, table: int, number: int) -> int:
    # The place of a field in a table; 0 if it is left out.
    fields = table - struct.unpack_from("<i", metadata, table)[0]
    (size,) = struct.unpack_from("<H", metadata, fields)
    place = 4 + 2 * number
    offset = struct.unpack_from("<H", metadata, fields + place)[0] if place < size else 0
    return table + offset if offset else 0


def _follow_offset(metadata: bytes, place: int) -> int:
    return place + struct.unpack_from("<I", metadata, place)[0]
