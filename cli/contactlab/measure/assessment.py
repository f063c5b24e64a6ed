"""Every metric, label and series of a trace."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from contactlab.contact.trace_arrays import Floats, PairSeries, SelfChecks, Trace
from contactlab.contact.trace_setup import Setup
from contactlab.errors import ContactlabError
from contactlab.measure.context import Context, context_of
from contactlab.measure.coverage import coverages
from contactlab.measure.entries import LABELS, METRICS, Findings, Label, MeasuredRuns, Metric
from contactlab.measure.run_integrity import STABLE, invalid
from contactlab.schema.coverage import Coverage

Failures = dict[int, list[str]]
"""Why metrics and labels fail, by run."""


class AppliedLabel(NamedTuple):
    """A label that applies to a run, with the reason in words and the first step it is met at."""

    label: str
    reason: str
    step: int


@dataclass(frozen=True)
class Assessment:
    """What was measured of n runs.

    Attributes:
        metrics: every metric by name, (n,) each; NaN where it does not apply.
        labels: for each run the labels that apply, worst first; `stable` if none does.
        series: net quantities of each monitored pair over time.
        coverage: what each run exercised; None where the setup does not ask.
    """

    metrics: dict[str, Floats]
    labels: tuple[tuple[AppliedLabel, ...], ...]
    series: tuple[PairSeries, ...]
    coverage: tuple[Coverage, ...] | None = None


def assess(trace: Trace, setup: Setup, checks: SelfChecks | None = None) -> Assessment:
    """Measure and label the runs of a trace, with what a second pass found if there was one.

    Raises:
        SceneError: the setup names an oracle or a threshold that does not exist.
    """
    context = context_of(trace, setup, checks)
    failures: Failures = {}
    metrics = {name: _values(metric, context, failures) for name, metric in METRICS.items()}
    with np.errstate(all="ignore"):
        labels = _labels(MeasuredRuns(context, metrics), failures)
    return Assessment(metrics, labels, context.series, coverages(context))


def _values(metric: Metric, context: Context, failures: Failures) -> Floats:
    """Return a metric of every run; NaN, and why, for runs for which it fails."""
    try:
        return _checked(metric, context)
    except (ContactlabError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001 - a plug-in may raise anything
        if context.trace.runs == 1:
            reason = f"metric '{metric.name}' failed: {type(error).__name__}: {error}"
            failures.setdefault(0, []).append(reason)
            return context.undefined()
    # One by one, so that a run's outcome does not depend on those that it is measured with.
    values = context.undefined()
    for run in range(context.trace.runs):
        alone: Failures = {}
        values[run] = _values(metric, context.only(run), alone)[0]
        if alone:
            failures.setdefault(run, []).extend(alone[0])
    return values


def _checked(metric: Metric, context: Context) -> Floats:
    values = metric.of(context)
    if values.shape != (context.trace.runs,):
        raise ValueError(f"it returns shape {values.shape} for {context.trace.runs} runs")
    return values


def _labels(runs: MeasuredRuns, failures: Failures) -> tuple[tuple[AppliedLabel, ...], ...]:
    applied: list[list[AppliedLabel]] = [[] for _ in range(runs.context.trace.runs)]
    for label in LABELS.values():
        findings = _findings(label, runs, failures)
        for run, (reason, step) in findings.items():
            applied[run].append(AppliedLabel(label.name, reason, step))
    for run, reasons in failures.items():
        others = [each for each in applied[run] if each.label != invalid.__name__]
        applied[run] = [AppliedLabel(invalid.__name__, "; ".join(reasons), 0), *others]
    none = (AppliedLabel(STABLE.name, STABLE.meaning, 0),)
    return tuple(tuple(labels) or none for labels in applied)


def _findings(label: Label, runs: MeasuredRuns, failures: Failures) -> Findings:
    """Return the runs that a label applies to; none, and why, where its rule fails."""
    if label.rule is None:
        return {}
    try:
        return label.rule(runs)
    except (ContactlabError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001 - a plug-in may raise anything
        count = runs.context.trace.runs
        if count == 1:
            reason = f"label '{label.name}' failed: {type(error).__name__}: {error}"
            failures.setdefault(0, []).append(reason)
            return {}
    found: Findings = {}
    for run in range(count):
        alone: Failures = {}
        metrics = {name: values[run : run + 1] for name, values in runs.metrics.items()}
        single = _findings(label, MeasuredRuns(runs.context.only(run), metrics), alone)
        if single:
            found[run] = single[0]
        if alone:
            failures.setdefault(run, []).extend(alone[0])
    return found
