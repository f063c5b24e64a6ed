"""Numbers and names of a sweep file are the plain ones; those that look alike are refused."""

import math

import pytest

from contactlab.expression import Expression, ExpressionError
from contactlab.schema.setting_values import MEASURED_TEXT, parse_decimal, read_quantity


@pytest.mark.parametrize("text", ["\uff11.\uff10e-3", "\u0662", "1_000", "\u00b2"])
def test_other_digits_are_no_number(text: str) -> None:
    with pytest.raises(ValueError, match="digits 0 to 9"):
        parse_decimal(text)
    assert MEASURED_TEXT.fullmatch(f"{text} s") is None
    assert math.isnan(read_quantity(text)[0])


def test_letters_that_look_alike_are_named() -> None:
    with pytest.raises(ExpressionError, match="write 't'") as caught:
        Expression("1 < \uff54imestep")
    assert caught.value.start == 4
    Expression("label == 'h\u00f6her'")
