"""Runs as such: which are missing or new, which are set apart, what was expected of them."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from contactlab.compare.checks import MOST_SHOWN, Subject, made
from contactlab.compare.compared import Compared, lone_runs
from contactlab.compare.sides import Side
from contactlab.compare.verdicts import BETTER, CHANGED, MISSING, SAME, WORSE
from contactlab.compare.wording import of, share, some
from contactlab.schema import Check

Flags = NDArray[np.bool_]


def run_checks(compared: Compared) -> Iterator[Check]:
    """Yield whether both stores have the same runs."""
    yield _partners(compared)
    yield _strangers(compared)


def store_checks(baseline: Side, candidate: Side) -> Iterator[Check]:
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


def bitwise_equal(compared: Compared) -> Flags:
    """Return which pairs (n,) have equal trajectories, bit for bit."""
    before = compared.baseline.columns.keys("trajectory_hash")[compared.pairing.baseline]
    after = compared.candidate.columns.keys("trajectory_hash")[compared.pairing.candidate]
    return (before == after) & (before != b"")


def knife_edge(compared: Compared) -> Flags:
    """Return which pairs (n,) have a run whose label a start 1e-6 away would change."""
    before, after = compared.numbers("knife_edge")
    return (before.values == 1) | (after.values == 1)


def knife_edge_check(compared: Compared, flags: Flags) -> Check:
    """Return whether there are not too many knife-edge runs to set apart."""
    rules = compared.policy.knife_edge
    subject = Subject("few knife-edge runs", "runs", rules.level)
    before, after = (int((side.values == 1).sum()) for side in compared.numbers("knife_edge"))
    total = len(flags)
    too_many = after > max(rules.max_share * total, before)
    verdict = np.full(1, WORSE if too_many else SAME, dtype=np.int8)
    asked = any(side.given.any() for side in compared.numbers("knife_edge"))
    text = f"{of(after, total)}, {before:,} in the baseline ({share(rules.max_share)} may be)"
    apart = f"; {some(int(flags.sum()))} set apart" if rules.exclude and flags.any() else ""
    return made(subject, verdict, text + apart if asked else "not looked for", runs=total)


def expectation_checks(compared: Compared) -> Iterator[Check]:
    """Yield whether runs are still as expected, and still within the sweep's tolerances."""
    for column, name in (("expectation_met", "expectations"), ("tolerances_met", "tolerances")):
        before, after = compared.numbers(column)
        verdicts = np.full(len(before.values), SAME, dtype=np.int8)
        verdicts[(before.values == 1) & (after.values == 0)] = WORSE
        verdicts[(before.values == 0) & (after.values == 1)] = BETTER
        verdicts[(before.values == 1) & ~after.given] = MISSING
        verdicts[~before.given & (after.values == 0)] = CHANGED
        judged = before.given | after.given
        met = f"{of(int((after.values == 1).sum()), int(judged.sum()))} within {name}"
        text = met if judged.any() else f"the sweep has no {name}"
        shown = np.flatnonzero(verdicts == WORSE)[:MOST_SHOWN].tolist()
        worst = compared.run_pairs(shown, ["met"] * len(shown), ["not met"] * len(shown))
        subject = Subject(f"{name} still met", "labels", compared.policy.expectations)
        yield made(subject, verdicts[judged], text, worst)


def _partners(compared: Compared) -> Check:
    pairing = compared.pairing
    total = len(pairing.baseline) + len(pairing.missing)
    verdicts = np.zeros(total, dtype=np.int8)
    verdicts[: len(pairing.missing)] = MISSING
    subject = Subject("no missing runs", "runs", compared.policy.missing_runs)
    text = f"{of(len(pairing.missing), total)} not in the candidate"
    shown = lone_runs(compared.baseline, pairing.missing[:MOST_SHOWN].tolist())
    return made(subject, verdicts, text if shown else f"all {total:,} are there", shown)


def _strangers(compared: Compared) -> Check:
    new = compared.pairing.new
    subject = Subject("no new runs", "runs", compared.policy.new_runs, two_sided=True)
    verdicts = np.full(len(new), CHANGED, dtype=np.int8)
    shown = lone_runs(compared.candidate, new[:MOST_SHOWN].tolist())
    text = f"{some(len(new))} not in the baseline" if shown else "none"
    return made(subject, verdicts, text, shown)


def _warning(name: str, text: str, wrong: bool) -> Check:
    verdict = np.full(1, CHANGED if wrong else SAME, dtype=np.int8)
    return made(Subject(name, "evidence", "warn", two_sided=True), verdict, text, runs=0)
