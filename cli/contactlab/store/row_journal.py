"""The journal of an unfinished store: one row per line, appended as runs finish.

Each line ends with a checksum, like each frame of a write-ahead log. A process killed during a
write leaves an incomplete last line, which is dropped on resuming; any other damage is reported.
Fields shared by the rows of a job are on a line before them, which they name by its checksum. Rows
of another sweep are reported, too; runs that are not stored as written are run again. Results of
later passes go to notes next to the journal until the store is finished.
"""

import itertools
import json
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, cast

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import from_json

from contactlab.errors import StoreError
from contactlab.schema.evidence import RECORD_VERSION, EvidenceRecord, Status, SweepIdentity
from contactlab.store.atomic_files import atomic_write
from contactlab.store.backend import Backend
from contactlab.store.controls_file import has_controls
from contactlab.store.store_files import JOURNAL
from contactlab.store.table_layout import FIXED_COLUMNS, row_to_record

FAILED_STATUSES = frozenset({"crashed", "error", "timeout"})

Row = Mapping[str, Any]
IsPlanned = Callable[[str, int], bool]

_CHECKSUM_FORMAT = b"\t%08x\n"
SEAL_SIZE = 10  # number of bytes of the checksum at the end of a line
SHARED = b"shared"


def with_checksum(row: bytes) -> bytes:
    """Return a row as a line: its JSON, a tab, its CRC-32 as 8 hex digits, the line end."""
    return row + _CHECKSUM_FORMAT % zlib.crc32(row)


def encode_lines(rows: Iterable[bytes], shared: bytes) -> list[bytes]:
    """Return rows as lines, after a line with their shared fields, if any."""
    if not shared:
        return [with_checksum(row) for row in rows]
    first = with_checksum(shared + b"\t" + SHARED)
    return [first, *(with_checksum(row + first[-SEAL_SIZE:-1]) for row in rows)]


def row_extent(line: bytes) -> tuple[int, bytes]:
    """Return the number of bytes of the row in a whole line, and the name of its shared fields.

    The name is `SHARED` for the line with the shared fields, and empty for a row without any.
    """
    size = line.find(b"\t")
    return size, line[size + 1 : -SEAL_SIZE]


def parse_line(line: bytes) -> dict[str, Any]:
    """Return the row's own fields in a whole line. Raises a ValueError that describes damage."""
    if line != with_checksum(line[:-SEAL_SIZE]):
        raise ValueError("does not match its checksum")
    try:
        content = from_json(line[: row_extent(line)[0]])
    except ValueError as error:
        raise ValueError("is not JSON") from error
    if not isinstance(content, dict):
        raise ValueError("is not a JSON object")
    return cast("dict[str, Any]", content)


class _LineReader:
    """Reads the lines of a journal in their order, and checks rows; see `mend_journal`."""

    def __init__(self, check: Callable[[Row], None] = lambda _: None) -> None:
        self._check, self._name, self._shared = check, b"", dict[str, Any]()

    def parse_row(self, line: bytes) -> dict[str, Any] | None:
        """Return the row of a whole line, None for a line of shared fields; see `parsed`."""
        row, name = parse_line(line), row_extent(line)[1]
        if name == SHARED:
            self._name, self._shared = line[1 - SEAL_SIZE : -1], row
            return None
        if name not in (b"", self._name):
            raise ValueError("refers to shared fields that are not in an earlier line")
        row = {**self._shared, **row} if name else row
        self._check(row)
        return row


def repair_journal(
    folder: Path,
    check: Callable[[Row], None],
    is_complete: Callable[[Row], bool],
    *,
    repair: bool = False,
    shown_path: object = None,
) -> frozenset[str]:
    """Drop incomplete or repeated lines, and those of runs that are not stored completely.

    Returns the ids of the remaining runs. The check of a row raises a ValueError if it does not
    belong there. With `repair`, damaged lines are dropped, too. Errors name the journal by the
    shown path. Raises a StoreError if a line is damaged, unless it is the last, which a killed
    process leaves incomplete; an OutputError if the journal cannot be rewritten.
    """
    path = folder / JOURNAL
    if not path.is_file():
        return frozenset()
    kept_ids: set[str] = set()
    good = bytearray()
    reader = _LineReader(check)
    with path.open("rb") as lines:
        for number, line in enumerate(lines, 1):
            good.append(False)
            if not line.endswith(b"\n"):
                break
            try:
                row = reader.parse_row(line)
            except ValueError as error:
                if repair:
                    continue
                raise StoreError(
                    f"{shown_path or path}, line {number} {error}; add --repair to keep the valid "
                    "runs and run the others again"
                ) from error
            good[-1] = row is None or (row["run_id"] not in kept_ids and is_complete(row))
            if row and good[-1]:
                kept_ids.add(row["run_id"])
    if not all(good):
        with (
            path.open("rb") as stored,
            atomic_write(path, durable=True) as temporary,
            temporary.open("wb") as repaired,
        ):
            repaired.writelines(itertools.compress(stored, good))
    return frozenset(kept_ids)


def end_torn_line(path: Path) -> None:
    """End the last line of a file if it is incomplete, so that the next line stays separate."""
    if path.is_file() and not path.read_bytes().endswith(b"\n"):
        with path.open("ab") as lines:
            lines.write(b"\n")


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the valid rows of a journal or of notes; empty if the file does not exist."""
    if not path.is_file():
        return
    reader = _LineReader()
    with path.open("rb") as lines:
        for line in lines:
            with suppress(ValueError):
                if (row := reader.parse_row(line)) is not None:
                    yield row


def amend_journal(folder: Path, amendments: Mapping[str, Row]) -> None:
    """Set columns of rows that are already in the journal, by run id and column."""
    if amendments:
        path = folder / JOURNAL
        rows = (row | dict(amendments.get(row["run_id"], {})) for row in read_lines(path))
        write_journal(path, rows)


def write_journal(path: Path, rows: Iterable[Row]) -> None:
    """Replace all rows of a journal atomically; the new ones may come from the journal itself."""
    with atomic_write(path, durable=True) as temporary, temporary.open("wb") as lines:
        lines.writelines(with_checksum(json.dumps(row).encode()) for row in rows)


class _RowHead(BaseModel):
    """Fields of a row that are read before the table is written."""

    model_config = ConfigDict(strict=True, extra="ignore")

    run_id: Annotated[str, Field(pattern="^[0-9a-f]{16}$")]
    index: Annotated[int, Field(ge=0)]
    scene_hash: str
    label: str
    status: Status
    trace_file: str | None = Field(None, pattern=r"^traces/[0-9a-f]{2}/[0-9a-f]{16}\.mcap$")
    trace_sha256: str | None = None
    trace_bytes: int | None = None


@dataclass(frozen=True)
class ResumedRows:
    """Checks the rows of a sweep that are already in its store."""

    backend: Backend
    identity: SweepIdentity
    is_planned: IsPlanned  # whether a run with this id is at this index of the plan
    retry_failed: bool  # whether failed runs are removed
    repair: bool  # whether runs with contradictory evidence are removed

    def check_row(self, row: Row) -> None:
        """Check that a row belongs to this sweep, with `repair` completely. Raises a ValueError."""
        try:
            head = _RowHead.model_validate(row)
            if self.repair:
                self._build_record(row)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise ValueError(f"is not a valid run record: {where}: {first['msg']}") from error
        except (LookupError, TypeError) as error:
            raise ValueError(f"is not a valid run record: it lacks {error}") from error
        if not self.is_planned(head.run_id, head.index):
            raise ValueError(f"holds run {head.run_id}, which is not run {head.index} of the plan")
        if head.scene_hash != self.identity.scene_hash:
            raise ValueError(
                f"holds run {head.run_id} of scene {head.scene_hash}, but the scene of this sweep "
                f"is {self.identity.scene_hash}"
            )

    def keeps_run(self, row: Row) -> bool:
        """Return whether a run stays: it need not be retried, and its files are unchanged."""
        name = row.get("trace_file")
        if self.retry_failed and row["status"] in FAILED_STATUSES:
            self.backend.delete_files([name] if name else [])
            return False
        if row.get("controls") and not has_controls(self.backend, row["controls"]):
            return False
        if name is None:
            return True
        if not self.backend.holds_trace(name, row["trace_bytes"], row["trace_sha256"]):
            return False
        return not (self.repair and self._contradicts_trace(row, name))

    def _contradicts_trace(self, row: Row, name: str) -> bool:
        from contactlab.store.mcap.trace_reader import trace_problems  # noqa: PLC0415 - takes a while

        record = self._build_record(row)
        with closing(self.backend.local_files([name])) as files:
            path = next(files)
            return path is None or any(trace_problems(path, record, but=("units",)))

    def _build_record(self, row: Row) -> EvidenceRecord:
        versions = self.identity.metric_versions
        absent = dict.fromkeys([*(column.name for column in FIXED_COLUMNS), *versions])
        return row_to_record(
            {**absent, **row},
            {
                "schema_version": RECORD_VERSION,
                "sweep": self.identity.name,
                "units": dict.fromkeys(versions, ""),
                "metric_versions": versions,
            },
        )
