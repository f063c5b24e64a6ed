"""Access to a store: the backend of its address, and what workers need."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from contactlab.contact.trace_arrays import PairSeries, RecordedControls, Trace
from contactlab.errors import ContactlabError, OutputError, optional
from contactlab.schema.evidence import TraceFile
from contactlab.store.controls_file import controls_name, encode_controls
from contactlab.store.folder_backend import Backend, FolderBackend
from contactlab.store.mcap.trace_writer import TraceExtras, encode_trace
from contactlab.store.store_address import Address
from contactlab.store.store_files import SCENES, TRACES


def backend_at(address: Address, error: type[ContactlabError]) -> Backend:
    """Return the backend of a store; make it in the process that uses it.

    Errors of object storage and of reading are of the given class.
    """
    if isinstance(address, Path):
        return FolderBackend(address, error)
    with optional("objects", f"a store at {address.scheme}://"):
        from contactlab.store.object_backend import ObjectBackend  # noqa: PLC0415 - an extra
    return ObjectBackend(address, error)


class TraceSink:
    """Adds traces and recorded controls to a store; make it in the process that uses it.

    An OutputError says that the store cannot be reached or written.
    """

    def __init__(self, store: Address) -> None:
        self._backend = backend_at(store, OutputError)
        self._controls: set[str] = set()

    def add(
        self, run_id: str, trace: Trace, row: int, series: Sequence[PairSeries], extras: TraceExtras
    ) -> TraceFile:
        """Store the trace of a run; it is in the store when this returns; see `encode_trace`."""
        name = _trace_name(run_id)
        content, messages = encode_trace(trace, row, series, extras)
        self._backend.put(name, content)
        sha256 = hashlib.sha256(content).hexdigest()
        return TraceFile(file=name, sha256=sha256, bytes=len(content), messages=dict(messages))

    def add_controls(self, controls: RecordedControls, actuators: Sequence[str]) -> str:
        """Store what a policy did to (nu) named actuators, unless it is there; return its hash."""
        sha256 = controls.sha256
        if sha256 not in self._controls:
            self._backend.put(controls_name(sha256), encode_controls(controls, actuators))
            self._controls.add(sha256)
        return sha256

    def remove(self, run_id: str) -> None:
        """Remove the trace of a run, if there is one."""
        self._backend.delete([_trace_name(run_id)])


def local_scene(store: Address, folder: Path) -> Path:
    """Return a local folder with a store's scene, fetched from object storage if need be.

    The given one is on the machine that runs the sweep; its name is the scene's hash.
    """
    if folder.is_dir():
        return folder
    return backend_at(store, OutputError).local_folder(SCENES) / folder.name


def _trace_name(run_id: str) -> str:
    return f"{TRACES}/{run_id[:2]}/{run_id}.mcap"
