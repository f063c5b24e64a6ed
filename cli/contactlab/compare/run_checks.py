"""Runs as such: which are missing or new, which are set apart, what was expected of them."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from contactlab.compare.opened_stores import OpenedStore
from contactlab.compare.paired_stores import PairedStores, unpaired_runs
from contactlab.compare.verdicts import (
    BETTER,
    CHANGED,
    MISSING,
    MOST_SHOWN,
    SAME,
    WORSE,
    CheckSubject,
    make_check,
)
from contactlab.compare.wording import format_percent, format_settings, out_of, plural
from contactlab.errors import ContactlabError
from contactlab.schema import Check, Configuration, TradeoffReport
from contactlab.store import Store
from contactlab.tradeoff import analyse

Flags = NDArray[np.bool_]


def run_checks(compared: PairedStores) -> Iterator[Check]:
    """Yield whether both stores have the same runs."""
    yield _partners(compared)
    yield _strangers(compared)


def store_checks(baseline: OpenedStore, candidate: OpenedStore) -> Iterator[Check]:
    """Yield whether the stores are two, in the right order; these only warn."""
    before, after = baseline.manifest, candidate.manifest
    copy = (before.started, before.finished, before.sweep) == (
        after.started,
        after.finished,
        after.sweep,
    )
    text = "both were written at the same instant: the sweep did not run again"
    yield _warning("candidate is no copy", text if copy else "written by a sweep of its own", copy)
    older = after.finished < before.finished
    text = f"finished {after.finished[:19]}, before the baseline: are they swapped?"
    yield _warning("candidate is newer", text if older else "finished after the baseline", older)


def bitwise_equal(compared: PairedStores) -> Flags:
    """Return which pairs (n,) have equal trajectories, bit for bit."""
    before = compared.baseline.columns.byte_strings("trajectory_hash")[compared.pairing.baseline]
    after = compared.candidate.columns.byte_strings("trajectory_hash")[compared.pairing.candidate]
    return (before == after) & (before != b"")


def knife_edge(compared: PairedStores) -> Flags:
    """Return which pairs (n,) have a run whose label a start 1e-6 away would change."""
    before, after = compared.numbers("knife_edge")
    return (before.values == 1) | (after.values == 1)


def knife_edge_check(compared: PairedStores, flags: Flags) -> Check:
    """Return whether there are not too many knife-edge runs to set apart."""
    rules = compared.policy.knife_edge
    subject = CheckSubject("few knife-edge runs", "runs", rules.level)
    before, after = (int((side.values == 1).sum()) for side in compared.numbers("knife_edge"))
    total = len(flags)
    too_many = after > max(rules.max_share * total, before)
    verdict = np.full(1, WORSE if too_many else SAME, dtype=np.int8)
    asked = any(side.valid.any() for side in compared.numbers("knife_edge"))
    allowed = format_percent(rules.max_share)
    text = f"{out_of(after, total)}, {before:,} in the baseline ({allowed} may be)"
    apart = f"; {plural(int(flags.sum()))} set apart" if rules.exclude and flags.any() else ""
    return make_check(subject, verdict, text + apart if asked else "not looked for", runs=total)


def expectation_checks(compared: PairedStores) -> Iterator[Check]:
    """Yield whether runs are still as expected, and still within the sweep's tolerances."""
    for column, name in (("expectation_met", "expectations"), ("tolerances_met", "tolerances")):
        before, after = compared.numbers(column)
        verdicts = np.full(len(before.values), SAME, dtype=np.int8)
        verdicts[(before.values == 1) & (after.values == 0)] = WORSE
        verdicts[(before.values == 0) & (after.values == 1)] = BETTER
        verdicts[(before.values == 1) & ~after.valid] = MISSING
        verdicts[~before.valid & (after.values == 0)] = CHANGED
        judged = before.valid | after.valid
        met = f"{out_of(int((after.values == 1).sum()), int(judged.sum()))} within {name}"
        text = met if judged.any() else f"the sweep has no {name}"
        shown = np.flatnonzero(verdicts == WORSE)[:MOST_SHOWN].tolist()
        worst = compared.run_pairs(shown, ["met"] * len(shown), ["not met"] * len(shown))
        subject = CheckSubject(f"{name} still met", "labels", compared.policy.expectations)
        yield make_check(subject, verdicts[judged], text, worst)


def _partners(compared: PairedStores) -> Check:
    pairing = compared.pairing
    total = len(pairing.baseline) + len(pairing.missing)
    verdicts = np.zeros(total, dtype=np.int8)
    verdicts[: len(pairing.missing)] = MISSING
    subject = CheckSubject("no missing runs", "runs", compared.policy.missing_runs)
    text = f"{out_of(len(pairing.missing), total)} not in the candidate"
    shown = unpaired_runs(compared.baseline, pairing.missing[:MOST_SHOWN].tolist())
    return make_check(subject, verdicts, text if shown else f"all {total:,} are there", shown)


def _strangers(compared: PairedStores) -> Check:
    new = compared.pairing.new
    subject = CheckSubject("no new runs", "runs", compared.policy.new_runs, two_sided=True)
    verdicts = np.full(len(new), CHANGED, dtype=np.int8)
    shown = unpaired_runs(compared.candidate, new[:MOST_SHOWN].tolist())
    text = f"{plural(len(new))} not in the baseline" if shown else "none"
    return make_check(subject, verdicts, text, shown)


def _warning(name: str, text: str, wrong: bool) -> Check:
    verdict = np.full(1, CHANGED if wrong else SAME, dtype=np.int8)
    return make_check(CheckSubject(name, "evidence", "warn", two_sided=True), verdict, text, runs=0)


_FASTER = 0.15
"""Below this share stored times, of two sessions of one machine, cannot be told apart."""


def recommendation_check(compared: PairedStores) -> Check:
    """Return whether what `contactlab tradeoff` recommends by the baseline still holds.

    It does as long as it is feasible in the candidate and nothing feasible is clearly cheaper
    there; both by the candidate's own times.
    """
    subject = CheckSubject(
        "same recommendation",
        "recommendation",
        compared.policy.recommendation.changed,
        two_sided=True,
    )
    before, after = (_weighed(side.store) for side in (compared.baseline, compared.candidate))
    code, text = _verdict(before, after)
    return make_check(subject, np.full(1, code, dtype=np.int8), text, runs=0)


def _verdict(before: TradeoffReport | None, after: TradeoffReport | None) -> tuple[int, str]:
    if before is None or after is None or before.recommendation is None:
        if after is None or after.recommendation is None:
            return SAME, "neither store recommends a configuration"
        return BETTER, f"now recommends {format_settings(after.recommendation.configuration)}"
    told = format_settings(before.recommendation.configuration) or "the only configuration"
    if after.recommendation is None:
        return WORSE, f"{told} is not feasible any more, and nothing else is"
    now = format_settings(after.recommendation.configuration)
    found = _of(after, before.recommendation.configuration)
    if found is None or not found.feasible or found.time is None:
        return WORSE, f"{told} is not feasible any more; now recommends {now}"
    spared = 1 - after.recommendation.time / found.time
    if spared > _FASTER:
        return CHANGED, f"{now} takes {format_percent(spared)} less time than {told}"
    return SAME, told


def _of(report: TradeoffReport, values: object) -> Configuration | None:
    return next((each for each in report.configurations if each.configuration == values), None)


def _weighed(store: Store) -> TradeoffReport | None:
    try:
        return analyse(store)
    except (ContactlabError, ValidationError):
        # Nothing to weigh by was measured, or the sweep is of another version of contactlab.
        return None
