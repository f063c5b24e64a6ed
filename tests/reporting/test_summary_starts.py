"""A summary blames the start of runs that fail at once only if no setting makes it stable."""

from typing import Any

import numpy as np
import pytest

from contactlab.reporting.report_columns import GridAxis, RunLabels
from contactlab.reporting.store_document import has_stable_start


def axis_of(name: str, codes: list[int]) -> GridAxis:
    ticks = tuple(map(str, range(max(codes) + 1)))
    return GridAxis(name, "", "knob", ticks, np.array(codes), None)


@pytest.mark.parametrize(
    ("axes", "failed", "blameless"),
    [
        # Two heights at two timesteps; of the second height, the short timestep is stable.
        ({"drop_height": [0, 0, 1, 1], "timestep": [0, 1, 0, 1]}, [1, 1, 0, 1], [0, 0, 1, 1]),
        # A coordinate of the start is no setting, and neither is friction: a property of matter.
        ({"box.vx": [0, 0, 1, 1], "solref": [0, 1, 0, 1]}, [0, 1, 1, 1], [1, 1, 0, 0]),
        ({"friction.slide": [0, 1]}, [0, 1], [1, 0]),
        ({"timestep": [0, 1]}, [0, 1], [1, 1]),
    ],
)
def test_a_start_with_a_stable_run_is_not_to_blame(
    axes: dict[str, list[int]], failed: list[int], blameless: list[int]
) -> None:
    codes: Any = np.array([0 if each else 1 for each in failed])
    labels = RunLabels(("chatter", "stable"), ("C", ""), (), codes, codes, ())
    found = has_stable_start([axis_of(*each) for each in axes.items()], labels)
    assert found.astype(int).tolist() == blameless
