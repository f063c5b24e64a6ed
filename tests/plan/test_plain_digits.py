"""Numbers and names of a sweep file are the plain ones; those that look alike are refused."""

import math
from pathlib import Path

import numpy as np
import pytest

from contactlab.errors import SceneError
from contactlab.expression import Expression, ExpressionError
from contactlab.plan.included_rows import parse_cell
from contactlab.schema.setting_values import MEASURED_TEXT, parse_decimal, read_quantity
from contactlab.store.control_tables import read_control_table


@pytest.mark.parametrize("text", ["\uff11.\uff10e-3", "\u0662", "1_000", "\u00b2"])
def test_other_digits_are_no_number(text: str) -> None:
    with pytest.raises(ValueError, match="digits 0 to 9"):
        parse_decimal(text)
    assert MEASURED_TEXT.fullmatch(f"{text} s") is None
    assert math.isnan(read_quantity(text)[0])


def test_tables_have_plain_digits(tmp_path: Path) -> None:
    (tmp_path / "push.csv").write_text("time,push\n0,\u0661\n1,1_0\n2,3\n", encoding="utf-8")
    assert read_control_table(tmp_path / "push.csv")["push"].tolist()[2:] == [3]
    assert all(map(math.isnan, read_control_table(tmp_path / "push.csv")["push"][:2]))
    for text in ("\u0661e-3", "1_0e-4", "\uff11"):
        assert parse_cell(text) == text
    assert [parse_cell(text) for text in ("1", "-2", "1e3", "x")] == [1, -2, 1000.0, "x"]
    np.savez(tmp_path / "push.npz", time=np.arange(2.0), push=np.array([1, 1j]))
    with pytest.raises(SceneError, match="complex"):
        read_control_table(tmp_path / "push.npz")


def test_letters_that_look_alike_are_named() -> None:
    with pytest.raises(ExpressionError, match="write 't'") as caught:
        Expression("1 < \uff54imestep")
    assert caught.value.start == 4
    Expression("label == 'h\u00f6her'")
