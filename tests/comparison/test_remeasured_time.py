"""Times measured anew: the protocol, the order of turns and the interval."""

import math
import sys
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.comparison.compare_stores import compare_stores
from contactlab.comparison.metric_checks import Remeasure
from contactlab.comparison.report import report_of
from contactlab.errors import PolicyError, StoreError
from contactlab.run.stored_runs import timing_process
from contactlab.schema.comparison import ComparisonReport
from contactlab.schema.finding import Finding
from contactlab.shares import median_interval
from contactlab.writers import as_text

Runs = Callable[[], Any]
Stored = Callable[..., Path]
# Answers like the real one: FACTOR tenths of a second for 100 steps, and keeps a diary.
TIMER = """\
#!{python}
import json, sys
print(json.dumps({{"engine": "fake {factor}", "timed_engines": ["mujoco"]}}), flush=True)
for line in sys.stdin:
    asked = json.loads(line)
    with open({diary!r}, "a") as diary:
        diary.write("{factor} " + asked["run"] + "\\n")
    if asked["run"] == {refused!r}:
        print(json.dumps({{"error": "it is raining"}}), flush=True)
    else:
        seconds = {factor} * 0.1 * asked["repeats"]
        print(json.dumps({{"seconds": seconds, "steps": 100 * asked["repeats"]}}), flush=True)
"""


@pytest.fixture
def timer(tmp_path: Path) -> Callable[..., Path]:
    """Make a program that answers as a Python with contactlab would."""

    def make(factor: float, refused: str = "") -> Path:
        path = tmp_path / f"python-{factor}"
        diary = str(tmp_path / "diary")
        text = TIMER.format(python=sys.executable, factor=factor, diary=diary, refused=refused)
        path.write_text(text)
        path.chmod(0o755)
        return path

    return make


def remeasured(report: ComparisonReport) -> Finding:
    (check,) = [each for each in report.findings if each.name == "remeasured_time no worse"]
    return check


def remeasure(runs: int, *pythons: Path) -> Remeasure:
    return Remeasure(runs, *(partial(timing_process, python) for python in pythons))


@pytest.mark.long
@pytest.mark.parametrize(
    ("factors", "verdict", "code"),
    [
        ((1.0, 1.0), "same", 0),
        ((1.0, 1.04), "same", 0),
        ((1.0, 2.0), "worse", 1),
        ((2.0, 1.0), "better", 0),
    ],
)
def test_a_slower_engine_fails_the_gate(
    baseline: Path,
    runs: Runs,
    stored: Stored,
    timer: Callable[..., Path],
    factors: tuple[float, float],
    verdict: str,
    code: int,
) -> None:
    asked = remeasure(3, *(timer(factor) for factor in factors))
    report = compare_stores(baseline, stored("again", runs()), remeasure=asked)
    found = remeasured(report)
    assert (found.verdict, report.exit_code, found.judged) == (verdict, code, 3)
    ratio = f"{factors[1] / factors[0]:.3f}"
    message = f"median ratio {ratio}, 95 % interval {ratio} to {ratio} over 3 runs (tolerance 5 %; "
    assert found.message == f"{message}fake {factors[0]}, now fake {factors[1]})"
    assert found.message in as_text(report_of(report))


def test_runs_take_turns(
    baseline: Path, runs: Runs, stored: Stored, timer: Callable[..., Path], tmp_path: Path
) -> None:
    """Each pair is warmed up once in both, then timed in the order ABBA."""
    asked = remeasure(2, timer(1.0), timer(1.5))
    compare_stores(baseline, stored("again", runs()), remeasure=asked)
    first, last = f"{1:016x}", f"{8:016x}"
    turns = ("1.0", "1.5", "1.0", "1.5", "1.5", "1.0")
    expected = [f"{turn} {run}" for run, turn in product((first, last), turns)]
    assert (tmp_path / "diary").read_text().splitlines() == expected


def crash_run(runs: Any, index: int) -> None:
    runs.label(index, "crashed")
    nothing = dict.fromkeys(runs.runs[index].metrics)
    ended = {"status": "crashed", "status_reason": "it fell", "steps": 0, "trajectory_hash": None}
    runs.change(index, metrics=nothing, cost=None, **ended)


def test_runs_that_did_not_go_through_are_not_timed(
    baseline: Path, runs: Runs, stored: Stored, timer: Callable[..., Path], tmp_path: Path
) -> None:
    crashed = runs()
    for index in range(1, 8):
        crash_run(crashed, index)
    compare_stores(baseline, stored("crashed", crashed), remeasure=remeasure(8, timer(1), timer(2)))
    diary = (tmp_path / "diary").read_text().split()
    assert set(diary[1::2]) == {f"{1:016x}"}
    crash_run(crashed, 0)
    report = compare_stores(
        baseline, stored("all", crashed), remeasure=remeasure(8, timer(1), timer(2))
    )
    assert remeasured(report).outcome == "skipped"
    assert report.exit_code == 1  # Their labels and metrics changed, too.


def test_a_run_that_cannot_be_timed(
    baseline: Path, runs: Runs, stored: Stored, timer: Callable[..., Path]
) -> None:
    asked = remeasure(1, timer(1.0), timer(2.0, refused=f"{1:016x}"))
    with pytest.raises(StoreError, match=r"cannot time run 0*1: it is raining"):
        compare_stores(baseline, stored("again", runs()), remeasure=asked)


@pytest.mark.parametrize("program", ["/nowhere/python", "/bin/true", "/bin/echo"])
def test_what_is_no_python_with_contactlab(
    baseline: Path, runs: Runs, stored: Stored, timer: Callable[..., Path], program: str
) -> None:
    asked = remeasure(1, timer(1.0), Path(program))
    with pytest.raises(PolicyError, match=r"cannot run|is this version of contactlab installed"):
        compare_stores(baseline, stored("again", runs()), remeasure=asked)


@given(st.integers(1, 12))
def test_the_interval_holds_the_median_often_enough(n: int) -> None:
    """Of all 2^n ways in which n values lie about the median, at most 5 % leave it out.

    Ranks 0..n-1 stand for the values; a way says how many of them lie below. With five or fewer
    values, the two ways in which all lie on one side are more than 5 %.
    """
    low, high = median_interval([float(value) for value in range(n)])
    chances = [math.comb(n, below) / 2**n for below in range(n + 1)]
    missed = sum(chance for below, chance in enumerate(chances) if not low < below <= high)
    assert missed <= 0.05 or n <= 5
    narrower = sum(
        chance for below, chance in enumerate(chances) if not low + 1 < below <= high - 1
    )
    assert narrower > 0.05 or n <= 5


def test_the_interval_covers_drawn_medians() -> None:
    """Of 400 draws at least 93 % cover: 95 % less two standard errors of 1.1 %."""
    rng = np.random.default_rng(0)
    draws = [median_interval(rng.exponential(size=20).tolist()) for _ in range(400)]
    covered = sum(low <= math.log(2) <= high for low, high in draws)
    assert covered >= 0.928 * len(draws)
