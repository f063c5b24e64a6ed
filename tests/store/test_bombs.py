"""What claims to be large is refused before it is unpacked."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zstandard

from contactlab.errors import StoreError
from contactlab.store import runs_table
from contactlab.store.finished_store import Store
from contactlab.store.mcap.stored_messages import check_chunk_size, unpack_chunk
from contactlab.store.runs_table import TableLimits
from contactlab.store.verify_store import find_problems


def test_a_chunk_is_as_large_as_it_says_and_of_bounded_size() -> None:
    some = zstandard.compress(bytes(1000))
    check_chunk_size(some, 1000)
    unpack_chunk(some, content := np.ones(1000, np.uint8))
    assert not content.any()
    with pytest.raises(ValueError, match="another number of bytes"):
        unpack_chunk(some, np.ones(999, np.uint8))
    bomb = zstandard.compress(bytes(65 << 20))
    for data, size in ((some, 999), (some, 6 << 30), (bomb, 1000), (bomb, 65 << 20)):
        with pytest.raises(ValueError, match="claims to hold"):
            check_chunk_size(data, size)


def redo_hash(store: Path, name: str) -> None:
    """Have the manifest state the hash that a file has now."""
    path = store / "manifest.json"
    content = json.loads(path.read_text())
    content["files"][name] = hashlib.sha256((store / name).read_bytes()).hexdigest()
    path.write_text(json.dumps(content))


def test_a_table_has_no_more_rows_than_the_manifest_says(
    store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = store / "runs.parquet"
    table = pq.read_table(path)
    pq.write_table(pa.concat_tables([table] * 400), path, compression="zstd")
    redo_hash(store, "runs.parquet")
    monkeypatch.setattr(pq, "read_table", None)
    for read in (Store.open, find_problems):
        with pytest.raises(StoreError, match="1,200 rows for 3 runs"):
            read(store)


def test_a_row_is_of_bounded_size(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    limits = TableLimits(most_bytes=1 << 20, most_row_bytes=1 << 10)
    monkeypatch.setattr(runs_table, "LIMITS", limits)
    path = store / "runs.parquet"
    table = pq.read_table(path)
    reasons = pa.array([["x" * (500 << 10)]] * 3)
    index = table.schema.get_field_index("label_reasons")
    changed = table.set_column(index, table.schema.field(index), reasons)
    pq.write_table(changed, path, compression="zstd", use_dictionary=False)
    assert path.stat().st_size < 1 << 17
    redo_hash(store, "runs.parquet")
    with pytest.raises(StoreError, match="its header declares 1,5"):
        Store.open(store)


@pytest.mark.parametrize("name", ["manifest.json", "sweep.json"])
def test_deep_nesting_is_damage(store: Path, name: str) -> None:
    (store / name).write_text('{"store_version": 4, "x": ' + "[" * 200_000)
    try:
        problems = find_problems(store)
    except StoreError as error:
        problems = [str(error)]
    assert problems
