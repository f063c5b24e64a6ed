"""A sweep that was stopped anywhere goes on, and ends as one that was not."""

import json
import multiprocessing
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from contactlab.errors import StoreError
from contactlab.run import planned_runs
from contactlab.run.tasks import FinishedRun
from contactlab.store import folder_backend
from contactlab.store.row_journal import parse_line
from contactlab.store.verify_store import find_problems

RUNS = 18


class StopError(Exception):
    """Ends a sweep from its progress callback."""


def stop_after(portions: int) -> Callable[[Sequence[FinishedRun]], None]:
    """Return a progress callback that gives up after so many portions."""
    left = iter(range(portions - 1))

    def progress(finished: Sequence[FinishedRun]) -> None:
        del finished
        if next(left, None) is None:
            raise StopError

    return progress


@pytest.fixture
def whole(sweeper: Any, ball: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """What comes of the sweep if nothing stops it; portions are of 2 runs."""
    monkeypatch.setattr(planned_runs, "MAX_RUNS", 2)
    sweeper.run(ball, "whole")
    return sweeper.outcome("whole")


@pytest.fixture
def half(sweeper: Any, ball: str, whole: Any) -> Path:
    """A store that was stopped after 4 of 9 portions."""
    del whole
    with pytest.raises(StopError):
        sweeper.run(ball, progress=stop_after(4))
    return sweeper.folder / "store"


@pytest.mark.night
@pytest.mark.parametrize(("portions", "workers"), [(1, 0), (5, 0), (9, 0), (5, 2)])
def test_stopped_by_an_error(
    sweeper: Any, ball: str, whole: Any, portions: int, workers: int
) -> None:
    with pytest.raises(StopError):
        sweeper.run(ball, workers=workers, progress=stop_after(portions))
    assert multiprocessing.active_children() == []
    assert not (sweeper.folder / "store" / "manifest.json").exists()
    sweeper.run(ball, workers=workers)
    assert sweeper.began == [(RUNS, 2 * portions)]
    assert sweeper.outcome() == whole
    assert find_problems(sweeper.folder / "store") == []


@pytest.mark.long
def test_stopped_again_and_again(sweeper: Any, ball: str, whole: Any) -> None:
    for _ in range(8):
        with pytest.raises(StopError):
            sweeper.run(ball, progress=stop_after(1))
    sweeper.run(ball)
    ((_, done),) = sweeper.began
    assert done >= 8
    assert sweeper.outcome() == whole


@pytest.mark.long
def test_a_finished_sweep_runs_nothing(sweeper: Any, ball: str) -> None:
    first = sweeper.run(ball)
    before = (sweeper.folder / "store" / "runs.parquet").stat().st_mtime_ns
    assert sweeper.run(ball) == first
    assert sweeper.began == [(RUNS, RUNS)]
    assert (sweeper.folder / "store" / "runs.parquet").stat().st_mtime_ns == before


@pytest.mark.long
def test_a_torn_line_of_the_journal_is_run_again(
    sweeper: Any, ball: str, whole: Any, half: Path
) -> None:
    journal = half / "journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-100])
    sweeper.run(ball)
    assert sweeper.began == [(RUNS, 7)]
    assert sweeper.outcome() == whole


@pytest.mark.long
@pytest.mark.parametrize(("place", "lost"), [(4, 1), (3, 2)], ids=["row", "shared by two rows"])
def test_a_garbled_line_of_the_journal_is_named_and_repaired(
    sweeper: Any, ball: str, whole: Any, half: Path, place: int, lost: int
) -> None:
    journal = half / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    lines[place] = bytes(400) + b"\n"
    journal.write_bytes(b"".join(lines))
    message = rf"journal\.jsonl, line {place + 1} does not match its checksum; add --repair"
    with pytest.raises(StoreError, match=message):
        sweeper.run(ball)
    sweeper.run(ball, repair=True)
    assert sweeper.began == [(RUNS, 8 - lost)]
    assert sweeper.outcome() == whole


@pytest.mark.long
def test_half_written_files_are_removed(sweeper: Any, ball: str, whole: Any, half: Path) -> None:
    trace = next((half / "traces").rglob("*.mcap"))
    names = ("runs.parquet.tmp", "journal.jsonl.0123abcd.tmp")
    leftovers = [*map(half.joinpath, names), trace.with_name(trace.name + ".0123abcd.tmp")]
    for leftover in leftovers:
        leftover.write_bytes(b"half")
    sweeper.run(ball)
    assert not any(leftover.exists() for leftover in leftovers)
    assert sweeper.outcome() == whole


@pytest.mark.long
def test_what_a_killed_worker_half_wrote_is_removed_at_the_end(sweeper: Any, ball: str) -> None:
    store = sweeper.folder / "store"

    def leave(finished: Sequence[FinishedRun]) -> None:
        """Leave what a worker does that dies while it writes a trace; another writes it again."""
        trace = store / json.loads(finished[0].row)["trace_file"]
        trace.with_name(trace.name + ".0123abcd.tmp").write_bytes(b"half")

    sweeper.run(ball, progress=leave)
    assert find_problems(store) == []


@pytest.mark.long
@pytest.mark.parametrize("keep", [None, 100], ids=["deleted", "truncated"])
def test_a_lost_trace_is_run_again(
    sweeper: Any, ball: str, whole: Any, half: Path, keep: int | None
) -> None:
    trace = min((half / "traces").rglob("*.mcap"))
    if keep is None:
        trace.unlink()
    else:
        trace.write_bytes(trace.read_bytes()[:keep])
    sweeper.run(ball)
    assert sweeper.began == [(RUNS, 7)]
    assert sweeper.outcome() == whole
    assert find_problems(half) == []


@pytest.mark.long
def test_stopped_between_table_and_manifest(
    sweeper: Any, ball: str, whole: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(folder: Path) -> None:
        if (folder / "runs.parquet").exists():
            raise StopError(folder)

    with monkeypatch.context() as patch:
        patch.setattr(folder_backend, "sync_filesystem", stop)
        with pytest.raises(StopError):
            sweeper.run(ball)
    store = sweeper.folder / "store"
    assert (store / "runs.parquet").exists()
    assert not (store / "manifest.json").exists()
    sweeper.run(ball)
    assert sweeper.began == [(RUNS, RUNS)]
    assert sweeper.outcome() == whole
    assert find_problems(store) == []


@pytest.mark.long
def test_a_journal_left_beside_the_manifest_goes(sweeper: Any, ball: str, whole: Any) -> None:
    sweeper.run(ball)
    journal = sweeper.folder / "store" / "journal.jsonl"
    journal.write_bytes(b'{"run_id": "x"}\n')
    sweeper.run(ball)
    assert not journal.exists()
    assert sweeper.outcome() == whole


@pytest.mark.long
def test_stopped_before_the_identity_is_there(
    sweeper: Any, ball: str, whole: Any, half: Path
) -> None:
    """The scene is copied first: a kill there leaves folders and a half-written identity."""
    (half / "sweep.json").rename(half / "sweep.json.tmp")
    (half / "journal.jsonl").unlink()
    sweeper.run(ball)
    assert not (half / "sweep.json.tmp").exists()
    assert sweeper.outcome() == whole
    assert find_problems(half) == []


@pytest.mark.long
def test_traces_without_a_row_are_written_again(
    sweeper: Any, ball: str, whole: Any, half: Path
) -> None:
    journal = half / "journal.jsonl"
    shared, first, *_ = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(shared + first)
    (half / parse_line(first)["trace_file"]).with_suffix(".tmp").write_bytes(b"")
    sweeper.run(ball)
    assert sweeper.began == [(RUNS, 1)]
    assert sweeper.outcome() == whole
