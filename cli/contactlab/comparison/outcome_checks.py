"""Outcomes in two stores: is one share of good ones larger than the other?"""

from collections.abc import Iterator

import numpy as np

from contactlab.comparison.pairing import PairedStores
from contactlab.errors import StoreError
from contactlab.judge.subjects import BETTER, SAME, WORSE, Mask, Subject
from contactlab.judge.wording import format_percent, share_with_interval
from contactlab.schema.finding import Finding
from contactlab.shares import (
    all_of,
    paired_chance,
    paired_difference,
    pairs_to_tell,
    runs_to_tell,
    unpaired_difference,
)
from contactlab.store.finished_store import Store

_IN_A_ROW = 3
_STABLE = "stable"
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
    message = (
        f"{good:,} of {pairs:,}, {were:,} in the baseline: {gained:,} gained and {lost:,} lost, "
        f"{low:+.1%} to {high:+.1%} with 95 %; {_told(gained, lost, pairs)}; "
        f"{_each((good, pairs), (were, pairs))}"
    )
    code = _code(low, high, rules.tolerance)
    yield subject.single(code, message, judged=pairs)


def unpaired_outcome_check(paired: PairedStores) -> Finding:
    """Return whether as many runs are good as in the baseline, be they of the same cases or not.

    A StoreError says that one of the stores has no run that says how it ended.
    """
    rules = paired.policy.outcomes
    (were, of), (good, runs) = (
        _counted(store, rules.good) for store in (paired.baseline, paired.candidate)
    )
    if not runs or not of:
        raise StoreError(
            f"no run of {paired.candidate.address if of else paired.baseline.address} says whether "
            "it is a success; count stable runs, by a policy with outcomes: {good: stable}"
        )
    subject = Subject(f"no less {rules.good}", "outcomes", rules.level)
    low, high = unpaired_difference(good, runs, were, of)
    told = "the shares differ"
    if low <= 0 <= high:
        needed = runs_to_tell(good / runs, were / of)
        more = f"; about {needed:,} runs of each would tell" if needed else ""
        told = f"not distinguishable{more}"
    message = (
        f"{good:,} of {runs:,}, {were:,} of {of:,} in the baseline, {low:+.1%} to {high:+.1%} "
        f"with 95 %; {told}; {_each((good, runs), (were, of))}"
    )
    return subject.single(_code(low, high, rules.tolerance), message, judged=runs)


def _code(low: float, high: float, tolerance: float) -> int:
    """Return the verdict on a difference of shares that lies in an interval."""
    return WORSE if high < -tolerance else BETTER if low > 0 else SAME


def _each(*counts: tuple[int, int]) -> str:
    """Return the share of good runs and of three in a row, each of the candidate first."""
    text = f"shares {' and '.join(share_with_interval(*each) for each in counts)}"
    if min(runs for _, runs in counts) < _IN_A_ROW:
        return text
    row = (format_percent(all_of(_IN_A_ROW, *each)) for each in counts)
    return f"{text}; three in a row {' and '.join(row)}"


def _counted(store: Store, good: str) -> tuple[int, int]:
    """Return how many runs of a store are good, and how many say so."""
    if good == _STABLE:
        return store.manifest.labels.get(_STABLE, 0), store.manifest.runs
    if SUCCESS not in store.columns.schema.names:
        return 0, 0
    found = store.columns.numbers(SUCCESS)
    return int((found.valid & (found.values == 1)).sum()), int(found.valid.sum())


def _told(gained: int, lost: int, pairs: int) -> str:
    chance = paired_chance(gained, lost)
    if chance < 0.05:
        return f"equal shares would differ as much with a chance of {chance:.2g}"
    if (needed := pairs_to_tell(gained, lost, pairs)) is None:
        return "not distinguishable"
    return f"not distinguishable; about {needed:,} pairs would tell"


def _outcomes(paired: PairedStores, good: str) -> tuple[Mask, Mask, Mask]:
    """Return (n,) whether both runs of a pair say how they ended, and whether each is good."""
    if good == _STABLE:
        stable = len(paired.ranks) - 1
        sides = [paired.labels(store) == stable for store, _ in paired.sides]
        return np.ones_like(sides[0]), sides[0], sides[1]
    before, after = paired.numbers(SUCCESS)
    return before.valid & after.valid, before.values == 1, after.values == 1
