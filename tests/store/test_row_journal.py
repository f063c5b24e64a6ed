"""Rows that jobs share fields of are read as they were before they shared them."""

import json
from pathlib import Path
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab.store.row_journal import encode_lines, read_lines, repair_journal
from contactlab.store.store_files import JOURNAL

FIELDS = st.dictionaries(st.sampled_from("abcdef"), st.integers() | st.text(max_size=3), max_size=4)
JOBS = st.lists(st.tuples(FIELDS, st.lists(FIELDS, min_size=1, max_size=2)), max_size=4)


@settings(max_examples=20)
@given(JOBS)
def test_each_row_has_the_shared_fields_of_its_own_job(
    tmp_path_factory: Any, jobs: list[tuple[dict[str, Any], list[dict[str, Any]]]]
) -> None:
    """Whatever jobs share, and in whatever order they end; a row's own fields come first."""
    folder: Path = tmp_path_factory.mktemp("journal")
    expected, lines = list[dict[str, Any]](), list[bytes]()
    for shared, rows in jobs:
        named = [
            {**row, "run_id": f"{len(expected) + place:016x}"} for place, row in enumerate(rows)
        ]
        text = json.dumps(shared).encode() if shared else b""
        lines += encode_lines([json.dumps(row).encode() for row in named], text)
        expected += [{**shared, **row} for row in named]
    (folder / JOURNAL).write_bytes(b"".join(lines))
    assert list(read_lines(folder / JOURNAL)) == expected
    seen = list[Any]()
    mended = repair_journal(folder, lambda row: seen.append(dict(row)), lambda _: True)
    assert (seen, mended) == (expected, {row["run_id"] for row in expected})
