"""The recorded controls of a store: one Arrow file for each content, named after its hash.

Its columns are `time` and the actuators, so that it can also drive other runs.
"""

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from contactlab.contact.trace_arrays import RecordedControls
from contactlab.errors import StoreError
from contactlab.store.backend import Backend
from contactlab.store.store_files import CONTROLS


def controls_name(sha256: str) -> str:
    """Return the name of the file, relative to the store."""
    return f"{CONTROLS}/{sha256}.arrow"


def encode_controls(controls: RecordedControls, actuators: Sequence[str]) -> bytes:
    """Return the controls of (nu) named actuators as an Arrow file.

    It is made in a tenth of the time of Parquet.
    """
    columns = controls.times, *np.ascontiguousarray(controls.levels.T)
    batch = pa.record_batch([*columns], names=["time", *actuators])
    file = pa.BufferOutputStream()
    with pa.ipc.new_file(file, batch.schema) as writer:
        writer.write_batch(batch)
    return file.getvalue().to_pybytes()


def read_controls(backend: Backend, sha256: str) -> RecordedControls:
    """Return stored controls; raise StoreError if they are missing or not what they were."""
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
