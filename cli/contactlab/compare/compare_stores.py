"""Compare two stores: every check, and what they mean together."""

from collections.abc import Iterator, Sequence
from datetime import date

import numpy as np

from contactlab.compare.label_checks import PairLabels, label_checks
from contactlab.compare.metric_checks import metric_checks
from contactlab.compare.opened_stores import (
    OpenedStore,
    difference,
    differences,
    open_both,
    sameness_checks,
)
from contactlab.compare.paired_stores import PairedStores
from contactlab.compare.pairing import Pairing, pair_by_axes, pair_by_id
from contactlab.compare.policies import apply_acceptances, check_names
from contactlab.compare.remeasured_time import Remeasure, remeasured_check
from contactlab.compare.run_checks import (
    Flags,
    bitwise_equal,
    expectation_checks,
    knife_edge,
    knife_edge_check,
    recommendation_check,
    run_checks,
    store_checks,
)
from contactlab.compare.verdicts import NAMES, NOT_COMPARABLE, SAME, CheckSubject, make_check
from contactlab.compare.wording import plural
from contactlab.errors import ContactlabError, StoreError
from contactlab.schema import Check, ComparePolicy, ComparisonReport, PairCounts, Verdict
from contactlab.store import Address

DEFAULT_POLICY = ComparePolicy(version=1)


def compare(
    baseline: Address,
    candidate: Address,
    policy: ComparePolicy = DEFAULT_POLICY,
    *,
    thorough: bool = False,
    remeasure: Remeasure | None = None,
    today: date | None = None,
) -> ComparisonReport:
    """Compare two stores.

    Args:
        baseline: where what is known is stored.
        candidate: where what is judged is stored.
        policy: what is worse, and what of it fails the job.
        thorough: whether to check every record and the bytes of every trace first.
        remeasure: what to time anew, if anything.
        today: the day that expiry dates are held against; the clock's if left out.

    Raises:
        StoreError: a store is not sound, or no run of one is in the other.
        PolicyError: the policy asks for what the stores do not have.
    """
    before, after = open_both(baseline, candidate, thorough=thorough)
    pairing = _paired(before, after, policy)
    compared = PairedStores(before, after, pairing, policy, today or date.today())  # noqa: DTZ011
    measured = {**before.columns.measured, **after.columns.measured}
    check_names(policy, measured, compared.ranks)
    return _report(compared, remeasure)


def pair_stores(
    baseline: Address, candidate: Address, policy: ComparePolicy = DEFAULT_POLICY
) -> Pairing:
    """Return which runs of two stores belong together.

    Raises:
        StoreError: a store is not sound, or no run of one is in the other.
    """
    return _paired(*open_both(baseline, candidate, thorough=False), policy)


def _paired(baseline: OpenedStore, candidate: OpenedStore, policy: ComparePolicy) -> Pairing:
    by_axes = policy.match == "axes"
    pairing = (pair_by_axes if by_axes else pair_by_id)(baseline, candidate)
    if len(pairing.baseline) == 0:
        raise StoreError(_nothing_in_common(baseline, candidate, by_axes=by_axes))
    return pairing


def _nothing_in_common(baseline: OpenedStore, candidate: OpenedStore, *, by_axes: bool) -> str:
    text = f"no run of {baseline.store.address} is in {candidate.store.address}"
    if by_axes:
        return f"{text}: no axis values and seed are equal"
    if told := difference(baseline, candidate, "scene_hash"):
        text += f": the scene changed ({told[0]}, now {told[1]})"
    return f"{text}; to compare runs of equal axis values all the same, write --match axes"


def _report(compared: PairedStores, remeasure: Remeasure | None) -> ComparisonReport:
    apart = knife_edge(compared)
    excluded = apart & compared.policy.knife_edge.exclude
    gated = compared.without(excluded)
    outcomes = PairLabels.of(gated)
    before, after, policy = compared.baseline, compared.candidate, compared.policy
    found = [
        readable_check(),
        *store_checks(before, after),
        *sameness_checks(before, after, policy),
        *run_checks(compared),
        knife_edge_check(compared, apart),
        *label_checks(outcomes),
        *expectation_checks(gated),
        *metric_checks(gated),
        recommendation_check(compared),
    ]
    if remeasure is not None:
        found.append(remeasured_check(compared, remeasure))
    checks = apply_acceptances(found, policy.accept, compared.today)
    return ComparisonReport(
        verdict=overall_verdict(checks),
        exit_code=exit_code(checks),
        headline=headline(checks),
        baseline=before.described(),
        candidate=after.described(),
        match=policy.match,
        pairs=_counts(compared, apart),
        differences=tuple(differences(before, after, policy)),
        transitions=outcomes.transitions(),
        checks=tuple(checks),
        advice=advice(checks, before, after),
    )


def _counts(compared: PairedStores, apart: Flags) -> PairCounts:
    flipped = compared.labels(compared.baseline) != compared.labels(compared.candidate)
    pairing = compared.pairing
    return PairCounts(
        paired=len(pairing.baseline),
        missing=len(pairing.missing),
        new=len(pairing.new),
        bitwise_equal=int(bitwise_equal(compared).sum()),
        knife_edge=int(apart.sum()),
        knife_edge_flipped=int((apart & flipped).sum()),
    )


PASSED_EXIT, GATE_FAILED_EXIT, NOT_COMPARABLE_EXIT = 0, 1, 3
_ABOUT_RUNS = {"runs", "labels", "metrics", "recommendation"}


def exit_code(checks: Sequence[Check]) -> int:
    """Return 0, 1 for a failed check, 3 where what must be comparable is not.

    What must be the same comes first: without it, no other check means anything.
    """
    skipped = [check for check in checks if _is_open(check)]
    if any(check.kind == "evidence" for check in skipped):
        return NOT_COMPARABLE_EXIT
    if any(check.outcome == "failed" for check in checks):
        return GATE_FAILED_EXIT
    return NOT_COMPARABLE_EXIT if skipped else PASSED_EXIT


def overall_verdict(checks: Sequence[Check]) -> Verdict:
    """Return the verdict of a whole comparison."""
    if any(_is_open(check) and check.kind == "evidence" for check in checks):
        return "not comparable"
    failed = [check.verdict for check in checks if check.outcome == "failed"]
    if failed:
        return NAMES[max(NAMES.index(verdict) for verdict in failed)]
    if any(_is_open(check) for check in checks):
        return "not comparable"
    found = {check.verdict for check in checks if check.kind in _ABOUT_RUNS} - {"same"}
    found.discard("not comparable")
    if not found:
        return "same"
    return "better" if found == {"better"} else "changed"


def headline(checks: Sequence[Check]) -> str:
    """Return the whole comparison in one line."""
    verdict = overall_verdict(checks)
    failed = sum(check.outcome == "failed" for check in checks)
    skipped = sum(_is_open(check) for check in checks)
    if failed or skipped:
        fails = f"{failed} of {plural(len(checks), 'check')} fail" if failed else ""
        open_ = f"{plural(skipped, 'check')} cannot be made" if skipped else ""
        return f"{verdict}: {', '.join(part for part in (fails, open_) if part)}"
    changed = [f"{count} {name}" for name, count in _changed(checks)]
    if changed:
        return f"{verdict}: no check of {len(checks)} fails; {', '.join(changed)}"
    return f"{verdict}: no check of {len(checks)} fails"


def advice(
    checks: Sequence[Check], baseline: OpenedStore, candidate: OpenedStore
) -> tuple[str, ...]:
    """Return the commands that lead on from here."""
    return tuple(_advice(checks, baseline, candidate))


def _advice(
    checks: Sequence[Check], baseline: OpenedStore, candidate: OpenedStore
) -> Iterator[str]:
    order = ("failed", "warned", "noted")
    told = sorted((c for c in checks if c.outcome in order), key=lambda c: order.index(c.outcome))
    pair = next((pair for check in told for pair in check.worst if pair.candidate_run), None)
    if pair is not None:
        yield f"look closer: contactlab show {candidate.store.address} {pair.candidate_run}"
    failed = next((check for check in checks if check.outcome == "failed"), None)
    if failed is not None:
        yield (
            f"accept one: contactlab compare {baseline.store.address} {candidate.store.address} "
            f'--policy policy.yaml --accept "{failed.name}" --reason "..."'
        )
    if failed is not None or any(
        check.kind in _ABOUT_RUNS and check.outcome == "noted" for check in checks
    ):
        yield (
            "make the candidate the baseline: contactlab baseline update "
            f"{candidate.store.address} {baseline.store.address}"
        )


def _changed(checks: Sequence[Check]) -> Iterator[tuple[str, int]]:
    for name in ("better", "changed", "worse"):
        kinds = [check for check in checks if check.kind in _ABOUT_RUNS and check.verdict == name]
        if kinds:
            yield (name if name != "worse" else "worse within budget"), len(kinds)


def _is_open(check: Check) -> bool:
    return check.outcome == "skipped" and check.level == "gate"


COMPARABLE = CheckSubject("stores can be compared", "evidence", "gate")
_NONE = PairCounts(paired=0, missing=0, new=0, bitwise_equal=0, knife_edge=0, knife_edge_flipped=0)


def unreadable_report(error: ContactlabError, policy: ComparePolicy) -> ComparisonReport:
    """Return a report that says why there was nothing to compare."""
    verdict = np.full(1, NOT_COMPARABLE, dtype=np.int8)
    check = make_check(COMPARABLE, verdict, str(error), runs=0)
    return ComparisonReport(
        verdict="not comparable",
        exit_code=error.exit_code,
        headline=f"not comparable: {error}",
        baseline=None,
        candidate=None,
        match=policy.match,
        pairs=_NONE,
        differences=(),
        transitions=(),
        checks=(check,),
        advice=(),
    )


def readable_check() -> Check:
    """Return the check of stores that can be compared, which all other reports have."""
    return make_check(COMPARABLE, np.full(1, SAME, dtype=np.int8), "both are sound", runs=0)
