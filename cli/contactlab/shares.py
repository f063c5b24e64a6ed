"""Shares of runs, and their confidence intervals."""

import math
from collections.abc import Callable, Sequence
from statistics import fmean, stdev

SURE = 0.95
_Z = 1.959963984540054  # 95 % of a normal distribution lie within this distance
_Z_POWER = 0.8416212335729143  # 80 % of it lie below


def wilson_interval(good: int, runs: int) -> tuple[float, float]:
    """Return the interval of 95 % of a share of runs that were counted once.

    The score interval of E. B. Wilson, "Probable inference, the law of succession, and statistical
    inference", 1927: the shares p at a distance of at most z sqrt(p (1 - p) / n) from the observed
    one. Who looks again and again, and stops where it suits, needs `anytime_interval`.
    """
    share, weight = good / runs, _Z * _Z / runs
    centre = (share + weight / 2) / (1 + weight)
    reach = _Z * math.sqrt(share * (1 - share) / runs + weight / (4 * runs)) / (1 + weight)
    # For none and for all, the ends are 0 and 1; rounding would miss them.
    return centre - reach if good else 0.0, centre + reach if good < runs else 1.0


def anytime_interval(good: int, runs: int, sure: float = SURE) -> tuple[float, float]:
    """Return the interval of a share that holds at all numbers of runs at once.

    A share p is left out once 1 / ((n + 1) C(n, k) p^k (1 - p)^(n - k)), the likelihood of k of n
    averaged over all shares and divided by that of p, has reached 1 / (1 - sure). Under p it is a
    martingale that starts at 1, so that it ever reaches that with a chance of at most 1 - sure
    (J. Ville, 1939; H. Robbins, "Statistical methods related to the law of the iterated logarithm",
    1970). So one may look after each run, and stop at any.
    """
    if not runs:
        return 0.0, 1.0
    share = good / runs
    return _interval_end(good, runs, sure, share, 0.0), _interval_end(good, runs, sure, share, 1.0)


def evidence_against(share: float, good: int, runs: int) -> float:
    """Return the logarithm of that martingale, of one share."""
    bad = runs - good
    ways = math.lgamma(runs + 1) - math.lgamma(good + 1) - math.lgamma(bad + 1)
    likely = sum(
        count * math.log(chance) if count and chance > 0 else -math.inf if count else 0.0
        for count, chance in ((good, share), (bad, 1 - share))
    )
    return -math.log(runs + 1) - ways - likely


def median_interval(values: Sequence[float], sure: float = SURE) -> tuple[float, float]:
    """Return a confidence interval of the median of the distribution of independent values.

    Its ends are the k-th sorted value from each end, with the largest k such that fewer than k of n
    fair coins show heads with a probability of at most half of 1 - `sure`, 2.5 % by default. With
    five values or fewer it is then their range, which covers less than 95 %.
    """
    ordered, n = sorted(values), len(values)
    chance, k = 0.0, 0
    while (chance := chance + math.comb(n, k) / 2**n) <= (1 - sure) / 2:
        k += 1
    k = max(k, 1)
    return ordered[k - 1], ordered[n - k]


def mean_interval(values: Sequence[float], sure: float = SURE) -> tuple[float, float]:
    """Return a confidence interval of the mean of the distribution of independent values.

    It is Student's. A few large values make the mean of many larger than most means of few; N. J.
    Johnson's correction for skewness, 1978, moves the end on their side. A single value has itself.
    """
    from scipy.special import stdtrit  # noqa: PLC0415 - it takes a while to load

    count, mean = len(values), fmean(values)
    spread = stdev(values) if count > 1 else 0.0
    if not spread:
        return mean, mean
    wide = float(stdtrit(count - 1, (1 + sure) / 2))
    half = wide * spread / math.sqrt(count)
    cubes = sum((value - mean) ** 3 for value in values)
    cubes *= count / max(1.0, (count - 1) * (count - 2))
    skew = (1 + 2 * wide**2) * cubes / (6 * count * spread**2)
    return mean - half + min(0.0, skew), mean + half + max(0.0, skew)


def _interval_end(good: int, runs: int, sure: float, inner: float, outer: float) -> float:
    limit = -math.log1p(-sure)
    return _bisect_end(lambda share: evidence_against(share, good, runs) < limit, inner, outer)


def _bisect_end(holds: Callable[[float], bool], inner: float, outer: float) -> float:
    """Return where something ceases to hold, between where it does and an end."""
    if holds(outer):
        return outer
    halvings = 60
    for _ in range(halvings):
        middle = (inner + outer) / 2
        if holds(middle):
            inner = middle
        else:
            outer = middle
    return outer


def paired_difference(gained: int, lost: int, pairs: int) -> tuple[float, float]:
    """Return the interval of 95 % of the difference of two shares of the same cases.

    `gained` and `lost` are the numbers of changed cases among all pairs. The score interval of T.
    Tango, "Equivalence test and confidence interval for the difference in proportions for the
    paired-sample design", 1998: the differences within 1.96 deviations of the one observed.
    """
    share = (gained - lost) / pairs

    def near(difference: float) -> bool:
        return abs(paired_score(gained, lost, pairs, difference)) <= _Z

    return _bisect_end(near, share, -1.0), _bisect_end(near, share, 1.0)


def paired_score(gained: float, lost: float, pairs: int, difference: float) -> float:
    """Return by how many deviations the cases gained and lost differ from a difference of shares.

    The deviation is that of the likeliest shares that have the difference.
    """
    slope = (2 * pairs - gained + lost) * difference - gained - lost
    constant = -lost * difference * (1 - difference)
    likely = (math.sqrt(slope * slope - 8 * pairs * constant) - slope) / (4 * pairs)
    variance = pairs * (2 * likely + difference * (1 - difference))
    apart = gained - lost - pairs * difference
    if variance <= 0:
        return math.copysign(math.inf, apart) if apart else 0.0
    return apart / math.sqrt(variance)


def paired_chance(gained: int, lost: int) -> float:
    """Return the chance of so unequal numbers of cases gained and lost, were both as likely.

    The exact test of Q. McNemar, 1947: two-sided, binomial.
    """
    both = gained + lost
    tail = sum(math.comb(both, count) for count in range(min(gained, lost) + 1))
    return min(1.0, 2 * tail / 2**both)


def unequal_chance(some: int, runs: int, others: int, other_runs: int) -> float:
    """Return the chance of `some` or more cases in some runs, were they like the others.

    The exact test of R. A. Fisher, 1934: one-sided, hypergeometric.
    """

    def log_ways(whole: int, part: int) -> float:
        ends = math.lgamma(part + 1) + math.lgamma(whole - part + 1)
        return math.lgamma(whole + 1) - ends

    cases = some + others
    every = log_ways(runs + other_runs, cases)
    most_likely = cases * runs / max(1, runs + other_runs)
    chance = 0.0
    for own in range(some, min(cases, runs) + 1):
        part = math.exp(log_ways(runs, own) + log_ways(other_runs, cases - own) - every)
        chance += part
        # Beyond the likeliest number the parts only fall. A million runs have as many of them.
        if own > most_likely and part < 1e-16 * max(chance, 1e-300):
            break
    return min(1.0, chance)


def pairs_to_tell(gained: int, lost: int, pairs: int) -> int | None:
    """Return how many pairs would tell such a difference in four of five times; None of none.

    After R. J. Connor, "Sample size for testing differences in proportions for the paired-sample
    design", 1987, for a two-sided test of 5 %.
    """
    apart, changed = abs(gained - lost) / pairs, (gained + lost) / pairs
    if not apart:
        return None
    root = _Z * math.sqrt(changed) + _Z_POWER * math.sqrt(max(0.0, changed - apart * apart))
    return math.ceil((root / apart) ** 2)


def runs_to_decide(share: float, limit: float) -> int | None:
    """Return how many runs with this share have a Wilson interval without a limit; None if equal.

    The least number of runs n with |share - limit| >= z sqrt(limit (1 - limit) / n): the score
    test, which that interval inverts.
    """
    if share == limit:
        return None
    return max(1, math.ceil(limit * (1 - limit) * (_Z / (share - limit)) ** 2))


def unpaired_difference(good: int, runs: int, were: int, of: int) -> tuple[float, float]:
    """Return the interval of 95 % of the difference of two shares of different cases.

    `good` of `runs` are good, and `were` of `of` other runs. Wilson's intervals of both, combined
    by squares: R. G. Newcombe, "Interval estimation for the difference between independent
    proportions", 1998, method 10.
    """
    share, before = good / runs, were / of
    (low, high), (least, most) = wilson_interval(good, runs), wilson_interval(were, of)
    down, up = math.hypot(share - low, most - before), math.hypot(high - share, before - least)
    return share - before - down, share - before + up


def runs_to_tell(share: float, before: float) -> int | None:
    """Return how many runs of each would tell two shares in four of five times; None of equal ones.

    The usual formula for two independent shares and a two-sided test of 5 %: J. L. Fleiss,
    "Statistical Methods for Rates and Proportions", 1981, without its correction for continuity.
    """
    if share == before:
        return None
    mean = (share + before) / 2
    root = _Z * math.sqrt(2 * mean * (1 - mean))
    root += _Z_POWER * math.sqrt(share * (1 - share) + before * (1 - before))
    return math.ceil((root / (share - before)) ** 2)


def all_good(times: int, counts: Sequence[tuple[int, int]]) -> tuple[float, float, float]:
    """Return pass^k, the chance that k runs of a setting are all good, and its interval of 95 %.

    Counts are the good runs of each setting and its runs, at least that many. For one setting,
    pass^k is the share of draws without replacement that are all good, C(good, k) / C(runs, k) (S.
    Yao et al., "tau-bench", 2024), and its interval has the ends of Wilson's to the power of k. For
    several it is the mean, and its ends are means of ends, which is wider than needed.
    """
    shares = [math.comb(good, times) / math.comb(runs, times) for good, runs in counts]
    lows, highs = zip(*(wilson_interval(good, runs) for good, runs in counts), strict=True)
    low, high = (fmean(end**times for end in ends) for ends in (lows, highs))
    return fmean(shares), low, high
