"""Every metric, label and series of a trace."""

from dataclasses import dataclass

import numpy as np

from contactlab.contact import Floats, PairSeries, SelfChecks, Setup, Trace
from contactlab.measure.context import context_of
from contactlab.measure.label import Case, Outcome
from contactlab.measure.labels import LABELS, STABLE
from contactlab.measure.metrics import METRICS


@dataclass(frozen=True)
class Assessment:
    """What was measured of n runs.

    Attributes:
        metrics: every metric by name, (n,) each; NaN where it does not apply.
        labels: for each run the labels that apply, worst first; `stable` if none does.
        series: net quantities of each graded pair over time.
    """

    metrics: dict[str, Floats]
    labels: tuple[tuple[Outcome, ...], ...]
    series: tuple[PairSeries, ...]


def assess(trace: Trace, setup: Setup, checks: SelfChecks | None = None) -> Assessment:
    """Measure and label the runs of a trace, with what a second pass found if there was one.

    Raises:
        SceneError: the setup names an oracle or a threshold that does not exist.
    """
    context = context_of(trace, setup, checks)
    metrics = {name: metric.of(context) for name, metric in METRICS.items()}
    with np.errstate(all="ignore"):
        labels = _labels(Case(context, metrics))
    return Assessment(metrics, labels, context.series)


def _labels(case: Case) -> tuple[tuple[Outcome, ...], ...]:
    found: list[list[Outcome]] = [[] for _ in range(case.context.trace.runs)]
    for label in LABELS.values():
        findings = label.rule(case) if label.rule else {}
        for run, (reason, step) in findings.items():
            found[run].append(Outcome(label.name, reason, step))
    nothing = (Outcome(STABLE.name, STABLE.meaning, 0),)
    return tuple(tuple(outcomes) or nothing for outcomes in found)
