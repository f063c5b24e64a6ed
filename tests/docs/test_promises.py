"""Each promise names tests that exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", ["SECURITY.md", "docs/how-to/stores.md"])
def test_each_promise_has_tests(name: str) -> None:
    text = (ROOT / name).read_text()
    _, table = re.split(r"\| promise \| test \|\n\|---\|---\|\n", text)
    rows = [line for line in table.partition("\n\n")[0].splitlines() if line]
    assert len(rows) > 4
    for row in rows:
        files = re.findall(r"`(tests/[^`]+)`", row)
        assert files, row
        for file in files:
            assert "\ndef test_" in (ROOT / file).read_text(), file
