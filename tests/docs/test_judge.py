"""The derivation lists each label and each constant of the judge, and no other."""

import re
from pathlib import Path

from bench.judge_count import constants

from contactlab.measure import LABELS

_ROOT = Path(__file__).parents[2]
_TEXT = (_ROOT / "docs/theory/error-budget.md").read_text(encoding="utf-8")
_LISTS = _TEXT.partition("## Labels, limits and constants\n")[2]


def cells(table: str) -> list[list[str]]:
    rows = [line.strip("|").split("|") for line in table.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in row] for row in rows[1:]]


def test_every_label_has_a_reason() -> None:
    listed = [name for row in cells(_LISTS.partition("\nThe constants")[0]) for name in row[1:2]]
    names = [name for cell in listed for name in re.findall(r"`(\w+)`", cell)]
    assert sorted(names) == sorted(label for label in LABELS if not LABELS[label].is_added)


def test_every_constant_has_a_reason() -> None:
    rows = cells(_LISTS.partition("\nThe constants")[2])
    listed = [(row[0].strip("`"), name) for row in rows for name in re.findall(r"`(\w+)`", row[1])]
    assert sorted(listed) == sorted(constants(_ROOT))
    assert all(row[2] and row[3] for row in rows)
