"""Changes of values as text: their unit, their digits, and their relative size."""

import pytest

from contactlab.judge.wording import format_change, value_change


@pytest.mark.parametrize(
    ("before", "after", "unit", "said"),
    [
        (1.734e-3, 1.793e-3, "m", "1.73 -> 1.79 mm"),
        (0.0, 5e-5, "m/s", "0 -> 0.05 mm/s"),
        (0.05, 0.2, "m", "0.05 -> 0.2 m"),
        (0.0, 0.0, "m", "0 -> 0 m"),
        (0.01, 0.02, "rad", "0.01 -> 0.02 rad"),
        (2.0, 3.0, "1", "2 -> 3"),
        (1.0000001, 1.0000002, "s", "1.0000001 -> 1.0000002 s"),
    ],
)
def test_small_lengths_are_in_millimeters_and_equal_digits_are_continued(
    before: float, after: float, unit: str, said: str
) -> None:
    assert format_change(before, after, unit, 3) == said


def test_a_change_is_a_share_of_the_baseline() -> None:
    assert value_change(0.001, 0.0015, "m") == "1 -> 1.5 mm (+50 %)"
