"""Two columns of one metric, run by run or as one statistic each."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from contactlab.compare.rules import Rule
from contactlab.compare.verdicts import (
    BETTER,
    CHANGED,
    MISSING,
    NOT_COMPARABLE,
    SAME,
    WORSE,
    Verdicts,
)
from contactlab.contact import Floats
from contactlab.store import Numbers

_SIGN = {"lower": 1.0, "higher": -1.0, "none": 1.0}
_STATISTICS: Mapping[str, Callable[[Floats], np.float64]] = {
    "mean": lambda values: values.mean(),
    "median": np.median,
}


def judged(rule: Rule, baseline: Floats, candidate: Floats) -> Verdicts:
    """Return the verdict of each pair of finite values.

    A change is beyond tolerance if it is larger than `abs + rel * |baseline|`.
    """
    change = _SIGN[rule.better] * (candidate - baseline)
    beyond = np.abs(change) > allowed(rule, baseline)
    if rule.better == "none":
        return np.where(beyond, CHANGED, SAME).astype(np.int8)
    return np.where(beyond, np.where(change > 0, WORSE, BETTER), SAME).astype(np.int8)


def allowed(rule: Rule, baseline: Floats) -> Floats:
    """Return the largest change within tolerance, in the metric's unit."""
    return rule.abs + rule.rel * np.abs(baseline)


def gaps(baseline: Numbers, candidate: Numbers, exempt: NDArray[np.bool_] | None) -> Verdicts:
    """Return the verdict of pairs of which a value is not there, or is no number; else same.

    Args:
        baseline: values (n,).
        candidate: values (n,).
        exempt: (n,) pairs of which one value was not asked for.
    """
    verdicts = np.zeros(len(baseline.values), dtype=np.int8)
    one = baseline.given != candidate.given
    if exempt is not None:
        one &= ~exempt
    verdicts[one & baseline.given] = MISSING
    verdicts[one & candidate.given] = CHANGED
    for side in (baseline, candidate):
        verdicts[side.given & ~np.isfinite(side.values)] = NOT_COMPARABLE
    return verdicts


def reduced(rule: Rule, baseline: Floats, candidate: Floats) -> tuple[Floats, Floats]:
    """Return the statistic of both sides, (1,) each, of pairs (n,) with n > 0.

    Of `ratio` these are 1 and the median over the pairs of candidate over baseline, 0 / 0 being 1.
    """
    if rule.statistic == "ratio":
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = np.where(candidate == baseline, 1.0, candidate / baseline)
        return np.ones(1), np.array([np.median(ratios)])
    if rule.statistic == "worst":
        pick = np.min if rule.better == "higher" else np.max
        return np.array([pick(baseline)]), np.array([pick(candidate)])
    statistic = _STATISTICS[rule.statistic]
    return np.array([statistic(baseline)]), np.array([statistic(candidate)])
