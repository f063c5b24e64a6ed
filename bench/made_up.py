"""Stores of made-up runs, with every column of a real one, of any size."""

import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from contactlab.schema.evidence import StoreManifest
from contactlab.store.arrow_values import number_array
from contactlab.store.atomic_files import sha256_of
from contactlab.store.finished_store import Store
from contactlab.store.runs_table import digests_of, rows_of_group

Rows = NDArray[np.int64]
Columns = Mapping[str, pa.Array]


def real_store(folder: Path, sweep: str) -> Store:
    """Return the store of a real sweep, given as text, whose schema the made-up ones have."""
    file = folder.with_suffix(".yaml")
    file.write_text(sweep)
    program = str(Path(sys.executable).with_name("contactlab"))
    command = [program, "sweep", str(file), "-o", str(folder), "--workers", "0"]
    subprocess.run(command, capture_output=True, check=True)
    return Store.open(folder)


def ids_of(index: Rows) -> pa.Array:
    """Return ids of runs (n,) that no other index has, in no order."""
    mixed = index.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    digits = mixed.astype(">u8").tobytes().hex().encode()
    ends = np.arange(0, len(digits) + 1, 16, dtype=np.int32)
    return pa.StringArray.from_buffers(len(index), pa.py_buffer(ends), pa.py_buffer(digits))


def tables(
    parts: Iterable[Rows], template: Store, made_up: Callable[[Rows], Columns]
) -> Iterator[pa.Table]:
    """Yield the table of made-up runs in parts.

    Args:
        parts: the places of each part's runs.
        template: gives the columns, and the values of those that are not made up.
        made_up: gives the others for some places.
    """
    first, alike = template.table.slice(0, 1), pa.table({})
    for index in parts:
        made = made_up(index)
        if len(alike) != len(index):
            others = first.drop_columns([*made])
            alike = others.take(number_array(np.zeros_like(index)))
        yield pa.Table.from_arrays(
            [
                made[field.name].cast(field.type) if field.name in made else alike[field.name]
                for field in first.schema
            ],
            schema=first.schema,
        )


def write_store(path: Path, runs: int, template: Store, parts: Iterable[pa.Table]) -> Path:
    """Write a store of so many runs, whose table comes in parts."""
    path.mkdir()
    schema = template.table.schema
    kinds = {field.name: field.type for field in schema}
    writer = pq.ParquetWriter(
        path / "runs.parquet",
        schema,
        # As `write_table` has them.
        compression="zstd",
        compression_level=3,
        use_dictionary=[name for name, kind in kinds.items() if kind == pa.string()],  # pyright: ignore[reportArgumentType]
        column_encoding={
            name: "BYTE_STREAM_SPLIT" for name, kind in kinds.items() if kind == pa.float64()
        },
    )
    with writer:
        for part in parts:
            writer.write_table(part, row_group_size=len(part))
    identity = template.manifest.sweep.model_copy(update={"runs_asked": runs})
    (path / "sweep.json").write_text(identity.model_dump_json())
    labels = pq.read_table(path / "runs.parquet", columns=["label"])["label"].value_counts()
    now = datetime.now(UTC).isoformat()
    manifest = StoreManifest(
        sweep=identity,
        provenance=template.manifest.provenance,
        runs=runs,
        labels={each["values"]: each["counts"] for each in labels.to_pylist()},
        statuses={"ok": runs},
        traces=0,
        expectations={"none": runs},
        **digests_of(path / "runs.parquet")._asdict(),
        files={name: sha256_of(path / name) for name in ("runs.parquet", "sweep.json")},
        started=now,
        finished=now,
    )
    (path / "manifest.json").write_text(manifest.model_dump_json())
    return path


def parts_of(runs: int) -> list[Rows]:
    """Return the places 0..runs in parts of a row group each."""
    size = rows_of_group(runs)
    return [np.arange(start, min(start + size, runs)) for start in range(0, runs, size)]
