"""Recorded controls in a store: one Parquet file for each content, named after its hash.

Its columns are `time` and the actuators, so that it can also drive other runs.
"""

import io
from collections.abc import Sequence

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from contactlab.contact.recorded_controls import RecordedControls
from contactlab.errors import StoreError
from contactlab.store.backend_protocol import CONTROLS, Backend


def controls_name(sha256: str) -> str:
    """Return the name of the file, relative to the store."""
    return f"{CONTROLS}/{sha256[:2]}/{sha256}.parquet"


def encode_controls(controls: RecordedControls, actuators: Sequence[str]) -> bytes:
    """Return controls as a Parquet file.

    Args:
        controls: the controls.
        actuators: (nu) the actuators' names.
    """
    columns = [pa.array(controls.times), *map(pa.array, controls.levels.T)]
    file = io.BytesIO()
    pq.write_table(pa.table(columns, names=["time", *actuators]), file, compression="zstd")
    return file.getvalue()


def read_controls(backend: Backend, sha256: str) -> RecordedControls:
    """Return stored controls.

    Raises:
        StoreError: they are missing, or not what they were.
    """
    name = controls_name(sha256)
    data = backend.read(name)
    if data is None:
        raise StoreError(f"{backend.address / name} is missing")
    try:
        time, *levels = (column.to_numpy() for column in pq.read_table(io.BytesIO(data)).columns)
        controls = RecordedControls(time, np.array(levels).T)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise StoreError(f"{backend.address / name} is damaged: {error}") from error
    if controls.sha256 != sha256:
        raise StoreError(f"{backend.address / name} changed since it was written")
    return controls


def has_controls(backend: Backend, sha256: str) -> bool:
    """Return whether controls are stored, as they were written."""
    try:
        read_controls(backend, sha256)
    except StoreError:
        return False
    return True
