"""A sound store has no problems; every planted damage is found, and named."""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from contactlab.errors import StoreError
from contactlab.schema.evidence import STORE_VERSION, EvidenceRecord, LabelEntry
from contactlab.store.atomic_files import sha256_of
from contactlab.store.finished_store import Store
from contactlab.store.row_journal import write_journal
from contactlab.store.runs_table import digests_of, write_table
from contactlab.store.table_layout import record_to_row
from contactlab.store.verify_store import find_problems

TRACE = "traces/01/0000000000000001.mcap"


def flip(path: Path) -> None:
    """Change one byte in the middle of a file."""
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def test_a_sound_store(store: Path) -> None:
    assert find_problems(store) == []


@pytest.mark.parametrize(
    "name", ["runs.parquet", "sweep.json", "scenes/35472800cb1450b5/scene.xml", TRACE]
)
def test_a_changed_byte(store: Path, name: str) -> None:
    flip(store / name)
    assert f"{name}: changed since it was written" in find_problems(store)


@pytest.mark.parametrize("name", ["sweep.json", "scenes/35472800cb1450b5/scene.xml", TRACE])
def test_a_missing_file(store: Path, name: str) -> None:
    (store / name).unlink()
    assert find_problems(store) == [f"{name}: missing"]


def test_a_missing_table(store: Path) -> None:
    (store / "runs.parquet").unlink()
    assert "runs.parquet: missing" in find_problems(store)


def test_a_trace_of_no_run(store: Path) -> None:
    (store / "traces/ff").mkdir()
    (store / TRACE).rename(store / "traces/ff/ff.mcap")
    assert find_problems(store) == [f"{TRACE}: missing", "traces/ff/ff.mcap: belongs to no run"]


@pytest.mark.parametrize("name", ["runs.parquet.tmp", TRACE + ".tmp"])
def test_a_leftover(store: Path, name: str) -> None:
    (store / name).write_bytes(b"half")
    assert find_problems(store) == [f"{name}: left over from an interrupted write"]


def test_a_leftover_journal(store: Path) -> None:
    (store / "journal.jsonl").write_bytes(b"{}\n")
    assert find_problems(store) == ["journal.jsonl: left over from an interrupted write"]


@pytest.mark.parametrize(
    ("name", "said", "problem"),
    [
        ("runs", 4, "runs is 4, but runs.parquet has 3"),
        ("labels", {"stable": 2, "chatter": 1}, "labels is"),
        ("statuses", {"ok": 2}, "statuses is {'ok': 2}, but runs.parquet has {'ok': 3}"),
        ("traces", 2, "traces is 2, but runs.parquet has 3"),
        ("expectations", {}, "expectations is {}, but runs.parquet has {'none': 3}"),
    ],
)
def test_a_changed_count(store: Path, name: str, said: object, problem: str) -> None:
    path = store / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {name: said}))
    assert find_problems(store)[0].startswith(f"manifest.json: {problem}")


def test_runs_that_are_not_all_there(
    store: Path, record_of: Callable[..., EvidenceRecord], columns_of: Any
) -> None:
    """A table of two runs, hashed as it is, in a store that was asked for three."""
    opened = Store.open(store)
    rows = [record_to_row(record) for record in opened.records()][:2]
    journal = store.with_name("rows")
    write_journal(journal, rows)
    records = [record_of(0), record_of(1)]
    write_table(journal, store / "runs.parquet", columns_of(records), opened.columns.shared)
    path = store / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest |= {"runs": 2, "labels": {"stable": 2}, "statuses": {"ok": 2}, "traces": 2}
    manifest |= {"expectations": {"none": 2}}
    manifest["files"]["runs.parquet"] = sha256_of(store / "runs.parquet")
    path.write_text(json.dumps(manifest))
    assert find_problems(store) == [
        "manifest.json: 2 runs, but the sweep has 3",
        "runs.parquet: its runs, in their order, do not match the plan's hash",
        "traces/02/0000000000000002.mcap: belongs to no run",
        "runs.parquet: its records do not match the manifest's digest",
    ]


@pytest.mark.parametrize("data", [b"", b"{}", b"\xff", b'{"runs": "two"}'])
def test_an_identity_that_says_nothing(store: Path, data: bytes) -> None:
    """It has the hash that the manifest states, as whoever writes a store can see to."""
    (store / "sweep.json").write_bytes(data)
    path = store / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["files"]["sweep.json"] = hashlib.sha256(data).hexdigest()
    path.write_text(json.dumps(manifest))
    assert any("sweep.json cannot be read" in problem for problem in find_problems(store))


def test_a_manifest_of_another_sweep(store: Path) -> None:
    path = store / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["sweep"]["name"] = "another"
    path.write_text(json.dumps(manifest))
    assert find_problems(store) == [
        "sweep.json and manifest.json name different sweeps",
        "manifest.json and runs.parquet differ in sweep",
    ]


def test_a_truncated_table(store: Path) -> None:
    table = store / "runs.parquet"
    table.write_bytes(table.read_bytes()[:-200])
    problems = find_problems(store)
    assert problems[0] == "runs.parquet: changed since it was written"
    assert "is damaged" in problems[1]
    with pytest.raises(StoreError, match=r"runs\.parquet was changed since it was written"):
        _ = Store.open(store).table


def test_an_unfinished_store(store: Path) -> None:
    (store / "manifest.json").unlink()
    with pytest.raises(StoreError, match="is unfinished; run its sweep again"):
        find_problems(store)


def test_no_store(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no store at"):
        find_problems(tmp_path / "nowhere")
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(StoreError, match=r"is not a store: it has no manifest\.json"):
        find_problems(tmp_path)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"store_version": 4}'])
def test_a_damaged_manifest(store: Path, text: str) -> None:
    (store / "manifest.json").write_text(text)
    with pytest.raises(StoreError, match=r"manifest\.json is (damaged|of store version None)"):
        find_problems(store)


@pytest.mark.parametrize("version", [STORE_VERSION - 1, STORE_VERSION + 1])
def test_another_version_is_refused(store: Path, version: int) -> None:
    """Whatever else it holds: manifests of earlier releases had other fields."""
    manifest = {"store_version": version, "sweep": {"store_version": version}}
    (store / "manifest.json").write_text(json.dumps(manifest))
    reason = f"is of store version {version}; .* reads version {STORE_VERSION}: sweep again, or"
    with pytest.raises(StoreError, match=reason):
        find_problems(store)


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_run_has_the_worst_of_its_labels(
    tmp_path: Path,
    record_of: Callable[..., EvidenceRecord],
    store_of: Callable[[Path, Sequence[EvidenceRecord]], object],
    place: int,
) -> None:
    """Labels are listed the worst first, and the label of a run is the first one."""
    names = ("tunneling", "chatter", "creep")
    labels = tuple(LabelEntry(label=name, reason="as planted", step=1) for name in names)
    store_of(tmp_path / "store", [record_of(0, label=names[place], labels=labels)])
    where = "runs.parquet: run 0000000000000000: its"
    wrong = [] if place == 0 else [f"{where} label contradicts its other values"]
    assert find_problems(tmp_path / "store") == wrong


@pytest.mark.parametrize(
    "name", ["stray.py", "traces/notes.txt", "scenes/35472800cb1450b5/more.xml", "controls/x.csv"]
)
def test_a_file_that_nothing_names(store: Path, name: str) -> None:
    (store / name).parent.mkdir(exist_ok=True)
    (store / name).write_text("x")
    assert find_problems(store) == [f"{name}: manifest.json does not name it"]


def test_an_empty_folder(store: Path) -> None:
    (store / "more").mkdir()
    assert find_problems(store) == ["more/: manifest.json does not name it"]


def forge(store: Path, change: Callable[[pa.Schema], pa.Schema]) -> None:
    """Write a table with another schema, and redo all hashes that the store has of it."""
    path, table = store / "manifest.json", pq.read_table(store / "runs.parquet")
    changed = change(table.schema)
    pq.write_table(pa.Table.from_arrays(table.columns, schema=changed), store / "runs.parquet")
    manifest = json.loads(path.read_text())
    manifest["files"]["runs.parquet"] = sha256_of(store / "runs.parquet")
    manifest |= digests_of(store / "runs.parquet")._asdict()
    path.write_text(json.dumps(manifest))


def test_a_forged_unit_of_a_column(store: Path) -> None:
    def in_hours(schema: pa.Schema) -> pa.Schema:
        place = schema.get_field_index("cost_cpu_s")
        field = schema.field(place)
        return schema.set(place, field.with_metadata({**field.metadata, b"unit": b"h"}))

    forge(store, in_hours)
    assert "runs.parquet: column cost_cpu_s is in 'h', not in 's'" in find_problems(store)


def test_a_forged_unit_in_the_list_of_columns(store: Path) -> None:
    """It is what DuckDB is told to read."""

    def listed(schema: pa.Schema) -> pa.Schema:
        key = b"contactlab.columns"
        said = json.loads(schema.metadata[key])
        said["duration"]["unit"] = "h"
        return schema.with_metadata({**schema.metadata, key: json.dumps(said).encode()})

    forge(store, listed)
    where = "runs.parquet: column duration"
    assert find_problems(store) == [f"{where} differs from its description in the list of columns"]
