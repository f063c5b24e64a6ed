"""Compare two stores: every check, and what they mean together."""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from datetime import date

from contactlab.comparison.checks import NAMES, NOT_COMPARABLE, SAME, CheckSubject, plural
from contactlab.comparison.metric_checks import metric_checks
from contactlab.comparison.opened_stores import (
    described,
    difference,
    open_both,
    sameness_checks,
    store_checks,
)
from contactlab.comparison.pairing import PairedStores, Pairing, pair_by_axes, pair_by_id
from contactlab.comparison.policies import apply_acceptances, check_names
from contactlab.comparison.remeasured_time import Remeasure, remeasured_check
from contactlab.comparison.run_checks import (
    PairLabels,
    bitwise_equal,
    expectation_checks,
    knife_edge,
    knife_edge_check,
    label_checks,
    recommendation_check,
    unpaired_checks,
)
from contactlab.errors import ContactlabError, ExpectationError, StoreError
from contactlab.schema.compare_policy import ComparePolicy
from contactlab.schema.comparison_report import Check, ComparisonReport, PairCounts, Verdict
from contactlab.store.finished_store import Store
from contactlab.store.store_address import Address

DEFAULT_POLICY = ComparePolicy(version=1)
_COMPARABLE = CheckSubject("stores can be compared", "evidence", "gate")
_ABOUT_RUNS = {"runs", "labels", "metrics", "recommendation"}


def compare(
    baseline: Address,
    candidate: Address,
    policy: ComparePolicy = DEFAULT_POLICY,
    *,
    thorough: bool = False,
    remeasure: Remeasure | None = None,
    today: date | None = None,
) -> ComparisonReport:
    """Compare two stores, the candidate with the baseline.

    Thoroughly means that every record and the bytes of every trace are checked first. Exceptions
    of the policy expire by `today`, by default the day of the call.

    Raises:
        StoreError: a store is not sound, or they have no run in common.
        PolicyError: the policy names what the stores do not have.
    """
    before, after = open_both(baseline, candidate, policy, thorough=thorough)
    pairing = pair_runs(before, after, policy)
    paired = PairedStores(before, after, pairing, policy, today or date.today())  # noqa: DTZ011
    check_names(policy, {**before.columns.measured, **after.columns.measured}, paired.ranks)
    return _report(paired, remeasure)


def unreadable_report(error: ContactlabError, policy: ComparePolicy) -> ComparisonReport:
    """Return the report of stores that cannot be compared, with the reason."""
    return ComparisonReport(
        verdict="not comparable",
        exit_code=error.exit_code,
        headline=f"not comparable: {error}",
        baseline=None,
        candidate=None,
        match=policy.match,
        pairs=PairCounts(**dict.fromkeys(PairCounts.model_fields, 0)),
        differences=(),
        transitions=(),
        checks=(_COMPARABLE.single(NOT_COMPARABLE, str(error)),),
        advice=(),
    )


def pair_runs(baseline: Store, candidate: Store, policy: ComparePolicy) -> Pairing:
    """Return the pairs of runs that `compare` compares.

    Raises:
        StoreError: the stores have no run in common.
    """
    by_axes = policy.match == "axes"
    pairing = (pair_by_axes if by_axes else pair_by_id)(baseline, candidate)
    if len(pairing.baseline):
        return pairing
    message = f"no run of {baseline.address} is in {candidate.address}"
    if by_axes:
        raise StoreError(f"{message}: no axis values and seed are equal")
    if scenes := difference(baseline, candidate, "scene_hash"):
        message += f": the scene changed ({scenes[0]}, now {scenes[1]})"
    raise StoreError(f"{message}; to compare runs of equal axis values instead, add --match axes")


def _report(paired: PairedStores, remeasure: Remeasure | None) -> ComparisonReport:
    before, after, policy = paired.baseline, paired.candidate, paired.policy
    gated = paired.without(knife_edge(paired) & policy.knife_edge.exclude)
    labels = PairLabels.of(gated)
    sameness = list(sameness_checks(before, after, policy))
    checks = [
        _COMPARABLE.single(SAME, "both are sound"),
        *store_checks(before, after),
        *(check for check, _ in sameness),
        *unpaired_checks(paired),
        knife_edge_check(paired),
        *label_checks(labels),
        *expectation_checks(gated),
        *metric_checks(gated),
        recommendation_check(paired),
    ]
    if remeasure is not None:
        checks.append(remeasured_check(paired, remeasure))
    checks = apply_acceptances(checks, policy.accept, paired.today)
    verdict, exit_code, headline = _conclusion(checks)
    return ComparisonReport(
        verdict=verdict,
        exit_code=exit_code,
        headline=headline,
        baseline=described(before),
        candidate=described(after),
        match=policy.match,
        pairs=_counts(paired),
        differences=tuple(found for _, found in sameness if found),
        transitions=labels.transitions(),
        checks=tuple(checks),
        advice=tuple(_advice(checks, before, after)),
    )


def _counts(paired: PairedStores) -> PairCounts:
    flipped = paired.labels(paired.baseline) != paired.labels(paired.candidate)
    pairing, flagged = paired.pairing, knife_edge(paired)
    return PairCounts(
        paired=len(pairing.baseline),
        missing=len(pairing.missing),
        new=len(pairing.new),
        bitwise_equal=int(bitwise_equal(paired).sum()),
        knife_edge=int(flagged.sum()),
        knife_edge_flipped=int((flagged & flipped).sum()),
    )


def _conclusion(checks: Sequence[Check]) -> tuple[Verdict, int, str]:
    """Return verdict, exit code and headline.

    Stores that differ in what must be the same come first: no other check means anything then.
    """
    failed = [NAMES.index(check.verdict) for check in checks if check.outcome == "failed"]
    skipped = [check.kind for check in checks if check.is_open]
    found = Counter(check.verdict for check in checks if check.kind in _ABOUT_RUNS)
    verdict, exit_code = _unchanged(found), 0
    if failed and "evidence" not in skipped:
        verdict, exit_code = NAMES[max(failed)], ExpectationError.exit_code
    elif skipped:
        verdict, exit_code = "not comparable", StoreError.exit_code
    parts = [f"{len(failed)} of {plural(len(checks), 'check')} fail"] if failed else []
    parts += [f"{plural(len(skipped), 'check')} cannot be made"] if skipped else []
    if parts:
        return verdict, exit_code, f"{verdict}: {', '.join(parts)}"
    words = {"better": "better", "changed": "changed", "worse": "worse within budget"}
    changes = ", ".join(f"{found[name]} {word}" for name, word in words.items() if found[name])
    return verdict, 0, f"{verdict}: no check of {len(checks)} fails{changes and f'; {changes}'}"


def _unchanged(found: Collection[str]) -> Verdict:
    """Return the verdict where no gate failed."""
    changes = set(found) - {"same", "not comparable"}
    if not changes:
        return "same"
    return "better" if changes == {"better"} else "changed"


def _advice(checks: Sequence[Check], baseline: Store, candidate: Store) -> Iterator[str]:
    """Yield the commands to go on with, each after what it is for."""
    old, new = baseline.address, candidate.address
    order = ("failed", "warned", "noted")
    found = sorted((c for c in checks if c.outcome in order), key=lambda c: order.index(c.outcome))
    pair = next((pair for check in found for pair in check.worst if pair.candidate_run), None)
    if pair is not None:
        yield f"look closer: contactlab show {new} {pair.candidate_run}"
    failed = next((check for check in checks if check.outcome == "failed"), None)
    if failed is not None:
        yield (
            f"accept one: contactlab compare {old} {new} "
            f'--policy policy.yaml --accept "{failed.name}" --reason "..."'
        )
    if failed or any(check.kind in _ABOUT_RUNS and check.outcome == "noted" for check in checks):
        yield f"make the candidate the baseline: contactlab baseline update {new} {old}"
