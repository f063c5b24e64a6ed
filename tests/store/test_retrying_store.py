"""Failed runs are taken out of a store; the others stay as they are, wherever it is interrupted."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from pydantic_core import to_json

from contactlab.errors import StoreError
from contactlab.schema.evidence import EvidenceRecord, LabelEntry, StoreManifest
from contactlab.store.finished_store import Store
from contactlab.store.row_journal import read_lines, write_journal
from contactlab.store.store_writer import StoreWriter, open_writer
from contactlab.store.table_layout import record_to_row
from contactlab.store.verify_store import find_problems, write_baseline

STATUSES = ("ok", "crashed", "error", "stopped", "timeout", "ok")
FAILED, KEPT = {1, 2, 4}, {0, 3, 5}


@pytest.fixture
def records(record_of: Callable[..., EvidenceRecord]) -> list[EvidenceRecord]:
    reasons = [None if status == "ok" else "the engine says why" for status in STATUSES]
    ends = zip(STATUSES, reasons, strict=True)
    found = [record_of(i, status=end, status_reason=why) for i, (end, why) in enumerate(ends)]
    return [_without_results(each) if each.status in _LOST else each for each in found]


_LOST = ("crashed", "timeout")


def _without_results(record: EvidenceRecord) -> EvidenceRecord:
    reason = LabelEntry(label=record.status, reason="it ended", step=None)
    nothing = {"metrics": dict.fromkeys(record.metrics), "steps": 0, "trajectory_hash": None}
    labels = {"label": record.status, "labels": (reason,), "cost": None}
    return record.model_copy(update={**nothing, **labels})


@pytest.fixture
def failed(tmp_path: Path, records: list[EvidenceRecord], store_of: Any) -> Path:
    """A finished store with runs that went through and runs that did not."""
    store_of(tmp_path / "failed", records)
    return tmp_path / "failed"


@pytest.fixture
def retry(identity_of: Any, scene_file: Any) -> Callable[..., Any]:
    """Open a store to retry its failed runs."""

    def opened(store: Path, runs: int = len(STATUSES), *, retry_failed: bool = True) -> Any:
        identity = identity_of(runs)
        return open_writer(store, identity, scene_file, fresh=False, retry_failed=retry_failed)

    return opened


@pytest.fixture
def finish(columns_of: Any, shared_part: Any, write_run_to: Any) -> Callable[..., StoreManifest]:
    """Add runs to a store, and finish it."""

    def finished(writer: StoreWriter, added: list[EvidenceRecord]) -> StoreManifest:
        writer.append_rows(
            [
                to_json(
                    record_to_row(each if each.status in _LOST else write_run_to(writer.path, each))
                )
                for each in added
            ]
        )
        first = added[0]
        return writer.finish_store(columns_of(added), shared_part(first), first.provenance)

    return finished


def ids(places: set[int]) -> set[str]:
    return {f"{place:016x}" for place in places}


def traces(store: Path) -> set[str]:
    return {path.stem for path in store.rglob("*.mcap")}


def touched(store: Path) -> dict[Path, tuple[int, int]]:
    files = (path for path in store.rglob("*") if path.is_file() and path.name != ".lock")
    return {path: (path.stat().st_mtime_ns, path.stat().st_ino) for path in files}


def test_nothing_is_touched_if_nothing_failed(store: Path, retry: Any) -> None:
    before = touched(store)
    with retry(store, 3) as finished:
        assert isinstance(finished, StoreManifest)
    assert touched(store) == before
    assert find_problems(store) == []


def test_failed_runs_are_run_again(
    failed: Path,
    tmp_path: Path,
    records: list[EvidenceRecord],
    retry: Any,
    store_of: Any,
    finish: Any,
    record_of: Any,
) -> None:
    mended = [record_of(place) for place in range(len(records))]
    with retry(failed) as writer:
        assert writer.done == ids(KEPT)
        assert traces(failed) == ids(KEPT)
        manifest = finish(writer, [mended[place] for place in FAILED])
    assert manifest.statuses == {"ok": 5, "stopped": 1}
    assert find_problems(failed) == []
    kept = [records[place] if place in KEPT else mended[place] for place in range(len(records))]
    store_of(tmp_path / "plain", kept)
    plain, found = (pq.read_table(path / "runs.parquet") for path in (tmp_path / "plain", failed))
    # The fields that all runs share hold the times of the sweep.
    found, plain = (each.replace_schema_metadata() for each in (found, plain))
    assert found.equals(plain, check_metadata=True)


@pytest.mark.parametrize("reopened", [True, False])
def test_an_unfinished_store_loses_its_failed_runs(
    failed: Path, retry: Any, reopened: bool
) -> None:
    if reopened:
        with retry(failed):
            pass
    else:
        unfinish(failed, retry)
    with retry(failed) as writer:
        assert writer.done == ids(KEPT)
    assert {row["run_id"] for row in read_lines(failed / "journal.jsonl")} == ids(KEPT)
    assert traces(failed) == ids(KEPT)


def unfinish(store: Path, retry: Any) -> None:
    """Have a store look as if its sweep had been stopped just before its end."""
    rows = pq.read_table(store / "runs.parquet").to_pylist()
    (store / "manifest.json").unlink()
    write_journal(store / "journal.jsonl", rows)
    with retry(store, retry_failed=False) as writer:
        assert writer.done == ids(KEPT | FAILED)


class StopError(BaseException):
    """Ends a process that changes files."""


def test_it_may_be_stopped_before_any_change(
    failed: Path, retry: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever was done before, the store is whole, or lacks runs that will be run."""
    unlink, replace = Path.unlink, Path.replace
    for changes in range(100):
        left = iter(range(changes))

        def guard(change: Any, left: Any = left) -> Any:
            def guarded(*args: Any, **kwargs: Any) -> Any:
                if next(left, None) is None:
                    raise StopError
                return change(*args, **kwargs)

            return guarded

        with monkeypatch.context() as patch:
            patch.setattr(Path, "unlink", guard(unlink))
            patch.setattr(Path, "replace", guard(replace))
            try:
                with retry(failed) as writer:
                    assert writer.done == ids(KEPT)
                    assert changes > 4
                    break
            except StopError:
                pass
        with retry(failed, retry_failed=False) as found:
            if isinstance(found, StoreManifest):
                assert find_problems(failed) == []
                assert Store.open(failed).table.num_rows == len(STATUSES)
            else:
                assert ids(KEPT) <= found.done
                assert traces(failed) <= found.done
    else:
        pytest.fail("it never comes to an end")
    assert traces(failed) == ids(KEPT)


def test_a_baseline_is_not_run_again(failed: Path, tmp_path: Path, retry: Any) -> None:
    write_baseline(failed, tmp_path / "baseline")
    before = touched(tmp_path / "baseline")
    with (
        pytest.raises(StoreError, match="is a baseline without traces; sweep again elsewhere"),
        retry(tmp_path / "baseline"),
    ):
        pass
    assert touched(tmp_path / "baseline") == before


def test_another_sweeps_store_stays(failed: Path, retry: Any) -> None:
    before = touched(failed)
    with pytest.raises(StoreError, match="holds another sweep"), retry(failed, 9):
        pass
    assert touched(failed) == before
