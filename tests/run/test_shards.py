"""Shards, merged, are the store that one machine writes: the same bytes where clocks agree."""

import json
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.run.test_killed_writes import kills

import contactlab
from contactlab.command_line.store_summary import explain_unexpected
from contactlab.errors import (
    ContactlabError,
    ExpectationError,
    OutputError,
    RunFailedError,
    StoreError,
    SweepFileError,
)
from contactlab.run.recomputed_runs import recomputed_problems
from contactlab.store import store_writer
from contactlab.store.atomic_files import sha256_of
from contactlab.store.finished_store import Store
from contactlab.store.store_files import TABLE
from contactlab.store.verify_store import find_problems

SWEEP: dict[str, Any] = {
    "version": 1,
    "scene": "ball_drop",
    "duration": 0.02,
    "seeds": 4,
    "axes": {"timestep": [1e-3, 2e-3], "drop_height": [0.1, 0.2]},
    "expect": [{"mean": {"penetration_max": {"max": -1.0}}}],
}
RUNS = 16


@pytest.fixture
def _one_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have all machines read the same times."""
    monkeypatch.setattr(time, "thread_time", lambda: 0.0)
    monkeypatch.setattr(store_writer, "time_now", lambda: "2026-01-01T00:00:00.000+00:00")
    for module in ("evidence_record", "worker"):
        monkeypatch.setattr(f"contactlab.run.{module}.time_now", store_writer.time_now)


def swept(place: Path | str, **options: Any) -> Store:
    """Sweep; what is not as expected does not matter here."""
    return contactlab.sweep(SWEEP, output=place, workers=0, **options)


def shards(folder: Path, count: int) -> list[Path]:
    places = [folder / f"shard {number}" for number in range(1, count + 1)]
    for number, place in enumerate(places, 1):
        swept(place, shard=f"{number}/{count}")
    return places


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return shards(tmp_path_factory.mktemp("three"), 3)


@pytest.fixture(scope="module")
def merged(three: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Store:
    return contactlab.sweep(three, merge=True, output=tmp_path_factory.mktemp("merged") / "store")


@pytest.mark.usefixtures("_one_clock")
@pytest.mark.parametrize("count", [3])
def test_merged_shards_have_the_bytes_of_one_store(tmp_path: Path, count: int) -> None:
    one = swept(tmp_path / "one")
    places = shards(tmp_path, count)
    places = places[::-2] + places[-2::-2]
    contactlab.sweep(places, merge=True, output=tmp_path / "merged")
    assert contents(tmp_path / "merged") == contents(one.path)
    # What no shard can know: a mean over all runs.
    assert one.manifest.unmet_means
    assert not Store.open(places[0]).manifest.unmet_means


@pytest.mark.night
@pytest.mark.usefixtures("_one_clock")
def test_64_shards_of_which_five_are_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In random order, each in a process of its own; the killed die in their writes."""
    monkeypatch.setitem(SWEEP, "seeds", 32)
    one, rng = swept(tmp_path / "one"), np.random.default_rng(39)
    order = (1 + rng.permutation(64)).tolist()
    places = [tmp_path / f"shard-{number}" for number in order]
    killed = 0
    for number, place in zip(order, places, strict=True):
        act = partial(swept, place, shard=f"{number}/64")
        changes = (int(rng.integers(3, 30)), 10**6) if number in order[::13] else (10**6,)
        killed += len([*kills(place, act, changes)])
    assert killed == 5
    contactlab.sweep(
        [places[place] for place in rng.permutation(64)], merge=True, output=tmp_path / "merged"
    )
    assert contents(tmp_path / "merged") == contents(one.path)


@pytest.mark.long
def test_shards_and_what_they_merge_to_are_sound(three: list[Path], merged: Store) -> None:
    for store in (merged, *map(Store.open, three)):
        assert not find_problems(store.address)
        assert not [*recomputed_problems(store)]
    assert merged.manifest.runs == RUNS
    assert merged.manifest.sweep.whole is None
    counts = [Store.open(place).manifest.runs for place in three]
    assert sum(counts) == RUNS
    assert max(counts) - min(counts) <= 1


def test_a_shard_resumes_and_is_no_other_shard(tmp_path: Path) -> None:
    place = tmp_path / "shard"
    digest = swept(place, shard="2/3").digest
    assert swept(place, shard="2/3").digest == digest
    with pytest.raises(StoreError, match="holds shard 2/3 of this sweep, not shard 3/3"):
        swept(place, shard="3/3")
    # The whole sweep finds a part of its runs, and makes the others.
    kept = contents(place / "traces")
    assert swept(place).manifest.runs == RUNS
    assert kept.items() <= contents(place / "traces").items()
    assert not find_problems(place)
    with pytest.raises(StoreError, match="not shard 2/3"):
        swept(place, shard="2/3")


@pytest.mark.long
def test_a_killed_shard_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, place = swept(tmp_path / "whole"), tmp_path / "shard"
    publish, cut = store_writer.StoreWriter.finish_store, KeyboardInterrupt("killed")

    def killed(*_: object, **__: object) -> None:
        raise cut

    monkeypatch.setattr(store_writer.StoreWriter, "finish_store", killed)
    with pytest.raises(KeyboardInterrupt):
        swept(place, shard="1/2")
    with pytest.raises(StoreError, match=r"shard is unfinished"):
        contactlab.sweep([place], merge=True, output=tmp_path / "merged")
    monkeypatch.setattr(store_writer.StoreWriter, "finish_store", publish)
    swept(place, shard="1/2")
    swept(tmp_path / "other", shard="2/2")
    done = contactlab.sweep([tmp_path / "other", place], merge=True, output=tmp_path / "merged")
    names = ["run_id", "index", "label", "trajectory_hash", "penetration_max"]
    assert done.columns.to_pydict(names) == whole.columns.to_pydict(names)


def test_a_merge_that_died_as_it_ended_is_tidied_up(three: list[Path], tmp_path: Path) -> None:
    """Its manifest is there, and the journal is not gone yet; of other runs it stays refused."""
    target = tmp_path / "merged"
    digest = contactlab.sweep(three, merge=True, output=target).digest
    (target / "journal.jsonl").touch()
    with pytest.raises(OutputError, match="already holds a store"):
        contactlab.sweep(three[:2], merge=True, output=target, partial=True)
    assert contactlab.sweep(three, merge=True, output=target).digest == digest
    assert not find_problems(target)
    with pytest.raises(OutputError, match="already holds a store"):
        contactlab.sweep(three, merge=True, output=target)


def test_gaps_are_named_and_can_be_filled(three: list[Path], tmp_path: Path) -> None:
    target = tmp_path / "merged"
    with pytest.raises(StoreError, match=r"5 of 16 runs .* shard 2/3; run the missing ones"):
        contactlab.sweep([three[2], three[0]], merge=True, output=target)
    assert not target.exists()
    part = contactlab.sweep(
        [three[2], three[0], tmp_path / "no"], merge=True, output=target, partial=True
    )
    assert part.manifest.runs == RUNS - 5
    assert not find_problems(target)
    assert not [*recomputed_problems(part)]
    with pytest.raises(OutputError, match="already holds a store"):
        contactlab.sweep(three, merge=True, output=target)
    assert swept(target).manifest.runs == RUNS
    assert not find_problems(target)


def test_parts_merge_again(three: list[Path], tmp_path: Path, merged: Store) -> None:
    two = contactlab.sweep(three[:2], merge=True, output=tmp_path / "two", partial=True)
    again = contactlab.sweep([three[2], two.path], merge=True, output=tmp_path / "three")
    assert again.manifest.records == merged.manifest.records


def spoiled(folder: Path, source: Path, change: Callable[[Path], object]) -> Path:
    shutil.copytree(source, folder)
    change(folder)
    return folder


def test_overlaps_and_strangers_are_refused_by_name(three: list[Path], tmp_path: Path) -> None:
    def refusal(places: Sequence[Path]) -> str:
        with pytest.raises(ContactlabError) as found:
            contactlab.sweep(places, merge=True, output=tmp_path / "merged")
        assert not (tmp_path / "merged").exists()
        return str(found.value)

    copy = spoiled(tmp_path / "copy", three[0], lambda _: None)
    text = refusal([*three, copy])
    assert "both have run" in text
    assert "and 5 others" in text
    assert str(copy) in text
    other = contactlab.sweep(
        {**SWEEP, "duration": 0.03}, output=tmp_path / "other", workers=0, shard="1/3"
    )
    text = refusal([*three[1:], other.path])
    assert f"{other.path} and {three[1]} are of different sweeps: they differ in duration" in text
    assert refusal([*three, three[0]]) == f"{three[0]} is named twice; name it once"
    trace = next((copy / "traces").rglob("*.mcap"))
    trace.write_bytes(trace.read_bytes()[:-1] + b"x")
    with pytest.raises(StoreError, match=f"{trace.name}: changed since it was written"):
        contactlab.sweep([copy, *three[1:]], merge=True, output=tmp_path / "cut")
    assert refusal([three[0] / "no"]).startswith("no store at")
    with pytest.raises(OutputError, match="is one of the shards"):
        contactlab.sweep(three, merge=True, output=three[1], fresh=True)


def test_a_merge_that_was_killed_is_made_again(
    three: list[Path], tmp_path: Path, merged: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, join = tmp_path / "merged", store_writer.StoreWriter.join_tables

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(store_writer.StoreWriter, "join_tables", killed)
    with pytest.raises(KeyboardInterrupt):
        contactlab.sweep(three, merge=True, output=target)
    monkeypatch.setattr(store_writer.StoreWriter, "join_tables", join)
    assert (
        contactlab.sweep(three, merge=True, output=target).manifest.records
        == merged.manifest.records
    )
    assert not find_problems(target)


@pytest.mark.parametrize(
    ("shard", "changes", "said"),
    [
        ("0/3", {}, "write N/M, such as 3/64"),
        ("4/3", {}, "write N/M"),
        ("three", {}, "write N/M"),
        ("17/20", {}, "shard 17/20 has no runs: the sweep has 16"),
        ("1/2", {"timing": {}}, "a sweep with `timing` has no shards"),
        ("1/2", {"accuracy": {}}, "a sweep with `accuracy` has no shards"),
    ],
)
def test_what_no_shard_can_be(
    tmp_path: Path, shard: str, changes: dict[str, Any], said: str
) -> None:
    with pytest.raises(SweepFileError, match=said):
        contactlab.sweep({**SWEEP, **changes}, output=tmp_path / "s", workers=0, shard=shard)
    assert not (tmp_path / "s").exists()


@pytest.mark.long
def test_shards_lie_in_buckets(three: list[Path], bucket: str, merged: Store) -> None:
    places = [f"{bucket}/shards/{number}" for number in (1, 2, 3)]
    for number, place in enumerate(places, 1):
        swept(place, shard=f"{number}/3")
    found = contactlab.sweep([three[2], *places[:2]], merge=True, output=f"{bucket}/merged")
    names = ["run_id", "index", "label", "trajectory_hash", "penetration_max"]
    assert found.columns.to_pydict(names) == merged.columns.to_pydict(names)
    assert not find_problems(found.address)


@pytest.mark.long
def test_honest_repeats_have_the_same_physics(merged: Store, tmp_path: Path) -> None:
    again = swept(tmp_path / "again")
    assert again.physics == merged.physics
    assert again.digest != merged.digest
    other = contactlab.sweep({**SWEEP, "seeds": 5}, output=tmp_path / "other", workers=0)
    assert other.physics != merged.physics


def test_a_forged_unit_of_a_metric_is_found(merged: Store, tmp_path: Path) -> None:
    """Units of axes and metrics are those of the scene and of the code, whatever is hashed."""
    folder = shutil.copytree(merged.path, tmp_path / "forged")
    table = pq.read_table(folder / TABLE)
    schema = table.schema
    for name in ("penetration_max", "drop_height"):
        place = schema.get_field_index(name)
        meta = {**schema.field(place).metadata, b"unit": b"mm"}
        schema = schema.set(place, schema.field(place).with_metadata(meta))
    pq.write_table(pa.Table.from_arrays(table.columns, schema=schema), folder / TABLE)
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["files"] |= {TABLE: sha256_of(folder / TABLE)}
    manifest["files"] |= {f"scenes/{merged.manifest.sweep.scene_hash}/more.xml": "0" * 64}
    path.write_text(json.dumps(manifest))
    found = [*recomputed_problems(Store.open(folder))]
    assert "runs.parquet: column penetration_max is in 'mm', not in 'm'" in found
    assert "runs.parquet: column drop_height is in 'mm', not in 'm'" in found
    assert any(problem.endswith("more.xml: is not a file of the scene") for problem in found)


def test_a_sweep_of_which_no_run_is_valid_fails(
    merged: Store,
) -> None:
    assert isinstance(explain_unexpected(merged), ExpectationError)
    none = {"expectations": {"none": RUNS}, "unmet_means": ()}
    counts = {"labels": {"invalid": RUNS}, **none}
    invalid = replace(merged, manifest=merged.manifest.model_copy(update=counts))
    failure = explain_unexpected(invalid)
    assert isinstance(failure, RunFailedError)
    assert str(failure).startswith("all 16 runs are invalid: ")
    some = {"labels": {"invalid": RUNS - 1, "stable": 1}, **none}
    assert (
        explain_unexpected(replace(merged, manifest=merged.manifest.model_copy(update=some)))
        is None
    )
