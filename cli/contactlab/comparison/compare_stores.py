"""Compare two stores: open them, make every check, and draw the conclusion of all checks."""

from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import date
from itertools import combinations
from pathlib import Path

import numpy as np

from contactlab.comparison.judged_share import judged_share_check
from contactlab.comparison.metric_checks import Remeasure, metric_checks, remeasured_check
from contactlab.comparison.outcome_checks import controlled_checks, outcome_checks
from contactlab.comparison.pairing import (
    PairedStores,
    Pairing,
    engine_of,
    explain_unpaired,
    find_difference,
    for_both,
    pair_by_axes,
    pair_keys,
)
from contactlab.comparison.run_checks import (
    PairLabels,
    expectation_checks,
    knife_edge_check,
    label_checks,
    recommendation_check,
    unpaired_checks,
)
from contactlab.comparison.spread_checks import (
    pairs_to_tell,
    spread_expectation_checks,
    spread_label_checks,
    spread_metric_checks,
)
from contactlab.errors import ContactlabError, ExpectationError, PolicyError, StoreError
from contactlab.judge.conclusion import exit_code, failed_names
from contactlab.judge.policies import check_names
from contactlab.judge.subjects import CHANGED, NAMES, NOT_COMPARABLE, SAME, Subject
from contactlab.judge.waivers import apply_waivers
from contactlab.judge.wording import plural
from contactlab.printable import shell_word
from contactlab.schema.comparison import (
    ComparedStore,
    ComparePolicy,
    ComparisonReport,
    Difference,
    PairCounts,
)
from contactlab.schema.finding import Change, Finding
from contactlab.store.finished_store import Store
from contactlab.store.store_files import Address
from contactlab.store.verify_store import contradictory_records, find_problems

DEFAULT_POLICY = ComparePolicy(version=1)
_COMPARABLE = Subject("stores can be compared", "evidence", "gate")
# Metrics and labels are checked one by one: those that have not changed stay comparable.
_JUDGED_ONE_BY_ONE = {"metric_versions", "thresholds"}
_ABOUT_RUNS = {"runs", "labels", "metrics", "recommendation"}


def compare_stores(
    baseline: Address,
    candidate: Address,
    policy: ComparePolicy = DEFAULT_POLICY,
    *,
    control: Address | None = None,
    thorough: bool = False,
    remeasure: Remeasure | None = None,
    today: date | None = None,
) -> ComparisonReport:
    """Compare two stores, the candidate with the baseline.

    Thoroughly means that every record and the bytes of every trace are checked first. Exceptions
    of the policy expire by `today`, by default the day of the call. A control has the content of
    the baseline and the versions of the candidate. The candidate's outcomes are then compared with
    those of the control.

    Raises:
        StoreError: a store is not sound or not the pinned one, or they have no run in common.
        PolicyError: two are the same store, or the policy names a part that they lack.
    """
    for one, other in combinations(filter(None, (baseline, candidate, control)), 2):
        paths = [store for store in (one, other) if isinstance(store, Path) and store.exists()]
        if one == other or (len(paths) == 2 and paths[0].samefile(paths[1])):
            raise PolicyError(
                f"{one} and {other} are the same store; compare the stores of two sweeps"
            )
    with ThreadPoolExecutor(1) as pool:
        # Hashing releases the lock of the interpreter. The shown progress is the baseline's.
        candidate_opened = pool.submit(_open_store, "candidate", candidate, thorough=thorough)
        before = _open_store("baseline", baseline, thorough=thorough)
        if policy.baseline_digest not in {None, before.digest}:
            raise StoreError(
                f"the baseline {baseline} has the digest {before.digest}, not "
                f"{policy.baseline_digest}, which is pinned; "
                "pin the new one if it was meant to change"
            )
        after = candidate_opened.result()
    policy, pairing = match_runs(before, after, policy)
    paired = PairedStores(before, after, pairing, policy, today or date.today())  # noqa: DTZ011
    policy = choose_judge(paired)
    paired = replace(paired, policy=policy)
    check_names(
        policy, {**before.columns.metric_columns, **after.columns.metric_columns}, paired.ranks
    )
    third = _open_store("control", control, thorough=thorough) if control else None
    # Make every check, and draw the conclusion of all.
    gated = _select_judged(paired)
    labels = PairLabels.from_pairs(gated)
    spread = policy.judge == "spread"
    of_labels = list(spread_label_checks(labels) if spread else label_checks(labels))
    transitions = labels.count_transitions()
    sameness = list(_sameness_checks(before, after, policy))
    differences = [difference for _, difference in sameness if difference]
    models = find_difference(before, after, "scene_hash")
    if models and all(difference.what != "scene_hash" for difference in differences):
        # A report begins with the changes of the model, also if the policy does not name it.
        old, new = models
        differences.append(
            Difference(what="scene_hash", baseline=old, candidate=new, required=False)
        )
    checks = [
        _COMPARABLE.make_single(SAME, "both are sound"),
        *_store_checks(before, after),
        *(check for check, _ in sameness),
    ]
    outcomes = [*_check_outcomes(gated, third)]
    if policy.match == "none":
        checks += outcomes
    else:
        checks += unpaired_checks(paired)
        checks.append(judged_share_check(paired, gated))
        checks.append(knife_edge_check(paired))
        checks += of_labels
        checks += outcomes
        checks += (spread_expectation_checks if spread else expectation_checks)(gated)
        checks += (spread_metric_checks if spread else metric_checks)(gated)
        checks.append(recommendation_check(paired))
    if remeasure is not None:
        checks.append(remeasured_check(paired, remeasure))
    checks = apply_waivers(checks, policy.waive, paired.today)
    equal = bool(paired.bitwise_equal.all())
    passed = "same" if equal else "no difference proven" if spread else "within tolerances"
    verdict, code, headline = draw_conclusion(checks, passed)
    flipped = paired.read_labels(paired.baseline) != paired.read_labels(paired.candidate)
    pairing, flagged = paired.pairing, paired.knife_edge
    compared_by = "id" if policy.match == "auto" else policy.match
    return ComparisonReport(
        verdict=verdict,
        exit_code=code,
        headline=headline,
        baseline=describe_store(before),
        candidate=describe_store(after),
        control=describe_store(third) if third else None,
        match=compared_by,
        judge="spread" if spread else "each",
        pairs=PairCounts(
            paired=len(pairing.baseline),
            missing=len(pairing.missing),
            new=len(pairing.new),
            bitwise_equal=int(paired.bitwise_equal.sum()),
            knife_edge=int(flagged.sum()),
            knife_edge_flipped=int((flagged & flipped).sum()),
        ),
        differences=tuple(differences),
        transitions=transitions,
        findings=tuple(checks),
        advice=tuple(_advise_commands(checks, before, after)),
    )


def _open_store(role: str, address: Address, *, thorough: bool) -> Store:
    try:
        problems = find_problems(address, thorough=thorough)
        if not problems and not thorough:
            problems = contradictory_records(Store.open_unchecked(address))
    except StoreError as error:
        raise StoreError(f"the {role} cannot be read: {error}") from error
    if problems:
        most_shown = 3
        first = "; ".join(problems[:most_shown])
        more = len(problems) - most_shown
        rest = f"; and {more} more problems" if more > 0 else ""
        raise StoreError(
            f"the {role} {address} is not sound: {first}{rest} (see `contactlab verify {address}`)"
        )
    return Store.open_unchecked(address)


def unreadable_report(error: ContactlabError, policy: ComparePolicy) -> ComparisonReport:
    """Return the report of stores that cannot be compared, with the reason."""
    return ComparisonReport(
        verdict="not comparable",
        exit_code=error.exit_code,
        headline=f"not comparable: {error}",
        baseline=None,
        candidate=None,
        match="id" if policy.match == "auto" else policy.match,
        pairs=PairCounts(**dict.fromkeys(PairCounts.model_fields, 0)),
        differences=(),
        transitions=(),
        findings=(_COMPARABLE.make_single(NOT_COMPARABLE, str(error)),),
        advice=(),
    )


def choose_judge(paired: PairedStores) -> ComparePolicy:
    """Return a policy that says whether each pair of runs is judged, or all together.

    A changed model is judged by all pairs together if these are enough to show a change of all.
    With fewer, no change at all would be shown. Equal runs count once.
    """
    baseline, candidate, judge = paired.baseline, paired.candidate, paired.policy.judge
    if judge == "auto":
        metrics = len({**baseline.columns.metric_columns, **candidate.columns.metric_columns})
        changed = find_difference(baseline, candidate, "scene_hash") is not None
        least = pairs_to_tell(metrics)
        many = changed and len(paired.pairing.baseline) >= least
        judge = "spread" if many and len(np.unique(paired.trajectories)) >= least else "each"
    return paired.policy.model_copy(update={"judge": judge})


def match_runs(
    baseline: Store, candidate: Store, policy: ComparePolicy
) -> tuple[ComparePolicy, Pairing]:
    """Return the pairs of runs that `compare` compares, and the policy with how they are matched.

    With `match: auto`, that is by id if an id is common, and otherwise by axes, because a changed
    model gives all runs other ids, and the same axes. Runs of equal id have the same scene content,
    settings, seed and duration. A policy with `match: none` gives no pairs and no missing runs.
    Raises a StoreError if no run is in both stores.
    """
    match = policy.match
    if match == "none":
        none = np.zeros(0, np.intp)
        return policy, Pairing(none, none, none, none)
    if match != "axes":
        pairing = pair_keys(
            *for_both(lambda store: store.columns.read_ids(), (baseline, candidate))
        )
        if len(pairing.baseline):
            return policy.model_copy(update={"match": "id"}), pairing
    by_axes = match != "id"
    if by_axes:
        pairing = pair_by_axes(baseline, candidate)
        if len(pairing.baseline):
            return policy.model_copy(update={"match": "axes"}), pairing
    message = f"no run of {baseline.address} is in {candidate.address}"
    if by_axes:
        raise StoreError(f"{message}: {explain_unpaired(baseline, candidate)}")
    if scenes := find_difference(baseline, candidate, "scene_hash"):
        message += f": the scene changed ({scenes[0]}, now {scenes[1]})"
    try:
        matches = len(pair_by_axes(baseline, candidate).baseline)
    except StoreError as error:
        raise StoreError(f"{message}; {error}") from error
    if matches:
        raise StoreError(
            f"{message}; to compare runs of equal axis values instead, add --match axes"
        )
    raise StoreError(f"{message}; {explain_unpaired(baseline, candidate)}")


def _select_judged(paired: PairedStores) -> PairedStores:
    return paired.without_pairs(paired.knife_edge & paired.policy.knife_edge.exclude)


def _check_outcomes(gated: PairedStores, control: Store | None) -> Iterator[Finding]:
    """Yield the findings on outcomes: against the baseline, or against a control."""
    if control is None:
        yield from outcome_checks(gated)
        return
    by_control, of_control = (
        _select_judged(
            replace(
                gated,
                baseline=old,
                candidate=new,
                pairing=match_runs(old, new, gated.policy)[1],
            )
        )
        for old, new in ((control, gated.candidate), (gated.baseline, control))
    )
    yield from controlled_checks(by_control, of_control)


def describe_store(store: Store) -> ComparedStore:
    """Return how a report describes a store."""
    manifest, origin = store.manifest, store.manifest.provenance
    return ComparedStore(
        store=str(store.address),
        physics=store.physics,
        sweep=manifest.sweep.name,
        runs=manifest.runs,
        engine=engine_of(store),
        contactlab=origin.contactlab,
        git_revision=origin.git_revision,
        cpu_model=origin.host.cpu_model,
        finished=manifest.finished,
    )


def _sameness_checks(
    baseline: Store, candidate: Store, policy: ComparePolicy
) -> Iterator[tuple[Finding, Difference | None]]:
    """Yield one check for each property that the policy names, and the difference of the stores."""
    for what in dict.fromkeys((*policy.require.same, *policy.require.warn_if_different)):
        # Runs are matched by axes, or not at all, because the scene changed.
        changes_scene = what == "scene_hash" and policy.match != "id"
        required = what in policy.require.same and not changes_scene
        is_gate = required and what not in _JUDGED_ONE_BY_ONE
        level = "gate" if is_gate else "warn"
        subject = Subject(f"same {what}", "evidence", level, two_sided=True)
        values = find_difference(baseline, candidate, what)
        if values is None:
            yield subject.make_single(SAME, "the same"), None
            continue
        old, new = values
        difference = Difference(what=what, baseline=old, candidate=new, required=required)
        if is_gate:
            yield subject.make_skipped(f"must be the same, but is {old}, now {new}"), difference
        else:
            change_text = "the files of the scene changed" if changes_scene else f"{old}, now {new}"
            yield subject.make_single(CHANGED, change_text), difference


def _store_checks(baseline: Store, candidate: Store) -> Iterator[Finding]:
    """Yield whether the stores are of two sweeps, in the right order; these checks only warn."""
    old, new = baseline.manifest, candidate.manifest
    copied = (old.started, old.finished, old.sweep) == (new.started, new.finished, new.sweep)
    warning = "no: both stores were written at the same instant; the candidate is a copy"
    fine = "at another time"
    yield _warn_store("sweep ran again", warning if copied else "", fine)
    swapped = new.finished < old.finished
    warning = f"finished {new.finished[:19]}, before the baseline: are they swapped?"
    yield _warn_store(
        "candidate is newer", warning if swapped else "", "finished after the baseline"
    )


def _warn_store(name: str, warning: str, fine: str) -> Finding:
    subject = Subject(name, "evidence", "warn", two_sided=True)
    return subject.make_single(CHANGED if warning else SAME, warning or fine)


def draw_conclusion(checks: Sequence[Finding], passed: str = "same") -> tuple[Change, int, str]:
    """Return verdict, exit code and headline.

    If required properties differ, that comes first: no other check means anything then.

    Args:
        checks: all that were made.
        passed: the word of the headline for the verdict `same`.
    """
    failed = [NAMES.index(check.verdict) for check in checks if check.outcome == "failed"]
    skipped = [check.kind for check in checks if check.is_open]
    counts = Counter(check.verdict for check in checks if check.kind in _ABOUT_RUNS)
    changed = set(counts) - {"same", "not comparable"}
    verdict: Change = "changed" if changed - {"better"} else "better" if changed else "same"
    if (code := exit_code(checks)) == ExpectationError.exit_code:
        # A missing value of one metric says less than another check that is worse.
        runs_missing = any(check.verdict == "missing" and check.kind == "runs" for check in checks)
        others = [number for number in failed if NAMES[number] != "missing"]
        verdict = NAMES[max(failed if runs_missing or not others else others)]
    elif code:
        verdict = "not comparable"
    # A log of a job may have the headline alone.
    names, most_names = list(dict.fromkeys(failed_names(checks))), 2
    more = [f"{len(names) - most_names} more"] if len(names) > most_names else []
    shown = ", ".join([*names[:most_names], *more])
    parts = [f"{len(failed)} of {plural(len(checks), 'check')} fail: {shown}"] if failed else []
    parts += [f"{plural(len(skipped), 'check')} cannot be made"] if skipped else []
    if parts:
        return verdict, code, f"{_verdict_words(verdict, checks)}: {'; '.join(parts)}"
    changes = ", ".join(_count_changes(checks))
    word = passed if verdict == "same" else verdict
    return verdict, code, f"{word}: no check of {len(checks)} fails{changes and f'; {changes}'}"


def _verdict_words(verdict: Change, checks: Sequence[Finding]) -> str:
    if verdict != "missing":
        return verdict
    of_runs = any(check.verdict == verdict and check.kind == "runs" for check in checks)
    return f"{'runs' if of_runs else 'values'} {verdict}"


def _count_changes(checks: Sequence[Finding]) -> Iterator[str]:
    words = {"better": "better", "changed": "changed", "worse": "worse within budget"}
    for name, word in words.items():
        changed = [check for check in checks if check.verdict == name and check.kind in _ABOUT_RUNS]
        for kind in dict.fromkeys(check.kind for check in changed):
            # A metric is judged once for each group.
            names = {check.name for check in changed if check.kind == kind}
            counted = plural(len(names), "metric" if kind == "metrics" else "check")
            yield f"{counted}{'' if kind == 'metrics' else f' of {kind}'} {word}"


def _advise_commands(checks: Sequence[Finding], baseline: Store, candidate: Store) -> Iterator[str]:
    """Yield the next commands, each after its purpose."""
    old, new = shell_word(baseline.address), shell_word(candidate.address)
    order = ("failed", "warned", "noted")
    ordered = sorted(
        (c for c in checks if c.outcome in order), key=lambda c: order.index(c.outcome)
    )
    pair = next((pair for check in ordered for pair in check.worst if pair.candidate_run), None)
    if pair is not None:
        yield f"look closer: contactlab show {new} {pair.candidate_run}"
    failed = next((check for check in checks if check.outcome == "failed"), None)
    if failed is not None:
        yield (
            f"waive one: contactlab compare {old} {new} "
            f'--policy policy.yaml --waive "{failed.name}" --reason "..."'
        )
    if failed or any(check.kind in _ABOUT_RUNS and check.outcome == "noted" for check in checks):
        yield f"make the candidate the baseline: contactlab compare {old} {new} --update"
