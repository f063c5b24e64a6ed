"""The summary of a sweep has rows for axes that matter, and names the others in a sentence."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from contactlab.rendering.document import Sentence, Table
from contactlab.reporting.report_columns import GridAxis
from contactlab.reporting.store_document import tabulate_axis_values

RUNS = 8


@given(codes=st.lists(st.integers(0, 2), min_size=RUNS, max_size=RUNS))
def test_an_axis_has_rows_exactly_if_its_values_differ(codes: list[int]) -> None:
    ticks = [np.arange(RUNS) >> bit & 1 for bit in range(3)]
    axes = [
        GridAxis(name, "1", "knob", ("0", "1"), each, None)
        for name, each in zip("abc", ticks, strict=True)
    ]
    labels: Any = SimpleNamespace(codes=np.array(codes), names=("stable", "chatter", "tunneling"))
    blocks = [*tabulate_axis_values(axes, labels, lambda part, whole: f"{part}/{whole}")]
    rows = [row.cells[0] for block in blocks if isinstance(block, Table) for row in block.rows]
    said = [block.text for block in blocks if isinstance(block, Sentence)]
    for name, each in zip("abc", ticks, strict=True):
        low, high = (sorted(labels.codes[each == code].tolist()) for code in (0, 1))
        assert rows.count(name) == (0 if low == high else 2)
        assert any(name in text[len("The same counts at each value of ") :] for text in said) == (
            low == high
        )
