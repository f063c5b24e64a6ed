"""Faults planted in a scene must show: each turns an expectation of a closed-form case red."""

from collections.abc import Callable
from typing import Any

import pytest

Rows = list[dict[str, Any]]
Planted = Callable[[str, str, str], Rows]


def unmet(rows: Rows) -> int:
    return sum(row["expectation_met"] is False for row in rows)


@pytest.mark.night
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("isotropy", 'friction="0.5 ', 'friction="0.525 '),
        ("incline", 'friction="0.5 ', 'friction="0.525 '),
        ("slide_directions", 'friction="0.5 ', 'friction="0.525 '),
        ("ladder", 'friction="0.3 ', 'friction="0.315 '),
        ("isotropy", "<option ", '<option gravity="0 0 -9.9081" '),
        ("free_fall", "<option ", '<option gravity="0 0 -9.9081" '),
        ("rest_penetration", "<option ", '<option gravity="0 0 -9.9081" '),
        ("isotropy", 'solref="0.02 1"', 'solref="0.022 1"'),
    ],
)
def test_planted_faults_show(planted: Planted, name: str, old: str, new: str) -> None:
    assert unmet(planted(name, old, new)) > 0


@pytest.mark.night
def test_nothing_planted_shows_nothing(planted: Planted) -> None:
    assert unmet(planted("isotropy", "<option ", "<option ")) == 0
