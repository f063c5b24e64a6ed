"""Recorded controls in a store: one Arrow file for each content, named after its hash.

Its columns are `time` and the actuators, so that it can also drive other runs.
"""

import io
from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from contactlab.contact.recorded_controls import RecordedControls
from contactlab.errors import StoreError
from contactlab.store.backend_protocol import CONTROLS, Backend


def controls_name(sha256: str) -> str:
    """Return the name of the file, relative to the store."""
    return f"{CONTROLS}/{sha256}.arrow"


def encode_controls(controls: RecordedControls, actuators: Sequence[str]) -> bytes:
    """Return controls as an Arrow file, which is made in a quarter of the time of Parquet.

    Args:
        controls: the controls.
        actuators: (nu) the actuators' names.
    """
    columns = [pa.array(controls.times), *map(pa.array, controls.levels.T)]
    file = io.BytesIO()
    table = pa.table(columns, names=["time", *actuators])
    with pa.ipc.new_file(file, table.schema) as writer:
        writer.write_table(table)
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
        time, *levels = (column.to_numpy() for column in pa.ipc.open_file(data).read_all().columns)
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
