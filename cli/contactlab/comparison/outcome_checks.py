"""Outcomes of the same cases in two stores: is one share of good ones larger than the other?"""

from collections.abc import Iterator

import numpy as np

from contactlab.comparison.pairing import PairedStores
from contactlab.judge.subjects import BETTER, SAME, WORSE, Mask, Subject
from contactlab.judge.wording import format_percent
from contactlab.schema.finding import Finding
from contactlab.shares import all_of, paired_chance, paired_difference, pairs_to_tell

_IN_A_ROW = 3
SUCCESS = "success"


def outcome_checks(paired: PairedStores) -> Iterator[Finding]:
    """Yield whether as many runs are good as in the baseline, of pairs of which both say so.

    Good are the episodes that their loop calls a success or, where the policy asks for it, stable
    runs. It is worse only if the interval of the difference excludes what is tolerated.
    """
    rules = paired.policy.outcomes
    known, before, after = _outcomes(paired, rules.good)
    pairs = int(known.sum())
    if not pairs:
        return
    subject = Subject(f"no less {rules.good}", "outcomes", rules.level)
    gained, lost = (
        int((known & new & ~old).sum()) for new, old in ((after, before), (before, after))
    )
    good, were = int((known & after).sum()), int((known & before).sum())
    low, high = paired_difference(gained, lost, pairs)
    code = WORSE if high < -rules.tolerance else BETTER if low > 0 else SAME
    row = (format_percent(all_of(_IN_A_ROW, count, pairs)) for count in (good, were))
    message = (
        f"{good:,} of {pairs:,}, {were:,} in the baseline: {gained:,} gained and {lost:,} lost, "
        f"{low:+.1%} to {high:+.1%} with 95 %; {_told(gained, lost, pairs)}"
    )
    if pairs >= _IN_A_ROW:
        message += f"; three in a row {' and '.join(row)}"
    yield subject.single(code, message, judged=pairs)


def _told(gained: int, lost: int, pairs: int) -> str:
    chance = paired_chance(gained, lost)
    if chance < 0.05:
        return f"equal shares would differ as much with a chance of {chance:.2g}"
    if (needed := pairs_to_tell(gained, lost, pairs)) is None:
        return "not distinguishable"
    return f"not distinguishable; about {needed:,} pairs would tell"


def _outcomes(paired: PairedStores, good: str) -> tuple[Mask, Mask, Mask]:
    """Return (n,) whether both runs of a pair say how they ended, and whether each is good."""
    if good == "stable":
        stable = len(paired.ranks) - 1
        sides = [paired.labels(store) == stable for store, _ in paired.sides]
        return np.ones_like(sides[0]), sides[0], sides[1]
    before, after = paired.numbers(SUCCESS)
    return before.valid & after.valid, before.values == 1, after.values == 1
