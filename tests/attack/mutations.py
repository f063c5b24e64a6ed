"""Ways to bend a finished store, of which each changes one thing, by a seeded random choice.

How far the one who bends it goes is its level: 0 changes files only; 1 has the manifest state the
hashes of the files that changed; 2 has it state the counts and the digest of the records too.
"""

import hashlib
import json
import random
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from contactlab.store.mcap.file_parts import encode_file
from contactlab.store.mcap.stored_messages import file_start_of, message_stream, stored_file
from contactlab.store.mcap.trace_messages import HEADER_SIZE
from contactlab.store.row_journal import SEAL_SIZE, row_extent, with_checksum
from contactlab.store.runs_table import count_outcomes, digests_of

TABLE, MANIFEST, IDENTITY = "runs.parquet", "manifest.json", "sweep.json"
JOURNAL = "journal.jsonl"


@dataclass(frozen=True)
class Target:
    """A copy of a store, to be bent.

    Attributes:
        store: the copy.
        older: another store of the same sweep file, of an older version of its model.
        outside: a folder that the store has nothing to do with.
        chance: makes every choice.
    """

    store: Path
    older: Path
    outside: Path
    chance: random.Random

    def files(self) -> list[Path]:
        """Return every file but the lock."""
        found = (path for path in sorted(self.store.rglob("*")) if path.is_file())
        return [path for path in found if path.name != ".lock"]

    def traces(self) -> list[Path]:
        return sorted(self.store.rglob("*.mcap"))

    def pick(self) -> Path:
        """Return a file; each kind is equally likely."""
        kinds: dict[str, list[Path]] = {}
        for path in self.files():
            kinds.setdefault(
                path.suffix + ("" if path.suffix != ".json" else path.name), []
            ).append(path)
        return self.chance.choice(self.chance.choice(list(kinds.values())))


Mutation = Callable[[Target], str]


def flip(target: Target) -> str:
    path = target.pick()
    data = bytearray(path.read_bytes())
    place = target.chance.randrange(len(data))
    data[place] ^= 1 << target.chance.randrange(8)
    path.write_bytes(data)
    return f"bit of byte {place} of {path.name}"


def cut(target: Target) -> str:
    path = target.pick()
    data = path.read_bytes()
    size = target.chance.randrange(len(data))
    path.write_bytes(data[:size])
    return f"{path.name} to {size} bytes"


def fill(target: Target) -> str:
    """Have a file of its size hold zeros from some place on, as a loss of power leaves it."""
    path = target.pick()
    data = path.read_bytes()
    size = target.chance.randrange(len(data))
    path.write_bytes(data[:size] + bytes(len(data) - size))
    return f"{path.name} from byte {size}"


def repeat(target: Target) -> str:
    path = target.pick()
    data = path.read_bytes()
    start, stop = sorted(target.chance.randrange(len(data) + 1) for _ in range(2))
    path.write_bytes(data[:stop] + data[start:stop] + data[stop:])
    return f"bytes {start} to {stop} of {path.name}"


def swap(target: Target) -> str:
    one, other = target.chance.sample(target.traces(), 2)
    first, second = one.read_bytes(), other.read_bytes()
    one.write_bytes(second)
    other.write_bytes(first)
    return f"{one.name} and {other.name}"


def duplicate(target: Target) -> str:
    path = target.pick()
    copy = path.with_name(f"{target.chance.randrange(16**16):016x}{path.suffix}")
    shutil.copyfile(path, copy)
    return f"{path.name} as {copy.name}"


def delete(target: Target) -> str:
    path = target.pick()
    path.unlink()
    return path.name


def link(target: Target) -> str:
    """Move a file, or a folder, away and leave a link to it."""
    path = target.pick()
    path = target.chance.choice(
        [
            path,
            *(
                each
                for each in path.parents
                if each.is_relative_to(target.store) and each != target.store
            ),
        ]
    )
    moved = target.outside / f"{target.chance.randrange(16**8):08x}"
    path.rename(moved)
    path.symlink_to(moved)
    return path.name


def replay(target: Target) -> str:
    """Put a file of an older version of the store in its place."""
    path = target.pick()
    same = target.older / path.relative_to(target.store)
    if not same.is_file():
        others = [each for each in sorted(target.older.rglob("*")) if each.suffix == path.suffix]
        same = target.chance.choice(others)
    path.write_bytes(same.read_bytes())
    return path.name


def edit_document(target: Target) -> str:
    """Change, remove or add a value of the manifest or the identity."""
    name = target.chance.choice([MANIFEST, IDENTITY])
    return f"{name}: {_edit_json(target.store / name, target.chance)}"


def edit_both_identities(target: Target) -> str:
    """Change the sweep where the manifest and the identity state it."""
    manifest = _read(target.store / MANIFEST)
    said = _edit(manifest["sweep"], target.chance)
    _write(target.store / IDENTITY, manifest["sweep"])
    _write(target.store / MANIFEST, manifest)
    return said


def edit_cell(target: Target) -> str:
    """Change one value of one run."""
    table = pq.read_table(target.store / TABLE)
    column = target.chance.randrange(table.num_columns)
    row = target.chance.randrange(table.num_rows)
    field = table.schema.field(column)
    values = table.column(column).to_pylist()
    values[row] = _other(values[row], field.type, target.chance)
    pq.write_table(
        table.set_column(column, field, pa.array(values, field.type)), target.store / TABLE
    )
    return f"{field.name} of row {row}"


def edit_rows(target: Target) -> str:
    """Exchange, repeat or drop rows."""
    table = pq.read_table(target.store / TABLE)
    rows = list(range(table.num_rows))
    how = target.chance.choice(["exchange", "repeat", "drop", "reverse"])
    one, other = target.chance.sample(rows, 2)
    if how == "exchange":
        rows[one], rows[other] = rows[other], rows[one]
    elif how == "repeat":
        rows[one] = other
    elif how == "drop":
        del rows[one]
    else:
        rows.reverse()
    pq.write_table(table.take(rows), target.store / TABLE)
    return f"{how} {one} {other}"


def edit_shared(target: Target) -> str:
    """Change a field that all runs share."""
    table = pq.read_table(target.store / TABLE)
    meta = dict(table.schema.metadata)
    shared = json.loads(meta[b"contactlab.shared"])
    said = _edit(shared, target.chance)
    meta[b"contactlab.shared"] = json.dumps(shared).encode()
    pq.write_table(table.replace_schema_metadata(meta), target.store / TABLE)
    return said


def swap_traces_in_rows(target: Target) -> str:
    """Exchange which traces two rows name."""
    table = pq.read_table(target.store / TABLE)
    rows = table.to_pylist()
    one, other = target.chance.sample([row for row in rows if row["trace_file"]], 2)
    for name in ("trace_file", "trace_sha256", "trace_bytes", "trace_messages"):
        one[name], other[name] = other[name], one[name]
    pq.write_table(pa.Table.from_pylist(rows, table.schema), target.store / TABLE)
    return f"{one['run_id']} and {other['run_id']}"


def edit_trace(target: Target) -> str:
    """Change a byte of a message, and write a sound file of it, which the table names."""
    path = target.chance.choice(target.traces())
    place = _write_changed(path, target.chance)
    table = pq.read_table(target.store / TABLE)
    rows = table.to_pylist()
    (row,) = [row for row in rows if row["trace_file"] and row["trace_file"].endswith(path.name)]
    row["trace_sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    row["trace_bytes"] = path.stat().st_size
    pq.write_table(pa.Table.from_pylist(rows, table.schema), target.store / TABLE)
    return f"byte {place} of the messages of {path.name}"


def edit_scene(target: Target) -> str:
    """Change a digit of the model."""
    path = target.chance.choice(sorted(target.store.glob("scenes/*/*.xml")))
    text = path.read_text()
    places = [place for place, sign in enumerate(text) if sign.isdigit()]
    place = target.chance.choice(places)
    path.write_text(text[:place] + str((int(text[place]) + 1) % 10) + text[place + 1 :])
    return f"{path.name}, digit {place}"


def leave_out_traces(target: Target) -> str:
    shutil.rmtree(target.store / "traces")
    manifest = _read(target.store / MANIFEST)
    manifest["traces_left_out"] = True
    _write(target.store / MANIFEST, manifest)
    return "all"


def forget_files(target: Target) -> str:
    """Have the manifest name fewer files, and change one of them."""
    manifest = _read(target.store / MANIFEST)
    name = target.chance.choice(sorted(manifest["files"]))
    del manifest["files"][name]
    _write(target.store / MANIFEST, manifest)
    path = target.store / name
    data = bytearray(path.read_bytes())
    data[target.chance.randrange(len(data))] ^= 1
    path.write_bytes(data)
    return name


FILES: tuple[Mutation, ...] = (flip, cut, fill, repeat, swap, duplicate, delete, link, replay)
CONTENT: tuple[Mutation, ...] = (
    edit_document,
    edit_both_identities,
    edit_cell,
    edit_rows,
    edit_shared,
    swap_traces_in_rows,
    edit_trace,
    edit_scene,
    leave_out_traces,
    forget_files,
)


def exchange_lines(target: Target) -> str:
    """Exchange, repeat or drop lines of the journal."""
    path = target.store / JOURNAL
    lines = path.read_bytes().splitlines(keepends=True)
    how = target.chance.choice(["exchange", "repeat", "drop"])
    one, other = target.chance.sample(range(len(lines)), 2)
    if how == "exchange":
        lines[one], lines[other] = lines[other], lines[one]
    elif how == "repeat":
        lines.append(lines[one])
    else:
        del lines[one]
    path.write_bytes(b"".join(lines))
    return f"{how} lines {one} {other}"


def edit_line(target: Target) -> str:
    """Change, remove or add a value of a row."""
    path = target.store / JOURNAL
    lines = path.read_bytes().splitlines(keepends=True)
    place = target.chance.randrange(len(lines))
    size, _ = row_extent(lines[place])
    row = json.loads(lines[place][:size])
    said = _edit(row, target.chance)
    lines[place] = json.dumps(row).encode() + lines[place][size:]
    path.write_bytes(b"".join(lines))
    return f"line {place}: {said}"


_OF_TRACES = (swap, edit_trace, leave_out_traces)
_OF_JOURNALS = (exchange_lines, edit_line, edit_line, edit_line)


def mutations(stores: tuple[str, ...]) -> Iterator[tuple[str, Mutation, int]]:
    """Yield all mutations of kinds of stores, again and again, at levels that make a difference.

    Baselines have no traces. Of an unfinished store, level 1 redoes the journal's checksums.
    """
    while True:
        for store in stores:
            own = _OF_JOURNALS if store == "unfinished" else CONTENT
            levels = (0, 1) if store == "unfinished" else (0, 1, 2, 2)
            fitting = [
                each for each in (*FILES, *own) if store != "baseline" or each not in _OF_TRACES
            ]
            for each in fitting:
                yield from ((store, each, level) for level in ((0, 1) if each in FILES else levels))


def reseal(store: Path) -> None:
    """Redo the checksums of a journal's lines."""
    path = store / JOURNAL
    if path.is_file() and not path.is_symlink():
        lines = path.read_bytes().splitlines(keepends=True)
        path.write_bytes(
            b"".join(
                with_checksum(line[:-SEAL_SIZE]) if line[-SEAL_SIZE:].startswith(b"\t") else line
                for line in lines
            )
        )


def redo(store: Path, level: int) -> None:
    """Have the manifest state what the files are now."""
    try:
        manifest = _read(store / MANIFEST)
        if level:
            for name in manifest["files"]:
                if (store / name).is_file():
                    manifest["files"][name] = hashlib.sha256(
                        (store / name).read_bytes()
                    ).hexdigest()
        if level == 2:
            manifest |= count_outcomes(pq.read_table(store / TABLE).to_batches())
            manifest["expectations"] = manifest.get("expectations", {})
            manifest["sweep"]["runs_asked"] = manifest["runs"]
            manifest |= digests_of(store / TABLE)._asdict()
            seeds = manifest["sweep"]["resolved"]["seeds"]
            manifest["sweep"]["plan_hash"] = _plan_hash(store, seeds)
            _write(store / IDENTITY, manifest["sweep"])
            manifest["files"][IDENTITY] = hashlib.sha256(
                (store / IDENTITY).read_bytes()
            ).hexdigest()
        _write(store / MANIFEST, manifest)
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        # What is bent may be past repair.
        return


def _plan_hash(store: Path, seeds: Any) -> str:
    rows = pq.read_table(store / TABLE, columns=["run_id", "index"]).to_pylist()
    each = seeds if isinstance(seeds, int) else len(seeds)
    firsts = "".join(row["run_id"] for row in rows if row["index"] % each == 0)
    return hashlib.sha256(firsts.encode()).hexdigest()[:32]


def _write_changed(path: Path, chance: random.Random) -> int:
    """Write a trace again with one bit of one message changed; return where in the message."""
    file = stored_file(path.read_bytes())
    stream = message_stream(file)
    rows, columns = np.nonzero(stream.sizes)
    which = chance.randrange(len(rows))
    row, column = int(rows[which]), int(columns[which])
    place = chance.randrange(int(stream.sizes[row, column]) - HEADER_SIZE)
    data = stream.data.copy()
    data[stream.offsets[row, column] + HEADER_SIZE + place] ^= 1 << chance.randrange(8)
    path.write_bytes(encode_file(file_start_of(file), replace(stream, data=data)))
    return place


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def _write(path: Path, content: object) -> None:
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _edit_json(path: Path, chance: random.Random) -> str:
    content = _read(path)
    said = _edit(content, chance)
    _write(path, content)
    return said


def _edit(content: Any, chance: random.Random) -> str:
    """Change, remove or add one value somewhere in a document; return which."""
    where, keys = content, []
    while True:
        key = chance.choice(sorted(where) if isinstance(where, dict) else range(len(where)))
        keys.append(str(key))
        inner = where[key]
        if isinstance(inner, dict | list) and inner and chance.random() < 0.9:
            where = inner
            continue
        how = chance.choice(["change", "change", "remove", "add"])
        if how == "change" or isinstance(where, list):
            where[key] = _other_value(inner, chance)
        elif how == "remove":
            del where[key]
        else:
            where[f"{key}x"] = inner
        return f"{how} {'.'.join(keys)}"


def _other_value(value: Any, chance: random.Random) -> Any:
    match value:
        case bool():
            return not value
        case int():
            return value + chance.choice([-1, 1, 1000])
        case float():
            return value * chance.choice([-1, 0, 1.0000001, 2]) + chance.choice([0, 1e-9])
        case str() if value:
            place = chance.randrange(len(value))
            return value[:place] + chr(ord(value[place]) ^ 1) + value[place + 1 :]
        case None:
            return chance.choice([0, "x", False])
        case _:
            return chance.choice([None, 1, "x", [], {}])


def _other(value: Any, kind: pa.DataType, chance: random.Random) -> Any:
    """Return another value of a column's type."""
    if value is None or chance.random() < 0.1:
        return None if value is not None else _some(kind)
    if isinstance(value, list):
        if not value:
            return [_some(kind.value_type)]
        place = chance.randrange(len(value))
        return [
            _other(v, kind.value_type, chance) if i == place else v for i, v in enumerate(value)
        ]
    if isinstance(value, dict):
        name = chance.choice(sorted(value))
        return value | {name: _other(value[name], kind.field(name).type, chance)}
    return _other_value(value, chance)


def _some(kind: pa.DataType) -> Any:
    if pa.types.is_list(kind):
        return []
    if pa.types.is_boolean(kind):
        return True
    return "x" if pa.types.is_string(kind) else 1
