"""Reasons of labels say how much as a person would, of any number."""

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.measure.amounts import format_amount, readable_fraction


@pytest.mark.parametrize(
    ("ratio", "said"),
    [
        *((0.0123, "1.23 % of"), (0.5, "50 % of"), (1.0, "1 times"), (4.25, "4.25 times")),
        *((4617.76, "4,618 times"), (4.9e10, "more than a million times"), (2e-7, "2e-07 of")),
        *((math.inf, "beyond all numbers"), (math.nan, "beyond all numbers")),
    ],
)
def test_ratios_are_said_in_words(ratio: float, said: str) -> None:
    assert readable_fraction(ratio) == said


@given(st.floats(1e-4) | st.just(math.nan))
def test_no_ratio_is_said_with_more_than_seven_digits(ratio: float) -> None:
    for said in (readable_fraction(ratio), format_amount(ratio)):
        assert len(re.findall(r"[0-9]", said)) <= 7
        assert "e+" not in said
        assert "nan" not in said
        assert "inf" not in said
