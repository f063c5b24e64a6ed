"""Computes every metric, label and series of a trace."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats, PairSeries, SelfChecks, Trace
from contactlab.contact.trace_setup import Setup
from contactlab.errors import ContactlabError
from contactlab.measure.backward_error import numerical_error_text, resolved_runs
from contactlab.measure.context import Context, StackedPairs, context_of
from contactlab.measure.coverage import run_coverages
from contactlab.measure.entries import LABELS, METRICS, MeasuredRuns, Metric, labels_with
from contactlab.measure.run_integrity import STABLE, invalid
from contactlab.measure.second_look import needs_second_pass
from contactlab.schema.coverage import Coverage

Failures = dict[int, list[str]]  # error messages of metrics and labels, by run

_RunResult = TypeVar("_RunResult")

NUMERICAL_CAUSE = "cause: the numerics"
"""Words in the reason of a label that a numerical error causes."""


class AppliedLabel(NamedTuple):
    """A label that applies to a run: the reason, its first step, and its bodies.

    A label of the whole run has no bodies.
    """

    label: str
    reason: str
    step: int
    bodies: tuple[str, ...] = ()


@dataclass(frozen=True)
class Assessment:
    """Measurements of n runs."""

    metrics: dict[str, Floats]  # every metric by name, (n,) each; NaN if it does not apply
    # For each run the labels that apply, worst first; `stable` if none does.
    labels: tuple[tuple[AppliedLabel, ...], ...]
    pairs: StackedPairs  # the contacts of the monitored pairs
    # (n,) whether a second pass is due: because of a label, or of a sign that no label covers.
    suspect: NDArray[np.bool_]
    # For each run the body with its backward error; None if none was measured.
    backward_error_body: tuple[str, ...] | None = None
    # The coverage of each run; None if the setup does not request it.
    coverage: tuple[Coverage, ...] | None = None

    @property
    def series(self) -> tuple[PairSeries, ...]:
        """The net quantities of each monitored pair over time."""
        return self.pairs.series


def assess_runs(trace: Trace, setup: Setup, checks: SelfChecks | None = None) -> Assessment:
    """Measure and label the runs of a trace, with the results of a second pass if there was one.

    Raises a SceneError if the setup names an oracle or a threshold that does not exist.
    """
    context = context_of(trace, setup, checks)
    failures: Failures = {}
    with np.errstate(all="ignore"):
        metrics = {
            name: _measure_metric(metric, context, failures) for name, metric in METRICS.items()
        }
        labels = _measure_labels(MeasuredRuns(context, metrics), failures)
        suspect = np.array([own[0].label != STABLE.name for own in labels])
        if checks is None and trace.steps:
            suspect |= needs_second_pass(context)
        covered = run_coverages(context)
    bodies = tuple(error.body for error in checks.backward) if checks else ()
    return Assessment(metrics, labels, context.pairs, suspect, bodies or None, covered)


def _measure_metric(metric: Metric, context: Context, failures: Failures) -> Floats:
    def measured(runs: MeasuredRuns) -> Sequence[float]:
        return metric.of(runs.context).tolist()

    runs = MeasuredRuns(context, {})
    return np.array(_measure_or_fail(f"metric '{metric.name}'", measured, runs, failures, np.nan))


def _measure_labels(runs: MeasuredRuns, failures: Failures) -> tuple[tuple[AppliedLabel, ...], ...]:
    applied: list[list[AppliedLabel]] = [[] for _ in range(runs.context.trace.runs)]
    for name, label in LABELS.items():
        onsets = _measure_or_fail(f"label '{name}'", label.of, runs, failures, None)
        for own, onset in zip(applied, onsets, strict=True):
            if onset:
                own.append(AppliedLabel(name, *onset))
    applied = [[*_add_causes(runs.context, *indexed)] for indexed in enumerate(applied)]
    for run, reasons in failures.items():
        others = [verdict for verdict in applied[run] if verdict.label != invalid.__name__]
        applied[run] = [AppliedLabel(invalid.__name__, "; ".join(reasons), 0), *others]
    none = (AppliedLabel(STABLE.name, STABLE.meaning, 0),)
    return tuple(tuple(labels) or none for labels in applied)


def _add_causes(context: Context, run: int, labels: list[AppliedLabel]) -> Iterator[AppliedLabel]:
    """Yield labels of a run; labels that may be numerical get their cause in the reason."""
    traced, resolved = labels_with("numerical"), resolved_runs(context)
    for label in labels:
        if resolved is None or label.label not in traced:
            yield label
        else:
            cause = "cause: the model" if resolved[run] else NUMERICAL_CAUSE
            error = numerical_error_text(context, run)
            yield label._replace(reason=f"{label.reason}; {cause} ({error})")


def _measure_or_fail(
    name: str,
    measure: Callable[[MeasuredRuns], Sequence[_RunResult]],
    runs: MeasuredRuns,
    failures: Failures,
    missing: _RunResult,
) -> Sequence[_RunResult]:
    """Return the measurements of each run; for a failed run, `missing` and the error message."""
    count = runs.context.trace.runs
    try:
        return measure(runs)
    except (ContactlabError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001 - a plug-in may raise anything
        if count == 1:
            reason = f"{name} failed: {type(error).__name__}: {error}"
            failures.setdefault(0, []).append(reason)
            return [missing]
    # Measure runs one by one, so that a run's result does not depend on the other runs.
    results: list[_RunResult] = []
    for run in range(count):
        alone: Failures = {}
        results += _measure_or_fail(name, measure, runs.only(run), alone, missing)
        if alone:
            failures.setdefault(run, []).extend(alone[0])
    return results
