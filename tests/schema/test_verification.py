"""A verification says how much of it was made."""

import pytest

from contactlab.schema.verification import VerifiedChange, VerifiedMeasure

MEASURE = VerifiedMeasure(
    name="depth", unit="m", run="task", place="box", before=1e-3, after=1e-3, spread=0.0,
    tolerance=1e-4, worse=False,
)  # fmt: skip


@pytest.mark.parametrize(
    ("measures", "ended_early", "begin"),
    [
        ((MEASURE,), False, "verified: "),
        ((MEASURE,), True, "verified in part: "),
        ((), True, "not verified: "),
    ],
)
def test_a_result_says_whether_its_runs_were_made(
    measures: tuple[VerifiedMeasure, ...], ended_early: bool, begin: str
) -> None:
    found = VerifiedChange(
        measures=measures, identical=False, passed=True, sentence="s", ended_early=ended_early
    )
    assert found.line.startswith(f"{begin}s")
