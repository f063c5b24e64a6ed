"""Reads a finished store."""

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import RecordedControls
from contactlab.errors import StoreError, did_you_mean, optional
from contactlab.mjcf import is_condition
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.evidence import EvidenceRecord, StoreManifest, TraceFile
from contactlab.schema.sweep_schema import Sweep
from contactlab.schema.tradeoff_report import REALITY
from contactlab.schema.vocabulary import Role
from contactlab.store.arrow_values import numpy_array
from contactlab.store.atomic_files import sha256_of
from contactlab.store.backend import Backend
from contactlab.store.controls_file import read_controls
from contactlab.store.folder_backend import backend_at
from contactlab.store.run_columns import RunColumns
from contactlab.store.runs_table import (
    OUTCOME_COLUMNS,
    check_table_size,
    count_outcomes,
    digests_of,
    iterate_rows,
)
from contactlab.store.store_files import (
    IDENTITY,
    MANIFEST,
    SCENES,
    TABLE,
    Address,
    check_tree,
    parse_address,
    parse_manifest,
    stored_file,
    stored_sweep,
)
from contactlab.store.table_layout import row_to_record

if TYPE_CHECKING:
    from contactlab.store.mcap.trace_reader import StoredTrace

_SHOWN_COLUMNS = ("run_id", "label", "label_reason")
_StoreContent = TypeVar("_StoreContent")


@dataclass(frozen=True, repr=False)
class Runs:
    """Every run of a store as a row, in plan order.

    Libraries that read Arrow, such as polars, DuckDB and pandas, read it directly through the Arrow
    PyCapsule interface.
    """

    arrow: pa.Table  # the table; units and descriptions are in the metadata of its fields

    def to_pandas(self) -> Any:  # noqa: ANN401 - pandas is not a dependency
        """Return a pandas DataFrame. Raises an OutputError if pandas is not installed."""
        with optional("frames", "to_pandas()"):
            return self.arrow.to_pandas()

    def to_polars(self) -> Any:  # noqa: ANN401 - polars is not a dependency
        """Return a polars DataFrame. Raises an OutputError if polars is not installed."""
        with optional("frames", "to_polars()"):
            import polars as pl  # noqa: PLC0415 - is not a dependency
        return pl.from_arrow(self.arrow)

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        return self.arrow.__arrow_c_stream__(requested_schema)

    def __len__(self) -> int:
        return self.arrow.num_rows

    def __repr__(self) -> str:
        return f"<{len(self)} runs, {self.arrow.num_columns} columns>"

    def _repr_html_(self) -> str:
        max_shown_rows = 20  # a screen of a notebook
        rows = self.arrow.select(list(_SHOWN_COLUMNS)).slice(0, max_shown_rows).to_pylist()
        more = (
            f"<p>and {len(self) - max_shown_rows:,} more</p>" if len(self) > max_shown_rows else ""
        )
        return _html_table(_SHOWN_COLUMNS, (row.values() for row in rows)) + more


@dataclass(frozen=True, repr=False, eq=False)
class Store:
    """A finished store."""

    path: Path  # local folder with everything, except traces in object storage
    manifest: StoreManifest  # description of its content
    address: Address

    @classmethod
    def open(cls, address: str | Address) -> "Store":
        """Open a store; everything except its traces is fetched from object storage.

        The table is unchanged: it has the hash and the counts in the manifest. The address is a
        folder, or one in object storage: `s3://bucket/prefix`. Raises a StoreError if it does not
        exist, is unfinished, damaged or of another version.
        """
        store = cls.open_unchecked(address)
        table = stored_file(store.path, TABLE)
        if table is not None and sha256_of(table) != store.manifest.files.get(TABLE):
            raise StoreError(
                f"{store.address / TABLE} was changed since it was written; "
                f"`contactlab verify {store.address}` says more"
            )
        for miscount in store.find_miscounts():
            raise StoreError(f"{store.address / MANIFEST} is damaged: {miscount}")
        return store

    @classmethod
    def open_unchecked(cls, address: str | Address) -> "Store":
        """Open a store without checking its table; see `open`."""
        address = parse_address(address)
        backend = backend_at(address, StoreError)
        data = backend.read_file(MANIFEST)
        if data is None:
            names = backend.top_names()
            if not names:
                raise StoreError(
                    f"no store at {backend.address}{_address_suggestion(backend.address)}"
                )
            if IDENTITY in names:
                raise StoreError(
                    f"{backend.address} is unfinished; run its sweep again to resume it"
                )
            hint = _stores_inside(backend.address) or _WRITER_HINT
            raise StoreError(f"{backend.address} is not a store: it has no {MANIFEST}; {hint}")
        manifest = parse_manifest(data, address)
        store = cls(backend.local_copy(data, manifest.files), manifest, address)
        if table := stored_file(store.path, TABLE):
            check_table_size(table, manifest.runs)
        return store

    def find_miscounts(self) -> Iterator[str]:
        """Yield the counts of the manifest that no store has, or that differ from the table's."""
        if self.manifest.runs < 1:
            yield f"runs is {self.manifest.runs}, but a store has some"
        for name, count in count_outcomes(self.columns.iterate_batches(OUTCOME_COLUMNS)).items():
            if (stated_count := getattr(self.manifest, name)) != count:
                yield f"{name} is {stated_count}, but {TABLE} has {count}"

    @cached_property
    def backend(self) -> Backend:
        """The backend of its location."""
        return backend_at(self.address, StoreError)

    def __repr__(self) -> str:
        labels = ", ".join(f"{count} {label}" for label, count in self.manifest.labels.items())
        runs, scene = self.manifest.runs, self.manifest.sweep.scene
        return f"<store {self.address}: {runs} runs of {scene}: {labels}>"

    def _repr_html_(self) -> str:
        name, scene = escape(str(self.address)), escape(self.manifest.sweep.scene)
        head = f"<p><b>{name}</b>: {self.manifest.runs} runs of {scene}</p>"
        return head + _html_table(("label", "runs"), self.manifest.labels.items())

    def file(self, name: str) -> Path:
        """Return the local path of a file other than a trace.

        Raises a StoreError if it is missing.
        """
        path = stored_file(self.path, name)
        if path is None:
            raise StoreError(f"{self.address / name} is missing")
        return path

    @property
    def digest(self) -> str:
        """Digest that pins a store: SHA-256 of its manifest, which has the hashes of the rest."""
        return sha256_of(self.file(MANIFEST))

    @property
    def physics(self) -> str:
        """Digest of the computed results, without clocks; repeated computations have the same."""
        return self.manifest.physics or digests_of(self.file(TABLE)).physics

    @property
    def runs(self) -> Runs:
        """The table, for pandas, polars and others that read Arrow."""
        return Runs(self.table)

    @cached_property
    def table(self) -> pa.Table:
        """Every run as a row, in plan order; units are in the fields' metadata."""
        return self.columns.read_arrow()

    @cached_property
    def columns(self) -> RunColumns:
        """The same table by column, as NumPy arrays."""
        return RunColumns(self.path, self.address)

    @property
    def units(self) -> dict[str, str]:
        """The unit of every numeric column; `1` for counts and ratios."""
        return {name: column.unit for name, column in self.columns.described.items() if column.unit}

    @cached_property
    def sweep(self) -> Sweep:
        """The sweep that it has the runs of.

        Raises a StoreError if it is not one of this version.
        """
        return stored_sweep(self.manifest.sweep)

    @property
    def reported_roles(self) -> dict[str, Role]:
        """The role of each axis in reports, which recommend no value of a physical condition.

        A comparison with recordings seeks such values, so that axes keep the roles of the sweep.
        """
        roles, columns = self.sweep.roles, self.columns
        if REALITY in columns.metric_columns and columns.has_finite(REALITY):
            return roles
        return {name: "scenario" if is_condition(name) else role for name, role in roles.items()}

    @property
    def scene_folder(self) -> Path:
        """Local folder of the scene's files, none of them a link to another place."""
        check_tree(self.path / SCENES)
        return self.path / SCENES / self.manifest.sweep.scene_hash

    def records(self, chosen: NDArray[np.bool_] | None = None) -> Iterator[EvidenceRecord]:
        """Yield all records in plan order, or only the `chosen` ones (runs,).

        Raises a StoreError if the table is damaged.
        """
        for row in iterate_rows(self.file(TABLE), chosen):
            yield self._record_of(row)

    def records_at(self, rows: Sequence[int]) -> Iterator[EvidenceRecord]:
        """Yield the records of the runs in some rows, in table order; see `records`."""
        yield from map(self._record_of, self.columns.rows_at(rows))

    def record_at(self, row: int) -> EvidenceRecord:
        """Return the record of the run in a row; see `records`."""
        return self._record_of(self.columns.read_row(row))

    def _record_of(self, row: Mapping[str, Any]) -> EvidenceRecord:
        try:
            return row_to_record(row, self.columns.shared)
        except (LookupError, TypeError, ValueError) as error:
            raise StoreError(f"{self.address / TABLE} is damaged: {error}") from error

    def record(self, run: str) -> EvidenceRecord:
        """Return the record of a run by its id or a unique prefix of it.

        Raises a StoreError if no run or more than one has this id.
        """
        matches = [
            rows.start + place
            for rows, ids in self.columns.parts("run_id")
            for place in np.flatnonzero(numpy_array(_match_ids(ids, "starts_with", run))).tolist()
        ]
        if len(matches) == 0:
            hint = did_you_mean(run, similar_ids(run, self.columns.run_ids))
            raise StoreError(f"no run in {self.address} has an id that starts with '{run}'{hint}")
        if len(matches) > 1:
            some = ", ".join(map(self.columns.run_id, matches[:3]))
            raise StoreError(
                f"{len(matches)} runs in {self.address} have ids that start with '{run}' "
                f"({some}, ...); write more of it"
            )
        return self.record_at(matches[0])

    def controls(self, record: EvidenceRecord) -> RecordedControls | None:
        """Return the controls of a run's policy, None without one.

        Raises a StoreError if they are lost.
        """
        if record.controls is not None:
            return read_controls(self.backend, record.controls)
        if isinstance(record.drive, PolicyDrive):
            raise StoreError(
                f"run {record.run_id} has no recorded controls: {record.status_reason}; "
                "sweep again to run its policy"
            )
        return None

    def trace(self, run: EvidenceRecord | str) -> "StoredTrace":
        """Return the stored trace of a run by its record, its id, or a unique prefix of it.

        Raises a StoreError if there is no such run, its trace was not kept, or the trace is
        damaged.
        """
        from contactlab.store.mcap.trace_reader import read_trace  # noqa: PLC0415 - takes a while

        kept: dict[str, StoredTrace] | None = self.__dict__.get(_KEPT)
        record = self.record(run) if isinstance(run, str) else run
        if kept is None or record.trace is None:
            return self._read_trace(record, read_trace)
        if record.trace.sha256 not in kept:
            kept.clear()
            kept[record.trace.sha256] = self._read_trace(record, read_trace)
        return kept[record.trace.sha256]

    @contextmanager
    def keeping_trace(self) -> Generator[None]:
        """Keep the last trace that was read for the context. Do not change its arrays.

        The parts of a page read the same trace one after the other.
        """
        self.__dict__[_KEPT] = {}
        try:
            yield
        finally:
            del self.__dict__[_KEPT]

    def trace_messages(self, run: EvidenceRecord | str) -> bytes:
        """Return a run's trace as a file of messages, which viewers open; errors as in `trace`."""
        from contactlab.store.mcap.trace_reader import read_messages  # noqa: PLC0415 - takes a while

        return self._read_trace(run, read_messages)

    def _read_trace(
        self, run: EvidenceRecord | str, read_content: Callable[[Path, object], _StoreContent]
    ) -> _StoreContent:
        record = self.record(run) if isinstance(run, str) else run
        if record.trace is None:
            raise StoreError(
                f"no trace of run {record.run_id} was kept; sweep again with --set trace=all "
                "into another store"
            )
        if self.manifest.traces_left_out:
            raise StoreError(
                f"{self.address} is a baseline without traces; its sweep's store has them"
            )
        with self.trace_file(record.trace) as path:
            if sha256_of(path) != record.trace.sha256:
                raise StoreError(
                    f"{self.address / record.trace.file}: changed since it was written; repeat "
                    "the run"
                )
            return read_content(path, self.address / record.trace.file)

    @contextmanager
    def trace_file(self, trace: TraceFile) -> Generator[Path]:
        """Yield a local file with a trace, for the context.

        Raises a StoreError if it is missing.
        """
        with closing(self.backend.local_files([trace.file])) as files:
            path = next(files)
            if path is None:
                raise StoreError(f"{self.address / trace.file} is missing")
            yield path


def similar_ids(run: str, ids: pa.Array) -> list[str]:
    """Return at most 64 ids, however many there are, as candidates for a mistyped one.

    They share the longest possible prefix or suffix with it.
    """
    similar: list[str] = []
    lengths = range(1, len(run) + 1)
    max_similar = 32  # of each kind of likeness; a caller ranks them
    for function, parts in (
        ("starts_with", [run[:length] for length in lengths]),
        ("ends_with", [run[-length:] for length in lengths]),
    ):
        longest = ids[:0]
        for part in parts:
            # Ids that share a longer part are among those that share a shorter one.
            among = longest if len(longest) else ids
            matches = among.filter(_match_ids(among, function, part))
            if not len(matches):
                break
            longest = matches
        similar += longest[:max_similar].to_pylist()
    return similar


def _match_ids(ids: pa.Array, function: str, part: str) -> pa.BooleanArray:
    return pc.call_function(function, [ids], pc.MatchSubstringOptions(part))


_KEPT = "_kept_trace"
_WRITER_HINT = "`contactlab sweep` writes one"


def _stores_inside(address: Address, most: int = 3) -> str:
    if not isinstance(address, Path):
        return ""
    inside = sorted(
        place.parent for pattern in ("*", "*/*") for place in address.glob(f"{pattern}/{MANIFEST}")
    )
    more = f" and {len(inside) - most} more" if len(inside) > most else ""
    return f"stores in it: {', '.join(map(str, inside[:most]))}{more}" if inside else ""


def _address_suggestion(address: Address) -> str:
    if not isinstance(address, Path) or not address.parent.is_dir():
        return f"; {_WRITER_HINT}"
    if address.is_file():
        return f", which is a file; a store is a folder: {_WRITER_HINT}"
    stores = [folder.parent.name for folder in address.parent.glob(f"*/{MANIFEST}")]
    return did_you_mean(address.name, stores) or f"; {_WRITER_HINT}"


def _html_table(header: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    return (
        f"<table>{_html_row('th', header)}{''.join(_html_row('td', row) for row in rows)}</table>"
    )


def _html_row(tag: str, cells: Iterable[object]) -> str:
    return f"<tr>{''.join(f'<{tag}>{escape(str(cell))}</{tag}>' for cell in cells)}</tr>"
