"""Numbers that JSON lacks are null in each report, whatever a study measured."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, ValidationError

from contactlab.schema.strict_model import FiniteOrNull, Model, finite_or_none


class Measure(Model):
    """A report with measured numbers."""

    value: FiniteOrNull
    values: tuple[FiniteOrNull, ...] = ()
    named: dict[str, FiniteOrNull] = Field(default_factory=dict)


@given(st.floats() | st.none(), st.lists(st.floats(), max_size=3))
def test_numbers_that_are_not_finite_are_null(value: float | None, values: list[float]) -> None:
    measure = Measure(value=value, values=tuple(values), named=dict.fromkeys("ab", value))
    written = json.loads(measure.model_dump_json())
    kept = None if value is None or not math.isfinite(value) else value
    assert written["value"] == kept
    assert written["named"] == {"a": kept, "b": kept}
    assert written["values"] == [one if math.isfinite(one) else None for one in values]
    assert Measure.model_validate_json(measure.model_dump_json()) == measure
    assert finite_or_none(value) == kept


def test_numbers_of_numpy_are_read_and_words_are_not() -> None:
    assert Measure(value=np.float64(np.inf)).value is None
    assert Measure(value=np.float64(0.5)).value == 0.5
    with pytest.raises(ValidationError):
        Measure.model_validate({"value": "many"})
