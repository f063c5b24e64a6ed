"""Outcomes in two stores: is one share of good ones larger than the other?"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from contactlab.comparison.judged_share import unless_unjudged
from contactlab.comparison.pairing import PairedStores, Rows, settings_of
from contactlab.errors import StoreError
from contactlab.judge.subjects import BETTER, CHANGED, SAME, WORSE, Mask, Subject
from contactlab.judge.wording import share_with_interval, with_interval
from contactlab.schema.finding import Finding
from contactlab.shares import (
    all_good,
    paired_chance,
    paired_difference,
    pairs_to_tell,
    runs_to_tell,
    unpaired_difference,
)
from contactlab.store.finished_store import Store

_STABLE = "stable"
SUCCESS = "success"
_BASELINE = "the baseline"
_CONTROL = "the control"


@dataclass(frozen=True)
class _Outcomes:
    """Runs of a store with known outcomes: whether each is good, and the code of its setting."""

    good: Mask
    settings: Rows

    @property
    def counts(self) -> tuple[int, int]:
        return int(self.good.sum()), len(self.good)

    @property
    def by_setting(self) -> list[tuple[int, int]]:
        of = np.unique(self.settings, return_inverse=True)[1]
        good, runs = np.bincount(of, self.good).astype(int), np.bincount(of)
        return [*zip(good.tolist(), runs.tolist(), strict=True)]


def outcome_checks(paired: PairedStores, against: str = _BASELINE) -> Iterator[Finding]:
    """Yield whether as many runs are good as in the baseline, among pairs with two known outcomes.

    Good are the episodes that their loop calls a success or, where the policy asks for it, stable
    runs. It is worse only if the interval of the difference excludes the tolerance.
    """
    rules = paired.policy.outcomes
    subject = Subject(f"no less {rules.good}", "outcomes", rules.level)
    (before, rows), (after, others) = paired.sides
    knew, knows = (
        _read_outcomes(before, rules.good)[0][rows],
        _read_outcomes(after, rules.good)[0][others],
    )
    compared = _compare_shares(paired, against)
    if compared is not None:
        (low, high), message, pair_count = compared
        code = WORSE if high < -rules.tolerance else BETTER if low > 0 else SAME
        checked = subject.make_single(code, message, judged_count=pair_count)
        yield unless_unjudged(paired, subject, checked, knows & ~knew, knows)
    elif knows.any():
        yield subject.make_skipped(f"no run of {against} says how it ended")


def controlled_checks(by_control: PairedStores, of_control: PairedStores) -> Iterator[Finding]:
    """Yield whether as many runs are good as in the control, and whether that is as the baseline.

    The control has the content of the baseline and the versions of the candidate. So a difference
    of control and baseline is not due to the candidate.
    """
    yield from outcome_checks(by_control, _CONTROL)
    compared = _compare_shares(of_control, _BASELINE)
    if compared is not None:
        (low, high), message, pair_count = compared
        subject = Subject("control as the baseline", "outcomes", "warn", two_sided=True)
        yield subject.make_single(
            SAME if low <= 0 <= high else CHANGED, message, judged_count=pair_count
        )


_Compared = tuple[tuple[float, float], str, int]


def _compare_shares(paired: PairedStores, against: str) -> _Compared | None:
    """Return the interval of the difference of shares, its description, and the number of runs.

    A StoreError says that runs are not paired, and those of a store do not say how they ended.
    """
    if paired.policy.match == "none":
        return _compare_unpaired(paired, against)
    (baseline, rows), (candidate, others) = paired.sides
    good = paired.policy.outcomes.good
    (knew, was), (knows, ended) = _read_outcomes(baseline, good), _read_outcomes(candidate, good)
    both_known = knew[rows] & knows[others]
    pairs = int(both_known.sum())
    if not pairs:
        return None
    settings = settings_of(baseline)[rows][both_known]
    after = _Outcomes(ended[others][both_known], settings)
    before = _Outcomes(was[rows][both_known], settings)
    gained = int((after.good & ~before.good).sum())
    lost = int((before.good & ~after.good).sum())
    low, high = paired_difference(gained, lost, pairs)
    if (chance := paired_chance(gained, lost)) < 0.05:
        evidence = f"equal shares would differ as much with a chance of {chance:.2g}"
    elif (needed := pairs_to_tell(gained, lost, pairs)) is None:
        evidence = "not distinguishable"
    else:
        evidence = f"not distinguishable; about {needed:,} pairs would show it"
    message = (
        f"{after.counts[0]:,} of {pairs:,}, {before.counts[0]:,} in {against}: {gained:,} gained "
        f"and {lost:,} lost, {low:+.1%} to {high:+.1%} with 95 %; "
        f"{evidence}; "
        f"{_describe_shares(paired.policy.outcomes.in_a_row, after, before)}"
    )
    return (low, high), message, pairs


def _compare_unpaired(paired: PairedStores, against: str) -> _Compared:
    rules = paired.policy.outcomes
    after, before = (_of_store(store, rules.good) for store in (paired.candidate, paired.baseline))
    (good, runs), (were, of) = after.counts, before.counts
    if not runs or not of:
        raise StoreError(
            f"no run of {paired.candidate.address if of else paired.baseline.address} says whether "
            "it is a success; count stable runs, by a policy with outcomes: {good: stable}"
        )
    low, high = unpaired_difference(good, runs, were, of)
    evidence = "the shares differ"
    if low <= 0 <= high:
        needed = runs_to_tell(good / runs, were / of)
        more = f"; about {needed:,} runs of each would show it" if needed else ""
        evidence = f"not distinguishable{more}"
    message = (
        f"{good:,} of {runs:,}, {were:,} of {of:,} in {against}, {low:+.1%} to {high:+.1%} "
        f"with 95 %; {evidence}; {_describe_shares(rules.in_a_row, after, before)}"
    )
    return (low, high), message, runs


def _describe_shares(times: int, *sides: _Outcomes) -> str:
    """Return the share of good runs and pass^k, each of the candidate first.

    It is the mean over settings if each has `times` runs, otherwise that of all runs together.
    """
    text = f"shares {' and '.join(share_with_interval(*side.counts) for side in sides)}"
    counts = [side.by_setting for side in sides]
    if any(runs < times for side in counts for _, runs in side):
        counts = [[side.counts] for side in sides]
    if any(runs < times for side in counts for _, runs in side):
        return text
    of = f" over {len(counts[0]):,} settings" if len(counts[0]) > 1 else ""
    each = (with_interval(*all_good(times, side)) for side in counts)
    return f"{text}; pass^{times}{of} {' and '.join(each)}"


def _of_store(store: Store, good: str) -> _Outcomes:
    rows = np.arange(store.columns.runs)
    is_known, ended = _read_outcomes(store, good)
    return _Outcomes(ended[is_known], settings_of(store)[rows[is_known]])


def _read_outcomes(store: Store, good: str) -> tuple[Mask, Mask]:
    """Return (runs) whether each says how it ended, and whether that is good."""
    if good == _STABLE:
        codes, words = store.columns.read_codes("label")
        stable = np.array([word == _STABLE for word in words])[codes]
        return np.ones_like(stable), stable
    if SUCCESS not in store.columns.schema.names:
        none = np.zeros(store.columns.runs, np.bool_)
        return none, none
    outcomes = store.columns.numbers(SUCCESS)
    return outcomes.valid, outcomes.values == 1
