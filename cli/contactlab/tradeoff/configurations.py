"""What each configuration costs and errs in its worst run, and whether it will do."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from contactlab.contact import Floats
from contactlab.schema import Configuration, ErrorMeasure, Outcomes, TimeMeasure
from contactlab.tradeoff.interval import wilson
from contactlab.tradeoff.runs import ESTIMATES, Group, Runs, group

STABLE = "stable"


@dataclass(frozen=True)
class Weighing:
    """What configurations are weighed by.

    Attributes:
        error: the column of the error, how it is called and from where on it counts.
        time: the column of the time.
        tolerances: metric to largest size.
    """

    error: ErrorMeasure
    time: TimeMeasure
    tolerances: Mapping[str, float]


@dataclass(frozen=True)
class Weighed:
    """One configuration.

    Attributes:
        group: its runs.
        summary: what came of them.
        estimate: how far the reference of its error may be off, in the error's unit; 0 without.
        impacts: most impacts in any of its runs.
        failures: runs by label, of those with a failure label.
        missed: metrics whose tolerance is not met.
    """

    group: Group
    summary: Configuration
    estimate: float
    impacts: float
    failures: Mapping[str, int]
    missed: tuple[str, ...]


def weigh(runs: Runs, weighing: Weighing) -> list[Weighed]:
    """Return every configuration with what came of it.

    A configuration is feasible if it was run in every scenario and seed that any other was run in,
    has no failure label in any of them, meets every tolerance in the worst of them, and was timed.
    """
    groups = group(runs)
    every = frozenset[object]().union(*(each.cases for each in groups))
    return [_weighed(runs, each, weighing, len(every)) for each in groups]


def _weighed(runs: Runs, found: Group, weighing: Weighing, cases: int) -> Weighed:
    labels = Counter(runs.labels[row] for row in found.rows)
    failures = {name: count for name, count in labels.items() if name != STABLE}
    worst = {name: judged(runs, found.rows, name) for name in weighing.tolerances}
    missed = tuple(
        name
        for name, limit in weighing.tolerances.items()
        if (value := worst[name]) is None or value > limit
    )
    time = _known(runs, found.rows, weighing.time.name)
    reasons = [
        *(f"{count} of {len(found.rows)} runs are {name}" for name, count in failures.items()),
        *(_miss(name, worst[name], weighing.tolerances[name]) for name in missed),
        *([f"run in {len(found.cases)} of {cases} cases"] if len(found.cases) < cases else []),
        *([] if len(time) else ["not timed"]),
    ]
    estimate = 0.0
    if weighing.error.kind == "discretisation":
        estimate = largest(runs, found.rows, ESTIMATES[weighing.error.name]) or 0.0
    error = judged(runs, found.rows, weighing.error.name)
    mean = float(np.mean(time)) if len(time) else None
    summary = Configuration(
        configuration=found.values,
        time=mean,
        time_worst=float(np.max(time)) if len(time) else None,
        real_time_factor=1 / mean if mean else None,
        error=None if error is None else max(error, weighing.error.resolution),
        below_estimate=error is not None and 0 < error <= estimate,
        solref_clamped=(largest(runs, found.rows, "solref_clamped") or 0) > 0,
        step_p99=largest(runs, found.rows, "step_p99"),
        feasible=not reasons,
        reasons=tuple(reasons),
        worst=worst,
        margins={name: margin(limit, worst[name]) for name, limit in weighing.tolerances.items()},
        outcomes=_outcomes(runs, found.rows, weighing.tolerances, labels),
    )
    impacts = largest(runs, found.rows, "impacts") or 0.0
    return Weighed(found, summary, estimate, impacts, failures, missed)


def margin(tolerance: float, worst: float | None) -> float | None:
    """Return how many times a value could grow within its tolerance.

    None if the value is unknown, or so small that the margin has no bound.
    """
    ratio = tolerance / worst if worst else math.inf
    return ratio if math.isfinite(ratio) else None


def largest(runs: Runs, rows: list[int], name: str) -> float | None:
    """Return the largest size of a column over some runs; None if any has no value."""
    if name not in runs.numbers:
        return None
    sizes = np.abs(runs.numbers[name][rows])
    return None if np.isnan(sizes).any() else float(sizes.max())


def judged(runs: Runs, rows: list[int], name: str) -> float | None:
    """Return the size of a column that tolerances are held against; None if a run has no value."""
    sizes = _sizes(runs, rows, name)
    return None if np.isnan(sizes).any() else float(sizes.max())


def _sizes(runs: Runs, rows: list[int], name: str) -> Floats:
    """Return the size of a column in each run; NaN where there is none.

    An error against a reference is at least what the reference itself may be off by.
    """
    sizes = np.abs(runs.numbers[name][rows])
    estimate = ESTIMATES.get(name)
    if estimate is None or estimate not in runs.numbers:
        return sizes
    return np.maximum(sizes, np.nan_to_num(runs.numbers[estimate][rows]))


def _known(runs: Runs, rows: list[int], name: str) -> np.ndarray:
    values = runs.numbers[name][rows]
    return values[np.isfinite(values)]


def _miss(name: str, worst: float | None, tolerance: float) -> str:
    if worst is None:
        return f"{name} could not be measured in every run"
    return f"{name} reaches {worst:.3g} of {tolerance:.3g}"


def _outcomes(
    runs: Runs, rows: list[int], tolerances: Mapping[str, float], labels: Mapping[str, int]
) -> Outcomes:
    good = np.array([runs.labels[row] == STABLE for row in rows])
    for name, limit in tolerances.items():
        # A comparison with NaN is false, as it should be.
        good &= _sizes(runs, rows, name) <= limit
    low, high = wilson(int(good.sum()), len(rows))
    return Outcomes(runs=len(rows), good=int(good.sum()), low=low, high=high, labels=dict(labels))


def errors(found: Sequence[Weighed]) -> np.ndarray:
    """Return (n,) errors, NaN where unknown."""
    return np.array([_number(each.summary.error) for each in found])


def times(found: Sequence[Weighed]) -> np.ndarray:
    """Return (n,) times [CPU s per simulated s], NaN where unknown."""
    return np.array([_number(each.summary.time) for each in found])


def _number(value: float | None) -> float:
    return np.nan if value is None else value
