"""Reads tables of controls, forces and poses that drive runs: .csv, .parquet, .npz, .mcap."""

import csv
import json
from collections.abc import Callable, Mapping
from itertools import chain
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from contactlab.errors import SceneError
from contactlab.schema.setting_values import parse_decimal
from contactlab.store.table_bounds import (
    check_archive,
    check_arrow,
    check_extent,
    check_parquet,
)

Columns = dict[str, NDArray[np.float64]]


def read_control_table(path: Path) -> Columns:
    """Return the columns of a table by name, each (T,).

    A column of vectors, such as the arrays of .npz files, becomes `NAME[0]`, `NAME[1]`, ... Raises
    a SceneError if it cannot be read, or has cells that are not numbers, or columns of two lengths.
    """
    read_columns = _READERS.get(path.suffix.lower())
    if read_columns is None:
        suffixes = ", ".join(_READERS)
        raise SceneError(f"{path.name} is not a table of columns; write a file {suffixes}")
    try:
        check_extent(path.stat().st_size)
        columns = read_columns(path)
    except Exception as error:
        # Each format's library raises different errors.
        reason = str(error) or type(error).__name__
        raise SceneError(f"cannot read {path}: {reason}") from error
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        fewest, most = min(lengths, key=lengths.__getitem__), max(lengths, key=lengths.__getitem__)
        raise SceneError(
            f"{path.name}: column `{fewest}` has {lengths[fewest]} rows, but `{most}` has "
            f"{lengths[most]}; write columns of equal length"
        )
    return columns


def _read_csv(path: Path) -> Columns:
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = [row for row in csv.reader(file) if row]
    names = [name.strip() for name in rows[0]] if rows else []
    if len(set(names)) < len(names):
        raise ValueError(
            f"column `{next(name for name in names if names.count(name) > 1)}` occurs twice"
        )
    for number, row in enumerate(rows[1:], 1):
        if len(row) != len(names):
            raise ValueError(f"row {number} has {len(row)} cells, not {len(names)}")
    return {
        name: np.array([_number_or_nan(row[k]) for row in rows[1:]]) for k, name in enumerate(names)
    }


def _number_or_nan(cell: str) -> float:
    """Return the number in a cell, or NaN: unused columns may contain words."""
    try:
        return parse_decimal(cell)
    except ValueError:
        return np.nan


def _read_table(path: Path) -> Columns:
    if path.suffix.lower() == ".parquet":
        check_parquet(path)
        table = pq.read_table(path)
    else:
        data = pa.py_buffer(path.read_bytes())
        check_arrow(data)
        with pa.ipc.open_file(data) as file:
            table = file.read_all()
    return _split_vectors(
        dict(zip(table.column_names, map(_column_cells, table.columns), strict=True))
    )


def _column_cells(column: pa.ChunkedArray) -> object:
    kind, unused = column.type, np.full(len(column), np.nan)
    vectors = pa.types.is_list(kind) or pa.types.is_large_list(kind)
    if vectors or pa.types.is_fixed_size_list(kind):
        rows = column.to_pylist()
        numbers = pa.types.is_primitive(kind.value_type)
        return rows if numbers and len({row and len(row) for row in rows}) == 1 else unused
    # Unused columns may contain words and pictures, which are not numbers.
    is_numeric = pa.types.is_primitive(kind) or pa.types.is_decimal(kind)
    return column.to_numpy() if is_numeric else unused


def _read_npz(path: Path) -> Columns:
    check_archive(path)
    with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        return _split_vectors({name: arrays[name] for name in arrays.files})


def _split_vectors(arrays: Mapping[str, object]) -> Columns:
    """Return columns of numbers; vectors are split."""
    columns: Columns = {}
    for name, values in arrays.items():
        plain = np.asarray(values)
        if np.iscomplexobj(plain):
            raise ValueError(f"`{name}` has complex numbers")
        array = plain.astype(np.float64)
        if array.ndim == 2:
            columns |= {f"{name}[{k}]": array[:, k] for k in range(array.shape[1])}
        elif array.ndim == 1:
            columns[name] = array
        else:
            raise ValueError(f"`{name}` has {array.ndim} dimensions, not rows, or rows and columns")
    return columns


_MCAP_HEAD = 37  # least number of bytes before the last magic: the first one, and a footer


def _read_mcap(path: Path) -> Columns:
    """Return the content of JSON messages: numbers by name, or lists of `name` and `position`.

    For a trace of a run, it is the states.
    """
    from mcap.reader import make_reader  # noqa: PLC0415 - takes a while
    from mcap.writer import MCAP0_MAGIC  # noqa: PLC0415

    from contactlab.store.mcap.trace_messages import STATE_TOPIC  # noqa: PLC0415
    from contactlab.store.mcap.trace_reader import read_trace  # noqa: PLC0415

    rows: list[dict[str, object]] = []
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - len(MCAP0_MAGIC)))
        if file.tell() < _MCAP_HEAD or file.read() != MCAP0_MAGIC:
            raise ValueError("it is cut, or no MCAP file; record or copy it again")
        file.seek(0)
        for _, channel, message in make_reader(file).iter_messages():
            if channel.topic == STATE_TOPIC and "nq" in channel.metadata:
                trace = read_trace(path)
                return _split_vectors({"time": trace.time, "qpos": trace.qpos, "qvel": trace.qvel})
            if channel.message_encoding != "json":
                raise ValueError(
                    f"topic {channel.topic} is encoded as {channel.message_encoding}; write JSON"
                )
            data: dict[str, object] = json.loads(message.data)
            if isinstance(names := data.get("name"), list):
                positions = data.get("position")
                data = dict(
                    zip(names, positions if isinstance(positions, list) else (), strict=True)
                )
            rows.append({"time": message.log_time * 1e-9, **data})
    names = dict.fromkeys(chain.from_iterable(rows))
    return _split_vectors({name: [row.get(name, np.nan) for row in rows] for name in names})


_READERS: Mapping[str, Callable[[Path], Columns]] = {
    ".csv": _read_csv,
    ".parquet": _read_table,
    ".arrow": _read_table,
    ".npz": _read_npz,
    ".mcap": _read_mcap,
}
