"""Every number has one spelling, with its unit."""

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.rendering.amounts import (
    format_amount,
    format_digits,
    format_interval,
    format_setting,
)

UNITS = ("%", "x", "count", "N", "B", "mm", "mm/s", "ms", "us", "s", "m", "", "1")


@given(power=st.floats(0, 11.9))
def test_a_force_has_the_prefix_that_leaves_one_to_three_digits_before_the_point(
    power: float,
) -> None:
    number, unit = format_amount(10**power, "N").split()
    assert float(number) * {"N": 1, "kN": 1e3, "MN": 1e6, "GN": 1e9}[unit] == pytest.approx(
        10**power, rel=0.051
    )
    assert 1 <= float(number) <= 1000


@pytest.mark.parametrize("size", [4_300, 123_456, 43_000_000, 999e6, 1e9, 92e9, 553e9])
def test_sizes_are_millions_or_billions_of_bytes(size: float) -> None:
    number, unit = format_amount(size, "B").split()
    assert float(number) * {"MB": 1e6, "GB": 1e9}[unit] == pytest.approx(size, rel=5e-3)
    assert (unit == "GB") == (size >= 1e9)


@pytest.mark.parametrize("seconds", [0.3, 98, 119, 5930, 5950, 3e5, 4e5, 3e9])
def test_long_times_are_minutes_hours_and_days(seconds: float) -> None:
    number, unit = format_amount(seconds, "long").split()
    read = {"s": 1, "min": 60, "h": 3600, "days": 86_400}
    assert float(number.replace(",", "")) * read[unit] == pytest.approx(seconds, rel=0.11)
    assert "e+" not in number


@pytest.mark.parametrize(
    ("value", "said"),
    [((0.02, 1.0), "0.02 1"), ("elliptic", "elliptic"), (1 / 3, "0.333333"), (True, "True")],
)
def test_a_setting_is_written_as_in_a_model(value: object, said: str) -> None:
    assert format_setting(value) == said


@pytest.mark.parametrize(
    ("value", "unit", "said"),
    [
        (0.104, "%", "10 %"),
        (0.00104, "%", "0.1 %"),
        (42.0, "%", "4200 %"),
        (0.98, "x", "x0.98"),
        (0.0123, "x", "x0.012"),
        (12345, "count", "12,345"),
        (12345.0, "N", "12 kN"),
        (0.0123, "mm", "12.3 mm"),
        (1e-4, "mm/s", "0.1 mm/s"),
        (0.002, "ms", "2 ms"),
        (2.5e-6, "us", "2.5 us"),
        (1.5, "s", "1.5 s"),
        (1234.5, "", "1234"),
        (math.inf, "%", "∞"),
        (-math.inf, "s", "-∞"),
        (math.nan, "mm", "-"),
        (None, "%", "-"),
    ],
)
def test_numbers_have_their_units(value: float | None, unit: str, said: str) -> None:
    assert format_amount(value, unit) == said


@given(st.floats(1e-3, 9e4), st.integers(1, 6))
def test_digits_round_to_their_number(number: float, digits: int) -> None:
    text = format_digits(number, digits)
    assert "e" not in text
    assert float(text) == pytest.approx(number, rel=0.51 * 10 ** (1 - digits), abs=0.5)


@given(st.floats(1e-3, 10.0), st.sampled_from(UNITS))
def test_a_sign_is_written_if_it_is_wanted(value: float, unit: str) -> None:
    plain = format_amount(value, unit)
    assert format_amount(value, unit, signed=True) == f"+{plain}"
    assert format_amount(-value, "%", signed=True) == format_amount(-value, "%")


@given(st.floats(0, 1), st.floats(0, 1))
def test_an_interval_writes_its_unit_once(low: float, high: float) -> None:
    assert format_interval(low, high).count("%") == 1
    both = f"{format_amount(low, '%')} to {format_amount(high, '%')}"
    assert format_interval(low, high) == re.sub(" % to", " to", both)
    assert format_interval(0.78, 0.82, "x") == "0.78 to 0.82"
