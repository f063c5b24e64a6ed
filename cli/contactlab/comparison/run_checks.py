"""Checks of runs as a whole: missing, new, knife-edge, expectations, the recommendation."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from contactlab.comparison.checks import (
    BETTER,
    CHANGED,
    MISSING,
    MOST_SHOWN,
    SAME,
    WORSE,
    CheckSubject,
    format_percent,
    format_settings,
    out_of,
    plural,
)
from contactlab.comparison.pairing import PairedStores, unpaired_runs
from contactlab.errors import ContactlabError
from contactlab.pareto.analysis import analyse
from contactlab.schema.comparison_report import Check
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.finished_store import Store

Mask = NDArray[np.bool_]

_FASTER = 0.15
"""Stored times of two sessions on one machine differ by up to this fraction for no reason."""


def bitwise_equal(paired: PairedStores) -> Mask:
    """Return the pairs (n,) whose trajectories are bitwise equal."""
    before = paired.baseline.columns.byte_strings("trajectory_hash")[paired.pairing.baseline]
    after = paired.candidate.columns.byte_strings("trajectory_hash")[paired.pairing.candidate]
    return (before == after) & (before != b"")


def knife_edge(paired: PairedStores) -> Mask:
    """Return the pairs (n,) with a run whose label changes if it starts 1e-6 away."""
    before, after = paired.numbers("knife_edge")
    return (before.values == 1) | (after.values == 1)


def missing_runs_check(paired: PairedStores) -> Check:
    """Return whether every run of the baseline is in the candidate."""
    missing = paired.pairing.missing
    total = len(paired.pairing.baseline) + len(missing)
    verdicts = np.where(np.arange(total) < len(missing), MISSING, SAME).astype(np.int8)
    subject = CheckSubject("no missing runs", "runs", paired.policy.missing_runs)
    if not len(missing):
        return subject.check(verdicts, f"all {total:,} are there")
    worst = unpaired_runs(paired.baseline, "baseline", missing[:MOST_SHOWN].tolist())
    return subject.check(verdicts, f"{out_of(len(missing), total)} not in the candidate", worst)


def new_runs_check(paired: PairedStores) -> Check:
    """Return whether every run of the candidate is in the baseline."""
    new = paired.pairing.new
    subject = CheckSubject("no new runs", "runs", paired.policy.new_runs, two_sided=True)
    verdicts = np.full(len(new), CHANGED, dtype=np.int8)
    worst = unpaired_runs(paired.candidate, "candidate", new[:MOST_SHOWN].tolist())
    message = f"{plural(len(new))} not in the baseline" if len(new) else "none"
    return subject.check(verdicts, message, worst)


def knife_edge_check(paired: PairedStores) -> Check:
    """Return whether few enough runs are on a knife edge."""
    rules = paired.policy.knife_edge
    subject = CheckSubject("few knife-edge runs", "runs", rules.level)
    columns = paired.numbers("knife_edge")
    before, after = (int((each.values == 1).sum()) for each in columns)
    flagged = knife_edge(paired)
    total, excluded = len(flagged), int(flagged.sum()) if rules.exclude else 0
    too_many = after > max(rules.max_share * total, before)
    message = "not looked for"
    if any(each.valid.any() for each in columns):
        allowed = format_percent(rules.max_share)
        message = f"{out_of(after, total)}, {before:,} in the baseline ({allowed} may be)"
        message += f"; {plural(excluded)} set apart" if excluded else ""
    return subject.single(WORSE if too_many else SAME, message, runs=total)


def expectation_checks(paired: PairedStores) -> Iterator[Check]:
    """Yield whether runs still meet the expectations, and the tolerances, of the sweep."""
    for column, name in (("expectation_met", "expectations"), ("tolerances_met", "tolerances")):
        before, after = paired.numbers(column)
        verdicts = np.full(len(before.values), SAME, dtype=np.int8)
        verdicts[(before.values == 1) & (after.values == 0)] = WORSE
        verdicts[(before.values == 0) & (after.values == 1)] = BETTER
        verdicts[(before.values == 1) & ~after.valid] = MISSING
        verdicts[~before.valid & (after.values == 0)] = CHANGED
        judged = before.valid | after.valid
        message = f"{out_of(int((after.values == 1).sum()), int(judged.sum()))} within {name}"
        message = message if judged.any() else f"the sweep has no {name}"
        shown = np.flatnonzero(verdicts == WORSE)[:MOST_SHOWN].tolist()
        worst = paired.run_pairs(shown, ["met"] * len(shown), ["not met"] * len(shown))
        subject = CheckSubject(f"{name} still met", "labels", paired.policy.expectations)
        yield subject.check(verdicts[judged], message, worst)


def recommendation_check(paired: PairedStores) -> Check:
    """Return whether what `contactlab tradeoff` recommends for the baseline still holds.

    It holds while it is feasible in the candidate and no feasible configuration is clearly faster,
    both by the candidate's own times.
    """
    level = paired.policy.recommendation.changed
    subject = CheckSubject("same recommendation", "recommendation", level, two_sided=True)
    before, after = _analysis(paired.baseline), _analysis(paired.candidate)
    return subject.single(*_recommendation(before, after))


def _analysis(store: Store) -> TradeoffReport | None:
    try:
        return analyse(store)
    except (ContactlabError, ValidationError):
        # No error was measured, or the sweep is of another version of contactlab.
        return None


def _recommendation(before: TradeoffReport | None, after: TradeoffReport | None) -> tuple[int, str]:
    now = after.recommendation if after else None
    if before is None or after is None or before.recommendation is None:
        if now is None:
            return SAME, "neither store recommends a configuration"
        return BETTER, f"now recommends {format_settings(now.configuration)}"
    configuration = before.recommendation.configuration
    old = format_settings(configuration) or "the only configuration"
    if now is None:
        return WORSE, f"{old} is not feasible any more, and nothing else is"
    new = format_settings(now.configuration)
    found = next((x for x in after.configurations if x.configuration == configuration), None)
    if found is None or not found.feasible or found.time is None:
        return WORSE, f"{old} is not feasible any more; now recommends {new}"
    saved = 1 - now.time / found.time
    if saved > _FASTER:
        return CHANGED, f"{new} takes {format_percent(saved)} less time than {old}"
    return SAME, old
