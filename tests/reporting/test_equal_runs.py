"""Values of an axis that give the same run are named, and none else."""

import re
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tests.reporting.conftest import run

from contactlab.reporting.equal_runs import describe_equal_runs
from contactlab.reporting.report_columns import GridAxis, read_axes
from contactlab.store.run_columns import RunColumns

SWEEP = """
version: 1
scene: ball_drop
duration: 0.5
axes:
  timestep: [2.0e-3, 5.0e-3, 1.0e-2]
  solref.timeconst: [5.0e-3, 1.0e-2]
  friction.roll: [1.0e-4, 1.0e-2]
"""


def axis_of(name: str, codes: list[int]) -> GridAxis:
    return GridAxis(name, "1", "knob", ("p", "q", "r"), np.array(codes), None)


def columns_of(hashes: list[int]) -> RunColumns:
    texts = np.array([f"{number:032x}" for number in hashes], "S32")
    return cast(RunColumns, SimpleNamespace(runs=len(hashes), byte_strings=lambda _name: texts))


rows = st.tuples(st.integers(0, 2), st.integers(0, 2), st.integers(0, 2))


@given(st.dictionaries(rows, st.integers(0, 3), min_size=1))
def test_sentences_agree_with_a_look_at_every_pair_of_runs(runs: dict[Any, int]) -> None:
    axes = [axis_of(name, [row[place] for row in runs]) for place, name in enumerate("abc")]
    sentences = [*describe_equal_runs(axes, columns_of([*runs.values()]))]
    for place, name in enumerate("abc"):
        groups = dict[Any, set[int]]()
        for (one, first), (other, second) in combinations(runs.items(), 2):
            rest = one[:place] + one[place + 1 :]
            if rest == other[:place] + other[place + 1 :] and first == second:
                groups.setdefault((rest, first), set()).update((one[place], other[place]))
        cases = {row[:place] + row[place + 1 :] for row in runs}
        own = [text for text in sentences if re.search(rf"(^|of ){name} (give|changes)", text)]
        if not groups:
            assert own == []
        elif len(groups) == len(cases) and all(len(each) == 3 for each in groups.values()):
            assert own[0].startswith(f"{name} changes no run: ")
        else:
            assert own[0].startswith(f"in {len(groups)} of {len(cases)} cases, values of {name} ")
            masks = sorted({sum(1 << code for code in each) for each in groups.values()})
            texts = [
                " = ".join("pqr"[code] for code in range(3) if mask >> code & 1) for mask in masks
            ]
            shown = "; ".join([*texts[:3], *(["..."] if len(texts) > 3 else [])])
            assert own[0].endswith(f"({shown})")


def test_runs_without_a_trajectory_equal_no_other() -> None:
    texts = np.array([b"", b"", b"", b"f" * 32], "S32")
    columns = cast(RunColumns, SimpleNamespace(runs=4, byte_strings=lambda _name: texts))
    axes = [axis_of("a", [0, 1, 0, 1]), axis_of("b", [0, 0, 1, 1])]
    assert [*describe_equal_runs(axes, columns)] == []


def test_refsafe_and_an_unloaded_friction_are_named(tmp_path: Path) -> None:
    """A time constant below two steps acts as two steps: both values at 5 and at 10 ms."""
    store = run(SWEEP, tmp_path)
    raised, unloaded = describe_equal_runs(read_axes(store), store.columns)
    assert raised == (
        "in 4 of 6 cases, values of solref.timeconst give the same run, bit for bit (5 ms = 10 ms):"
        " refsafe raises time constants to 2 timesteps"
    )
    assert unloaded.startswith("friction.roll changes no run: ")
