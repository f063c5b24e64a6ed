"""A journal of any length is read line by line, and the table written part by part."""

import json
import tracemalloc
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.json
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab.errors import StoreError
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store import runs_table
from contactlab.store.row_journal import (
    JOURNAL,
    encode_lines,
    parse_line,
    read_lines,
    repair_journal,
    with_checksum,
)
from contactlab.store.runs_table import Digests, RowsDigest, TableLimits, digests_of, write_table
from contactlab.store.table_layout import record_to_row, table_schema

Write = Callable[[int], Path]
RUNS = 60


@pytest.fixture(scope="module")
def lines(record_of: Callable[..., EvidenceRecord]) -> list[bytes]:
    rows = [record_to_row(record_of(index, label=f"label{index % 7}")) for index in range(RUNS)]
    return [json.dumps(row).encode() + b"\n" for row in rows]


@pytest.fixture
def write(
    tmp_path: Path,
    lines: list[bytes],
    record_of: Callable[..., EvidenceRecord],
    columns_of: Callable[..., Any],
    shared_part: Callable[..., Any],
) -> Write:
    """Write the table of all lines, in an order that a seed draws."""
    records = [record_of(index) for index in range(RUNS)]

    def of(seed: int) -> Path:
        order = np.random.default_rng(seed).permutation(RUNS)
        journal, target = tmp_path / JOURNAL, tmp_path / f"{seed}.parquet"
        journal.write_bytes(b"".join(with_checksum(lines[place][:-1]) for place in order))
        write_table(journal, target, columns_of(records), shared_part(records[0]))
        return target

    return of


def at_once(journal: Path, schema: pa.Schema) -> pa.Table:
    """Return a journal's rows by index, all read at once."""
    options = pyarrow.json.ParseOptions(explicit_schema=schema)
    lines = journal.read_bytes().splitlines()
    rows = b"\n".join(line.partition(b"\t")[0] for line in lines)
    read = pyarrow.json.read_json(pa.BufferReader(rows), parse_options=options)
    return read.select(schema.names).sort_by("index").cast(schema)


@pytest.mark.long
@pytest.mark.parametrize(("group", "block"), [(1 << 16, 8 << 20), (7, 1), (25, 10_000), (60, 1)])
def test_a_table_in_parts_is_the_table(
    write: Write,
    columns_of: Callable[..., Any],
    record_of: Callable[..., EvidenceRecord],
    group: int,
    block: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(runs_table, "GROUP", group)
    monkeypatch.setattr(runs_table, "LIMITS", TableLimits(block_bytes=block))
    path = write(0)
    schema = table_schema(columns_of([record_of(index) for index in range(RUNS)]))
    expected = at_once(path.with_name(JOURNAL), schema)
    assert pq.read_table(path).equals(expected)
    file = pq.ParquetFile(path)
    sizes = [file.metadata.row_group(each).num_rows for each in range(file.num_row_groups)]
    assert sizes == [min(group, RUNS - first) for first in range(0, RUNS, group)]


def jobs_of(lines: list[bytes], sizes: list[int]) -> list[list[bytes]]:
    """Return rows as the lines of jobs of these sizes, each row without what all of its job share.

    The rows of every second job are whole.
    """
    rest, jobs = [json.loads(each) for each in lines], list[list[bytes]]()
    for number, size in enumerate(sizes):
        rows, rest = rest[:size], rest[size:]
        items = [{name: json.dumps(each) for name, each in row.items()}.items() for row in rows]
        of_all = set.intersection(*map(set, items)) if number % 2 else set()
        own = [{k: v for k, v in row.items() if (k, json.dumps(v)) not in of_all} for row in rows]
        shared = json.dumps({name: json.loads(text) for name, text in of_all}) if of_all else ""
        jobs.append(encode_lines([json.dumps(row).encode() for row in own], shared.encode()))
    return jobs


@pytest.mark.long
@pytest.mark.parametrize("parts", [(1 << 16, 8 << 20), (7, 1), (25, 10_000)])
def test_what_rows_share_is_in_each_of_them(
    write: Write,
    lines: list[bytes],
    columns_of: Callable[..., Any],
    record_of: Callable[..., EvidenceRecord],
    parts: tuple[int, int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    group, block = parts
    monkeypatch.setattr(runs_table, "GROUP", group)
    monkeypatch.setattr(runs_table, "LIMITS", TableLimits(block_bytes=block))
    whole, records = write(0), [record_of(index) for index in range(RUNS)]
    jobs = jobs_of(lines, [1, 2, 3, 10, 4, 20, 20])
    journal, target = whole.with_name("jobs.jsonl"), whole.with_name("again.parquet")
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(jobs))
        journal.write_bytes(b"".join(line for place in order for line in jobs[place]))
        write_table(journal, target, columns_of(records), {})
        assert pq.read_table(target).equals(pq.read_table(whole))
        rows = {row["index"]: row for row in read_lines(journal)}
        assert [rows[index] for index in range(RUNS)] == [json.loads(each) for each in lines]


@pytest.mark.long
@given(data=st.data())
def test_no_row_takes_what_another_job_shares(data: st.DataObject, lines: list[bytes]) -> None:
    """Whatever lines are lost or exchanged, what is read is some of the rows."""
    jobs = jobs_of(lines, [4, 10, 3, 20, 5, 18])
    mixed = data.draw(st.permutations([line for job in jobs for line in job]))
    kept = mixed[: data.draw(st.integers(0, len(mixed)))]
    with TemporaryDirectory() as folder:
        journal = Path(folder) / JOURNAL
        journal.write_bytes(b"".join(kept))
        found = {row["run_id"]: row for row in read_lines(journal)}
        mended = repair_journal(Path(folder), accept, lambda _: True, repair=True)
        assert found == {row["run_id"]: row for row in read_lines(journal)}
    assert mended == found.keys()
    rows = {row["run_id"]: row for row in map(json.loads, lines)}
    assert all(row == rows[name] for name, row in found.items())


@pytest.mark.long
@pytest.mark.parametrize("block", [8 << 20, 5000, 1])
def test_a_row_lacks_what_is_not_in_its_line(
    write: Write,
    lines: list[bytes],
    columns_of: Callable[..., Any],
    record_of: Callable[..., EvidenceRecord],
    block: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(runs_table, "LIMITS", TableLimits(block_bytes=block))
    journal, target = write(0).with_name("some.jsonl"), write(0).with_name("some.parquet")
    columns, rng = columns_of([record_of(index) for index in range(RUNS)]), np.random.default_rng(1)
    names = rng.permutation([*json.loads(lines[0]).keys() - {"run_id", "index"}])
    rows: list[dict[str, Any]] = []
    for index, line in enumerate(lines):
        # Every row may have a field that none before it had.
        kept = {"run_id", "index", *rng.choice(names[: index + 1], 8)}
        rows.append({name: each for name, each in json.loads(line).items() if name in kept})
    journal.write_bytes(b"".join(with_checksum(json.dumps(row).encode()) for row in rows))
    write_table(journal, target, columns, {})
    whole = [dict.fromkeys(table_schema(columns).names) | row for row in rows]
    plain = pa.Table.from_pylist(whole, schema=table_schema(columns))
    assert pq.read_table(target).equals(plain)


def test_the_table_does_not_depend_on_the_order_in_which_runs_finished(write: Write) -> None:
    assert len({write(seed).read_bytes() for seed in range(3)}) == 1


def test_nor_on_how_much_is_read_at_once(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = write(0).read_bytes()
    monkeypatch.setattr(runs_table, "LIMITS", TableLimits(block_bytes=5000))
    assert write(0).read_bytes() == whole


@pytest.mark.long
def test_rows_have_one_digest_as_they_are_written_and_as_they_are_read(
    tmp_path: Path,
    lines: list[bytes],
    record_of: Callable[..., EvidenceRecord],
    columns_of: Callable[..., Any],
    shared_part: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    records = [record_of(index) for index in range(RUNS)]
    journal, target = tmp_path / JOURNAL, tmp_path / "table.parquet"
    journal.write_bytes(b"".join(with_checksum(line[:-1]) for line in lines))
    digests = set[object]()
    for group, block in ((1 << 16, 8 << 20), (7, 1), (25, 10_000)):
        monkeypatch.setattr(runs_table, "GROUP", group)
        monkeypatch.setattr(runs_table, "LIMITS", TableLimits(block_bytes=block))
        digests.add(write_table(journal, target, columns_of(records), shared_part(records[0])))
        digests.add(digests_of(target))
    assert len(digests) == 1


SAID = {
    "same": [1.0] * 6,
    "later": [1.0, 1.0, 1.0, 1.0, 2.0, None],
    "nothing": [None] * 6,
    "word": ["ab", "ab", "ab", "cd", "abab", "ab"],
    "list": [[1.0], [1.0], [], None, [1.0], [1.0]],
    "truth": [True, True, None, False, True, True],
}


def test_a_digest_is_of_every_value_however_many_are_read_at_once() -> None:
    kinds = {name: pa.array(said).type for name, said in SAID.items()} | {"nothing": pa.string()}
    schema = pa.schema(kinds, metadata={"contactlab.shared": "{}"})

    def digest(said: Mapping[str, Any], size: int) -> Digests:
        digest = RowsDigest()
        for rows in pa.table({**said}, schema=schema).to_batches(size):
            digest.add_rows(rows)
        return digest.digests_for(schema)

    assert len({digest(SAID, size) for size in range(1, 7)}) == 1
    other = {"same": 3.0, "later": 3.0, "nothing": "a", "word": "ad", "list": [2.0], "truth": None}
    changed = [
        {**SAID, name: [*said[:place], other[name], *said[place + 1 :]]}
        for name, said in SAID.items()
        for place in range(6)
        if said[place] != other[name]
    ]
    assert len({digest(said, 2) for said in (SAID, *changed)}) == 1 + len(changed) == 36


def line(run: int) -> bytes:
    return with_checksum(
        json.dumps({"run_id": f"{run:016x}", "index": run, "trace_file": None}).encode()
    )


def accept(row: Mapping[str, Any]) -> None:
    del row


RUN = st.integers(0, 20)
SOUND = RUN.map(line)
DAMAGED = st.one_of(
    RUN.map(lambda run: line(run)[:-5] + b"\n"),
    # Without its checksum.
    RUN.map(lambda run: line(run).partition(b"\t")[0] + b"\n"),
    RUN.map(lambda run: line(run).replace(b"null", b"nu1l")),
    RUN.map(lambda run: line(run).replace(b'"index": ', b'"index": 1')),
    st.sampled_from([b"\x00" * 9 + b"\n", b"5\n", b"null\n", b"[" * 5000 + b"\n", b"\n"]),
)
TORN = st.sampled_from([b"", line(99)[:-1], b'{"ru', b"\x00" * 40])


def slowly_mended(lines: list[bytes], is_whole: Callable[[Mapping[str, Any]], bool]) -> list[bytes]:
    """Return the lines that stay: those of whole runs, the first of each."""
    stay: dict[str, bytes] = {}
    for each in lines:
        row = json.loads(each.partition(b"\t")[0])
        if is_whole(row):
            stay.setdefault(row["run_id"], each)
    return list(stay.values())


def is_whole(row: Mapping[str, Any]) -> bool:
    return row["index"] % 5 != 0


@settings(deadline=None)
@given(pieces=st.lists(SOUND, max_size=12), torn=TORN)
def test_a_mended_journal_has_each_whole_run_once(
    pieces: list[bytes], torn: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    store = tmp_path_factory.mktemp("store")
    (store / JOURNAL).write_bytes(b"".join(pieces) + torn)
    stay = slowly_mended(pieces, is_whole)
    mended = repair_journal(store, accept, is_whole)
    assert mended == {json.loads(each.partition(b"\t")[0])["run_id"] for each in stay}
    assert (store / JOURNAL).read_bytes() == b"".join(stay)


@settings(deadline=None)
@given(before=st.lists(SOUND, max_size=5), damaged=DAMAGED, after=st.lists(SOUND, max_size=5))
def test_a_damaged_line_is_named_and_repair_drops_it_alone(
    before: list[bytes],
    damaged: bytes,
    after: list[bytes],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    store = tmp_path_factory.mktemp("store")
    text = b"".join([*before, damaged, *after])
    (store / JOURNAL).write_bytes(text)
    number = len(before) + 1
    with pytest.raises(StoreError, match=rf"journal\.jsonl, line {number} .*; add --repair to"):
        repair_journal(store, accept, is_whole)
    assert (store / JOURNAL).read_bytes() == text
    repair_journal(store, accept, is_whole, repair=True)
    assert (store / JOURNAL).read_bytes() == b"".join(slowly_mended([*before, *after], is_whole))


@given(data=st.data())
def test_any_flipped_bit_of_a_line_shows(data: st.DataObject, lines: list[bytes]) -> None:
    whole = with_checksum(data.draw(st.sampled_from(lines))[:-1])
    bit = data.draw(st.integers(0, 8 * (len(whole) - 1) - 1))
    changed = bytearray(whole)
    changed[bit // 8] ^= 1 << bit % 8
    with pytest.raises(ValueError, match=r"checksum|not JSON"):
        parse_line(bytes(changed))


def test_mending_holds_ids_and_no_rows(tmp_path: Path, lines: list[bytes]) -> None:
    rest = lines[0].strip().partition(b",")[2]
    with (tmp_path / JOURNAL).open("wb") as journal:
        journal.writelines(with_checksum(b'{"run_id":"%016x",' % run + rest) for run in range(3000))
    tracemalloc.start()
    kept = repair_journal(tmp_path, accept, lambda _: True)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(kept) == 3000
    # An id is a string of 65 bytes; a set has up to 8 slots of 16 bytes for each of its members,
    # and while it grows a second table a quarter as large; a flag is a byte. Beside them: one line
    # with its row, at most ten times its text, and buffers.
    assert peak < 3000 * (65 + 16 * 8 * 1.25 + 2) + 10 * len(lines[0]) + 300_000
    assert peak < 3000 * len(lines[0]) / 3
