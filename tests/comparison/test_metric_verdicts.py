"""Judging two columns at once is judging each pair by itself."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.comparison.metric_checks import aggregate_values, gap_verdicts, judge_changes
from contactlab.judge.policies import EffectiveRule
from contactlab.judge.subjects import (
    BETTER,
    CHANGED,
    MISSING,
    NAMES,
    NOT_COMPARABLE,
    SAME,
    WORSE,
    Subject,
    verdict_counts,
)
from contactlab.store.run_columns import NumberColumn

REALS = st.floats(-1e6, 1e6)
RULES = st.builds(
    EffectiveRule,
    better=st.sampled_from(["lower", "higher", "none"]),
    rel=st.floats(0, 1),
    abs=st.floats(0, 1),
    statistic=st.just("each"),
    by=st.just(()),
    budget=st.just(0.0),
    level=st.just("gate"),
    needs_same=st.just(()),
)


def rule(**changes: Any) -> EffectiveRule:
    plain: dict[str, Any] = {
        "better": "lower",
        "rel": 0.0,
        "abs": 0.0,
        "statistic": "each",
        "by": (),
        "budget": 0.0,
        "level": "gate",
        "needs_same": (),
    }
    return EffectiveRule(**{**plain, **changes})


def one_by_one(each: EffectiveRule, before: float, after: float) -> int:
    """Judge one pair, as the policy's text says."""
    if abs(after - before) <= each.abs + each.rel * abs(before):
        return SAME
    if each.better == "none":
        return CHANGED
    rose = after > before
    return WORSE if rose == (each.better == "lower") else BETTER


@given(RULES, st.lists(st.tuples(REALS, REALS), min_size=1))
def test_all_pairs_at_once(each: EffectiveRule, pairs: list[tuple[float, float]]) -> None:
    before, after = (np.array(column) for column in zip(*pairs, strict=True))
    assert judge_changes(each, before, after).tolist() == [
        one_by_one(each, *pair) for pair in pairs
    ]


@given(st.lists(st.tuples(REALS, REALS), min_size=1), st.sampled_from(["lower", "higher"]))
def test_swapped_sides_swap_better_and_worse(pairs: list[tuple[float, float]], better: str) -> None:
    """Without a share of the baseline in the tolerance, which is not symmetric."""
    before, after = (np.array(column) for column in zip(*pairs, strict=True))
    swapped = {SAME: SAME, BETTER: WORSE, WORSE: BETTER}
    each = rule(better=better, abs=1.0)
    there = judge_changes(each, before, after).tolist()
    assert judge_changes(each, after, before).tolist() == [swapped[verdict] for verdict in there]


VALUES = st.none() | st.sampled_from([math.nan, math.inf, -math.inf]) | REALS


def column(values: list[float | None]) -> NumberColumn:
    return NumberColumn(
        np.array([math.nan if value is None else value for value in values]),
        np.array([value is not None for value in values]),
    )


@given(st.lists(st.tuples(VALUES, VALUES, st.booleans()), min_size=1))
def test_what_is_not_there_is_never_the_same(
    pairs: list[tuple[float | None, float | None, bool]],
) -> None:
    before, after, exempt = (list(each) for each in zip(*pairs, strict=True))
    found = gap_verdicts(column(before), column(after), np.array(exempt)).tolist()
    for verdict, old, new, free in zip(found, before, after, exempt, strict=True):
        given_values = [value for value in (old, new) if value is not None]
        if not all(math.isfinite(value) for value in given_values):
            assert verdict == NOT_COMPARABLE
        elif len(given_values) == 1 and not free:
            assert verdict == (MISSING if new is None else CHANGED)
        else:
            assert verdict == SAME


@pytest.mark.parametrize(
    ("statistic", "better", "expected"),
    [
        ("mean", "lower", (2.0, 4.0)),
        ("median", "lower", (2.0, 3.0)),
        ("worst", "lower", (3.0, 8.0)),
        ("worst", "higher", (1.0, 1.0)),
        # Ratios 8, 0.5 and 1.
        ("ratio", "lower", (1.0, 1.0)),
    ],
)
def test_statistics(statistic: str, better: str, expected: tuple[float, float]) -> None:
    before, after = np.array([1.0, 2.0, 3.0]), np.array([8.0, 1.0, 3.0])
    values = aggregate_values(rule(statistic=statistic, better=better), before, after)
    assert tuple(float(each[0]) for each in values) == expected


def test_ratios_to_zero() -> None:
    """0 / 0 is 1 and 1 / 0 without bound, so that the median of these and 6 / 2 is 3."""
    values = aggregate_values(
        rule(statistic="ratio"), np.array([0.0, 0.0, 2.0]), np.array([0.0, 1.0, 6.0])
    )
    assert values[1].tolist() == [3.0]


@given(st.lists(st.sampled_from(range(len(NAMES)))))
def test_a_fold_is_the_worst_and_counts_add_up(codes: list[int]) -> None:
    verdicts = np.array(codes, dtype=np.int8)
    assert Subject("check", "metrics", "gate").make_finding(verdicts, "").verdict == (
        NAMES[max(codes)] if codes else "same"
    )
    assert sum(verdict_counts(verdicts).values()) == len(codes)
