"""Which runs of an interrupted or damaged store are kept, and which are run again."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from contactlab.schema.evidence import RECORD_VERSION, EvidenceRecord, Status, SweepIdentity
from contactlab.store.backend_protocol import Backend
from contactlab.store.bound_trace import trace_problems
from contactlab.store.controls_file import has_controls
from contactlab.store.row_journal import FAILED_STATUSES, Row
from contactlab.store.table_layout import row_to_record

IsPlanned = Callable[[str, int], bool]


class _RowHead(BaseModel):
    """What of a row is read before the table is written."""

    model_config = ConfigDict(strict=True, extra="ignore")

    run_id: Annotated[str, Field(pattern="^[0-9a-f]{16}$")]
    index: Annotated[int, Field(ge=0)]
    scene_hash: str
    label: str
    status: Status
    trace_file: Annotated[str, Field(pattern=r"^traces/[0-9a-f]{2}/[0-9a-f]{16}\.mcap$")] | None
    trace_sha256: str | None
    trace_bytes: int | None


@dataclass(frozen=True)
class ResumedRows:
    """Checks the rows that a store holds already.

    Attributes:
        backend: where their traces are.
        identity: the sweep that they must be of.
        is_planned: whether a run of this id is at this place of the plan.
        retry_failed: whether failed runs are removed.
        repair: whether runs whose evidence contradicts itself are removed.
    """

    backend: Backend
    identity: SweepIdentity
    is_planned: IsPlanned
    retry_failed: bool
    repair: bool

    def check(self, row: Row, is_sealed: bool) -> None:
        """Check that a row is one of this sweep.

        Args:
            row: the row.
            is_sealed: whether it has a checksum; without one, every column is checked.

        Raises:
            ValueError: it is not; the message says why.
        """
        try:
            head = _RowHead.model_validate(row)
            if self.repair or not is_sealed:
                self._record(row)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise ValueError(f"is no row of a run: {where}: {first['msg']}") from error
        except (LookupError, TypeError) as error:
            raise ValueError(f"is no row of a run: it lacks {error}") from error
        if not self.is_planned(head.run_id, head.index):
            raise ValueError(f"holds run {head.run_id}, which is not run {head.index} of the plan")
        if head.scene_hash != self.identity.scene_hash:
            raise ValueError(
                f"holds run {head.run_id} of scene {head.scene_hash}, not of this sweep's, "
                f"{self.identity.scene_hash}"
            )

    def keeps(self, row: Row) -> bool:
        """Return whether a run stays: it need not be retried, and what it names is as written.

        Raises:
            OutputError: the trace of a run that is to be retried cannot be removed.
        """
        name = row["trace_file"]
        if self.retry_failed and row["status"] in FAILED_STATUSES:
            self.backend.delete([name] if name else [])
            return False
        if row.get("controls") and not has_controls(self.backend, row["controls"]):
            return False
        if name is None:
            return True
        if not self.backend.holds_trace(name, row["trace_bytes"], row["trace_sha256"]):
            return False
        return not (self.repair and self._contradicts(row, name))

    def _contradicts(self, row: Row, name: str) -> bool:
        record = self._record(row)
        with closing(self.backend.trace_files([name])) as files:
            path = next(files)
            return path is None or any(trace_problems(path, record, but=("units",)))

    def _record(self, row: Row) -> EvidenceRecord:
        versions = self.identity.metric_versions
        return row_to_record(
            row,
            {
                "schema_version": RECORD_VERSION,
                "sweep": self.identity.name,
                "units": dict.fromkeys(versions, ""),
                "metric_versions": versions,
            },
        )
