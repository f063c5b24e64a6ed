"""A digest of all rows of a table, whatever its file's encoding, compression and row groups.

Each column is one or more streams of bytes: which values there are, the lengths of texts and lists,
and the values themselves, nulls as zeros. The digest is the SHA-256 of the names, types and units
of all columns, the SHA-256 of each of their streams, and the fields that all runs share. A copy
that only compresses otherwise has the same digest; any other value, order or column another one.
"""

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from contactlab.store.runs_table import GROUP, essential, shared_fields, table_errors


def rows_digest(path: Path) -> str:
    """Return the digest of all rows of a table's file.

    Raises:
        StoreError: there is none, or it is damaged.
    """
    with table_errors(path), pq.ParquetFile(path) as file:
        digest = RowsDigest(file.schema_arrow)
        for batch in file.iter_batches(GROUP):
            digest.add(batch)
    return digest.hexdigest


class RowsDigest:
    """Takes a table batch by batch.

    Args:
        schema: of the table, with its metadata.
    """

    def __init__(self, schema: pa.Schema) -> None:
        described = [[field.name, str(field.type), _texts(field)] for field in schema]
        self._head = json.dumps([described, shared_fields(schema)], sort_keys=True)
        self._streams: defaultdict[str, Any] = defaultdict(hashlib.sha256)

    def add(self, batch: pa.RecordBatch) -> None:
        """Take the next rows."""
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            for stream, data in _streams(name, column):
                self._streams[stream].update(data)

    @property
    def hexdigest(self) -> str:
        """The digest of all rows so far, in hex."""
        streams = {name: stream.hexdigest() for name, stream in self._streams.items()}
        return hashlib.sha256(
            (self._head + json.dumps(streams, sort_keys=True)).encode()
        ).hexdigest()


def _texts(field: pa.Field) -> dict[str, str]:
    return {key.decode(): text.decode() for key, text in essential(field).items()}


def _streams(name: str, column: pa.Array) -> Iterator[tuple[str, bytes | memoryview]]:
    """Yield the bytes of a column, each part with the name of its stream."""
    kind = column.type
    yield f"{name}?", np.asarray(column.is_valid()).data
    if pa.types.is_struct(kind):
        for field, inner in zip(kind, column.flatten(), strict=True):
            yield from _streams(f"{name}.{field.name}", inner)
    elif pa.types.is_list(kind):
        yield f"{name}#", _lengths(pc.call_function("list_value_length", [column]))
        yield from _streams(f"{name}[]", column.flatten())
    elif pa.types.is_string(kind):
        yield f"{name}#", _lengths(pc.call_function("binary_length", [column]))
        texts = column.drop_null().cast(pa.binary())
        whole = pa.ListArray.from_arrays(pa.array([0, len(texts)], pa.int32()), texts)
        yield f"{name}=", pc.call_function("binary_join", [whole, b""])[0].as_buffer()
    else:
        zero = pa.scalar(0).cast(kind)
        yield f"{name}=", column.fill_null(zero).to_numpy(zero_copy_only=False).data


def _lengths(lengths: pa.Array) -> memoryview:
    return lengths.fill_null(0).cast(pa.int64()).to_numpy(zero_copy_only=False).data
