"""The judged share of the candidate: a baseline that leaves too little says nothing about it.

Runs, metrics or values that only the candidate has are not judged, nor are pairs set apart as
knife-edge runs. Each such part is counted and reported. Beyond the policy's share, the stores are
not comparable. Otherwise a baseline with most parts left out or blanked would let anything pass.
"""

import numpy as np

from contactlab.comparison.pairing import PairedStores
from contactlab.judge.subjects import SAME, Mask, Subject
from contactlab.judge.wording import out_of
from contactlab.rendering.amounts import format_percent
from contactlab.schema.finding import Finding


def is_too_little(paired: PairedStores, unjudged: int, total: int) -> bool:
    """Return whether the candidate has more unjudged parts than the policy allows."""
    return unjudged > (1 - paired.policy.least_judged) * total


def judged_share_check(paired: PairedStores, gated: PairedStores) -> Finding:
    """Return whether enough runs and metrics of the candidate have a counterpart that is judged."""
    subject = Subject("enough is judged", "runs", "gate")
    pairs, runs = len(paired.pairing.baseline), paired.candidate.columns.runs
    apart = pairs - len(gated.pairing.baseline)
    metrics = [*paired.candidate.columns.metric_columns]
    metric_columns = paired.baseline.columns.metric_columns
    unknown = sum(name not in metric_columns for name in metrics)
    unjudged_counts = (
        (len(paired.pairing.new), runs, "run", "of the candidate not in the baseline"),
        (apart, pairs, "pair", "set apart as knife-edge runs"),
        (unknown, len(metrics), "metric", "of the candidate not in the baseline"),
    )
    phrases = [
        f"{out_of(n, total, noun)} {words}" for n, total, noun, words in unjudged_counts if n
    ]
    if any(is_too_little(paired, n, total) for n, total, _, _ in unjudged_counts):
        least = format_percent(paired.policy.least_judged)
        return subject.make_skipped(f"{'; '.join(phrases)}; at least {least} must be judged")
    return subject.make_single(
        SAME, "; ".join(phrases) or "all of the candidate", judged_count=pairs - apart
    )


def unless_unjudged(
    paired: PairedStores, subject: Subject, finding: Finding, unjudged: Mask, stated: Mask
) -> Finding:
    """Return a finding, unless the baseline lacks too many of the values that it needs.

    Both masks are of pairs (n,): `stated` has those with a value of the candidate, `unjudged` those
    of them without one of the baseline.
    """
    # Many times faster than the sum of a mask.
    missing, total = int(np.count_nonzero(unjudged)), int(np.count_nonzero(stated))
    if finding.outcome == "failed" or not is_too_little(paired, missing, total):
        return finding
    least = format_percent(paired.policy.least_judged)
    return subject.make_skipped(
        f"{out_of(missing, total)} without a value in the baseline; at least {least} must have one"
    )
