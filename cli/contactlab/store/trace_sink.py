"""Where the traces of a store's runs go, from whichever process has them."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

from contactlab.contact import PairSeries, Trace
from contactlab.errors import OutputError
from contactlab.schema import TraceFile
from contactlab.store.atomic_files import write_error
from contactlab.store.mcap import TraceExtras, write_trace
from contactlab.store.objects import connect
from contactlab.store.store_address import Address, ObjectAddress
from contactlab.store.store_writer import TRACES


class TraceSink:
    """The traces of a store, to be added to; make it in the process that adds.

    Args:
        store: where the store is.

    Raises:
        OutputError: it cannot be reached.
    """

    def __init__(self, store: Address) -> None:
        self._store = store
        self._client = connect(store, OutputError) if isinstance(store, ObjectAddress) else None
        self._made: set[Path] = set()

    def add(
        self, run_id: str, trace: Trace, row: int, series: Sequence[PairSeries], extras: TraceExtras
    ) -> TraceFile:
        """Write a run's trace; it is in the store when this returns.

        Args:
            run_id: the run.
            trace: arrays of a group of runs.
            row: which of them to write.
            series: net quantities of the trace's pairs, in the same order.
            extras: the run's record, identity and model.

        Raises:
            OutputError: it cannot be written.
        """
        file = _file(run_id)
        if self._client is None:
            summary = write_trace(self._place(file), trace, row, series, extras)
        else:
            buffer = BytesIO()
            summary = write_trace(buffer, trace, row, series, extras)
            self._client.put(file, buffer.getbuffer())
        return TraceFile(
            file=file,
            sha256=summary.sha256,
            bytes=summary.size,
            messages=dict(summary.messages),
        )

    def remove(self, run_id: str) -> None:
        """Remove a run's trace, if there is one.

        Raises:
            OutputError: it cannot be removed.
        """
        if self._client is not None:
            self._client.delete([_file(run_id)])
            return
        assert isinstance(self._store, Path)
        try:
            (self._store / _file(run_id)).unlink(missing_ok=True)
        except OSError as error:
            raise write_error(self._store / _file(run_id), error) from error

    def _place(self, file: str) -> Path:
        """Return a file's path in a folder that exists; to ask the system each time costs much."""
        assert isinstance(self._store, Path)
        path = self._store / file
        if path.parent not in self._made:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._made.add(path.parent)
        return path


def _file(run_id: str) -> str:
    return f"{TRACES}/{run_id[:2]}/{run_id}.mcap"
