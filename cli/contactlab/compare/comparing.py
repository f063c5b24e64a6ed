"""Compare two stores: every check, and what they mean together."""

from datetime import date

from contactlab.compare.accepting import with_accepted
from contactlab.compare.compared import Compared
from contactlab.compare.labels import Outcomes, label_checks
from contactlab.compare.metrics import metric_checks
from contactlab.compare.pairing import Pairing, pair_by_axes, pair_by_id
from contactlab.compare.recommendation import recommendation_check
from contactlab.compare.remeasuring import Remeasure, remeasured_check
from contactlab.compare.rules import check_names
from contactlab.compare.runs import (
    Flags,
    bitwise_equal,
    expectation_checks,
    knife_edge,
    knife_edge_check,
    run_checks,
    store_checks,
)
from contactlab.compare.sameness import difference, differences, sameness_checks
from contactlab.compare.sides import Side, open_sides
from contactlab.compare.summing import advice, exit_code, headline, overall
from contactlab.compare.unreadable import readable
from contactlab.errors import StoreError
from contactlab.schema import ComparePolicy, ComparisonReport, PairCounts
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
    before, after = open_sides(baseline, candidate, thorough=thorough)
    pairing = _paired(before, after, policy)
    compared = Compared(before, after, pairing, policy, today or date.today())  # noqa: DTZ011
    measured = {**before.columns.measured, **after.columns.measured}
    check_names(policy, measured, compared.ranks)
    return _report(compared, remeasure)


def paired(
    baseline: Address, candidate: Address, policy: ComparePolicy = DEFAULT_POLICY
) -> Pairing:
    """Return which runs of two stores belong together.

    Raises:
        StoreError: a store is not sound, or no run of one is in the other.
    """
    return _paired(*open_sides(baseline, candidate, thorough=False), policy)


def _paired(baseline: Side, candidate: Side, policy: ComparePolicy) -> Pairing:
    by_axes = policy.match == "axes"
    pairing = (pair_by_axes if by_axes else pair_by_id)(baseline, candidate)
    if len(pairing.baseline) == 0:
        raise StoreError(_nothing_in_common(baseline, candidate, by_axes=by_axes))
    return pairing


def _nothing_in_common(baseline: Side, candidate: Side, *, by_axes: bool) -> str:
    text = f"no run of {baseline.store.address} is in {candidate.store.address}"
    if by_axes:
        return f"{text}: no axis values and seed are equal"
    if told := difference(baseline, candidate, "scene_hash"):
        text += f": the scene changed ({told[0]}, now {told[1]})"
    return f"{text}; to compare runs of equal axis values all the same, write --match axes"


def _report(compared: Compared, remeasure: Remeasure | None) -> ComparisonReport:
    apart = knife_edge(compared)
    excluded = apart & compared.policy.knife_edge.exclude
    gated = compared.without(excluded)
    outcomes = Outcomes.of(gated)
    before, after, policy = compared.baseline, compared.candidate, compared.policy
    found = [
        readable(),
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
    checks = with_accepted(found, policy.accept, compared.today)
    return ComparisonReport(
        verdict=overall(checks),
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


def _counts(compared: Compared, apart: Flags) -> PairCounts:
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
