"""Whether a sweep ended as it expects: findings of its runs and means."""

from collections.abc import Iterator

import numpy as np

from contactlab.judge.subjects import MOST_SHOWN
from contactlab.judge.wording import out_of
from contactlab.judge.worst_runs import worst_first
from contactlab.schema.finding import Finding, RunPair
from contactlab.store.finished_store import Store

RUNS, EXPECTED, MEANS = "runs finished", "runs as expected", "means as expected"


def expectation_findings(store: Store) -> Iterator[Finding]:
    """Yield the findings on finished runs, expected runs and expected means."""
    manifest = store.manifest
    lost = manifest.statuses.get("crashed", 0) + manifest.statuses.get("timeout", 0)
    summary = f"{out_of(lost, manifest.runs)} crashed or timed out" if lost else "all did"
    # A sweep may expect invalid runs.
    met_count, unmet = (manifest.expectations.get(name, 0) for name in ("met", "unmet"))
    all_invalid = manifest.labels.get("invalid", 0) == manifest.runs and not met_count
    if not lost and all_invalid:
        first = store.columns.read_arrow(["label_reason"])["label_reason"][:1].to_pylist()
        reason = next(filter(None, first), "without a reason")
        lost, summary = manifest.runs, f"all {manifest.runs:,} runs are invalid: {reason}"
    yield _make_finding(RUNS, "runs", manifest.runs, lost, summary)
    rest = manifest.runs - met_count - unmet
    summary = f"{met_count:,} of {met_count + unmet:,} runs are as expected"
    summary += f"; {rest:,} have no expectation" if rest else ""
    if not met_count + unmet:
        # Requirements are judged by labels, as any other fault of a run.
        is_required = bool(manifest.sweep.resolved.get("must"))
        summary = "no `expect` in the sweep" + "; labels judge its `must`" * is_required
    yield _make_finding(EXPECTED, "labels", met_count + unmet, unmet, summary, _unmet_runs(store))
    if means := manifest.unmet_means:
        yield _make_finding(MEANS, "metrics", len(means), len(means), "; ".join(means))


def _make_finding(
    name: str,
    kind: str,
    judged_count: int,
    failing: int,
    message: str,
    worst: tuple[RunPair, ...] = (),
) -> Finding:
    return Finding(
        name=name,
        kind=kind,
        level="gate" if judged_count else "note",
        outcome="failed" if failing else "passed" if judged_count else "skipped",
        verdict="unmet" if failing else "met" if judged_count else "not applicable",
        judged=judged_count,
        failing=failing,
        message=message,
        worst=worst,
    )


def _unmet_runs(store: Store) -> tuple[RunPair, ...]:
    """Return the worst runs that are not as expected, each with the reason."""
    columns = store.columns
    unmet = columns.numbers("expectation_met")
    unmet_rows = np.flatnonzero(unmet.valid & (unmet.values == 0))
    if not len(unmet_rows):
        return ()
    rows = worst_first(store, unmet_rows)[:MOST_SHOWN].tolist()
    names = ["run_id", "expectation_reason", "label", *columns.axis_names]
    return tuple(
        RunPair(
            baseline_run=None,
            candidate_run=row["run_id"],
            axes={name: row[name] for name in columns.axis_names},
            baseline="",
            candidate=f"{row['label']}: {row['expectation_reason']}",
        )
        for row in columns.select_values(names, rows)
    )
