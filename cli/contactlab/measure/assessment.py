"""Every metric, label and series of a trace."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from contactlab.contact import Floats, PairSeries, SelfChecks, Setup, Trace
from contactlab.measure.context import context_of
from contactlab.measure.entries import LABELS, METRICS, MeasuredRuns
from contactlab.measure.run_integrity import STABLE


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
    """

    metrics: dict[str, Floats]
    labels: tuple[tuple[AppliedLabel, ...], ...]
    series: tuple[PairSeries, ...]


def assess(trace: Trace, setup: Setup, checks: SelfChecks | None = None) -> Assessment:
    """Measure and label the runs of a trace, with what a second pass found if there was one.

    Raises:
        SceneError: the setup names an oracle or a threshold that does not exist.
    """
    context = context_of(trace, setup, checks)
    metrics = {name: metric.of(context) for name, metric in METRICS.items()}
    with np.errstate(all="ignore"):
        labels = _labels(MeasuredRuns(context, metrics))
    return Assessment(metrics, labels, context.series)


def _labels(runs: MeasuredRuns) -> tuple[tuple[AppliedLabel, ...], ...]:
    applied: list[list[AppliedLabel]] = [[] for _ in range(runs.context.trace.runs)]
    for label in LABELS.values():
        findings = label.rule(runs) if label.rule else {}
        for run, (reason, step) in findings.items():
            applied[run].append(AppliedLabel(label.name, reason, step))
    none = (AppliedLabel(STABLE.name, STABLE.meaning, 0),)
    return tuple(tuple(labels) or none for labels in applied)
