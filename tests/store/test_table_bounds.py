"""Compressed files are refused by their headers; nothing of them is unpacked."""

import io
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from contactlab.errors import OutputError, SceneError, StoreError
from contactlab.scene.scene import Scene
from contactlab.store import atomic_files, table_bounds
from contactlab.store.atomic_files import exchange_folders
from contactlab.store.control_tables import read_control_table
from contactlab.store.store_files import parse_address
from contactlab.store.table_bounds import check_arrow

NUMBERS = 1 << 18


@pytest.fixture(autouse=True)
def small_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_bounds.check_extent, "__defaults__", (1 << 20,))


def write_table(path: Path, numbers: int) -> None:
    zeros = np.zeros(numbers)
    table = pa.table({"time": zeros, "hip": zeros})
    match path.suffix:
        case ".npz":
            np.savez_compressed(path, time=zeros, hip=zeros)
        case ".parquet":
            pq.write_table(table, path, compression="zstd")
        case _:
            options = pa.ipc.IpcWriteOptions(compression="zstd")
            with pa.ipc.new_file(path, table.schema, options=options) as writer:
                writer.write_table(table)


@pytest.mark.parametrize("suffix", [".npz", ".parquet", ".arrow"])
def test_a_table_is_as_large_as_its_header_says(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"drive{suffix}"
    write_table(path, 1 << 10)
    assert len(read_control_table(path)["hip"]) == 1 << 10
    write_table(path, NUMBERS)
    assert path.stat().st_size < 1 << 14
    with pytest.raises(SceneError, match=r"its header declares [\d,]+ bytes"):
        read_control_table(path)


def test_numbers_of_an_arrow_file_are_counted() -> None:
    """Also with a dictionary, and in several batches."""
    table = pa.table({"time": np.arange(9.0), "word": pa.array(["a"] * 9).dictionary_encode()})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, table.schema) as writer:
        writer.write_table(table, max_chunksize=4)
    check_arrow(sink.getvalue())
    for damage in (b"", b"ARROW1\0\0", sink.getvalue().to_pybytes()[:90]):
        try:
            check_arrow(pa.py_buffer(damage))
        except (ValueError, LookupError, struct.error, pa.ArrowException, OSError):
            continue


def test_a_baseline_survives_a_rename_that_lies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file system renames, and reports a failure, as NFS does if an answer is lost."""
    rename = Path.rename

    def lie(self: Path, target: Path) -> Path:
        rename(self, target)
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(Path, "rename", lie)
    monkeypatch.setattr(atomic_files, "_LIBC", object())
    for name in ("new", "target"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).touch()
    exchange_folders(tmp_path / "new", tmp_path / "target")
    assert [path.name for path in (tmp_path / "target").iterdir()] == ["new"]
    assert [path.name for path in (tmp_path / "old").iterdir()] == ["target"]


def test_a_path_with_a_colon_is_no_url(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert parse_address("run:1") == tmp_path / "run:1"
    assert parse_address("run") == Path("run")


def test_a_store_in_a_folder_with_a_backslash_is_refused_before_it_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo opens no model there: it reads the name up to the backslash as another folder."""
    folder = tmp_path / "a\\b"
    folder.mkdir()
    (folder / "ball.xml").write_text("<mujoco/>")
    with pytest.raises(SceneError, match="rename its folder or file"):
        Scene.open(str(folder / "ball.xml"))
    with pytest.raises(OutputError, match="backslash"):
        parse_address(str(folder / "store"))
    monkeypatch.chdir(folder)
    with pytest.raises(OutputError, match="backslash"):
        parse_address("store")


def test_a_table_has_few_row_groups(store: Path) -> None:
    from contactlab.store.runs_table import check_table_size  # noqa: PLC0415

    path = store / "runs.parquet"
    table = pq.read_table(path)
    with pq.ParquetWriter(path, table.schema) as writer:
        for _ in range(600):
            writer.write_table(table.slice(0, 0))
    with pytest.raises(StoreError, match="600 row groups for 3 runs"):
        check_table_size(path, 3)


def test_an_archive_may_be_no_archive(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("time.npy", zlib.compress(b"x"))
    for data in (b"", b"PK", buffer.getvalue()):
        (tmp_path / "drive.npz").write_bytes(data)
        with pytest.raises(SceneError, match="cannot read"):
            read_control_table(tmp_path / "drive.npz")
