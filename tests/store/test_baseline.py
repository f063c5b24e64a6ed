"""A baseline is a store without traces, which says so, verifies and is replaced in one step."""

from dataclasses import replace
from pathlib import Path

import pytest

from contactlab.errors import OutputError, StoreError
from contactlab.store import atomic_files, verify_store
from contactlab.store.atomic_files import sha256_of
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems, write_baseline


def files(folder: Path) -> set[str]:
    found = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix() for path in found}


def test_a_baseline_has_all_but_the_traces(store: Path, tmp_path: Path) -> None:
    target = tmp_path / "deep" / "baseline"
    manifest = write_baseline(store, target).manifest
    assert manifest.traces_left_out
    assert files(target) == {
        "manifest.json",
        "sweep.json",
        "runs.parquet",
        "scenes/35472800cb1450b5/scene.xml",
    }
    assert find_problems(target) == []
    assert find_problems(target, thorough=False) == []
    assert list(Store.open(target).records()) == list(Store.open(store).records())


def test_its_columns_still_say_what_they_measure(store: Path, tmp_path: Path) -> None:
    write_baseline(store, tmp_path / "baseline")
    before, after = (Store.open(path).columns for path in (store, tmp_path / "baseline"))
    undescribed = {
        name: replace(each, description="") for name, each in before.metric_columns.items()
    }
    assert after.metric_columns == undescribed
    assert after.shared == before.shared


def test_its_traces_are_not_missing_but_left_out(store: Path, tmp_path: Path) -> None:
    write_baseline(store, tmp_path / "baseline")
    opened = Store.open(tmp_path / "baseline")
    with pytest.raises(StoreError, match="is a baseline without traces"):
        opened.trace(next(opened.records()))


def test_a_trace_in_a_baseline_belongs_to_no_run(store: Path, tmp_path: Path) -> None:
    write_baseline(store, tmp_path / "baseline")
    trace = next(store.rglob("*.mcap"))
    stray = tmp_path / "baseline" / trace.relative_to(store)
    stray.parent.mkdir(parents=True)
    stray.write_bytes(trace.read_bytes())
    (problem,) = find_problems(tmp_path / "baseline")
    assert problem.endswith("belongs to no run")


def test_an_earlier_baseline_is_replaced_whole(store: Path, tmp_path: Path) -> None:
    target = tmp_path / "baseline"
    write_baseline(store, target)
    (target / "scenes/35472800cb1450b5/old.xml").write_text("left from before")
    write_baseline(store, target)
    assert find_problems(target) == []
    assert "scenes/35472800cb1450b5/old.xml" not in files(target)
    assert {path.name for path in tmp_path.iterdir()} == {"store", "baseline"}


def test_nothing_else_is_replaced(store: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="is the store itself"):
        write_baseline(store, store)
    strange = tmp_path / "strange"
    strange.mkdir()
    (strange / "thesis.tex").write_text("")
    with pytest.raises(OutputError, match="is not a baseline, so it is not replaced"):
        write_baseline(store, strange)
    assert files(strange) == {"thesis.tex"}


def test_a_broken_store_makes_no_baseline(store: Path, tmp_path: Path) -> None:
    next(store.rglob("*.mcap")).unlink()
    with pytest.raises(StoreError, match=r"is not sound: .*: missing"):
        write_baseline(store, tmp_path / "baseline")
    assert not (tmp_path / "baseline").exists()


def test_a_baseline_has_the_digest_of_its_stores_records(store: Path, tmp_path: Path) -> None:
    """However the table is encoded."""
    written = write_baseline(store, tmp_path / "baseline")
    assert written.manifest.records == Store.open(store).manifest.records
    assert sha256_of(store / "runs.parquet") != sha256_of(written.file("runs.parquet"))


def test_only_the_pinned_baseline_is_replaced(store: Path, tmp_path: Path) -> None:
    digest = write_baseline(store, tmp_path / "baseline").digest
    with pytest.raises(
        OutputError, match=f"has the digest {digest}, not 0+, so it is not replaced"
    ):
        write_baseline(store, tmp_path / "baseline", "0" * 64)
    assert write_baseline(store, tmp_path / "baseline", digest).digest == digest


def test_without_an_exchange_in_one_step_two_renames_do(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(atomic_files, "_LIBC", None)
    monkeypatch.setattr(verify_store, "sync_filesystem", lambda _: None)
    target = tmp_path / "beside" / "baseline"
    digest = write_baseline(store, target).digest
    assert write_baseline(store, target).digest == digest
    # Killed between the renames: the old one is put back, then replaced.
    (target.parent / ".baseline.update").mkdir()
    target.rename(target.parent / ".baseline.update" / "old")
    assert write_baseline(store, target, digest).digest == digest
    assert [path.name for path in target.parent.iterdir()] == ["baseline"]
