"""Sensitivity of metrics to sampled axes: shares of their variance."""

import warnings
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.rendering.amounts import format_interval, format_percent, format_setting
from contactlab.reporting.report_columns import summary_metrics
from contactlab.schema.evidence import ParameterBudget, ParameterRow
from contactlab.schema.sweep_schema import MOST_SENSITIVITIES
from contactlab.store.finished_store import Store

FAILED = "failed"


@dataclass(frozen=True)
class Sensitivity:
    """Shares of a metric's variance over d sampled axes, of one seed and one value of the others.

    Attributes:
        metric: its name, or `failed`: 0 for stable runs, 1 for others.
        shared: the values of the other axes that vary, and of the seed, by name.
        axes: names of the sampled axes.
        first, total: (d) the share that goes with an axis alone, and with all that it is part of.
        first_interval, total_interval: (d, 2) bootstrapped, with 95 %.
    """

    metric: str
    shared: dict[str, object]
    axes: tuple[str, ...]
    first: Floats
    first_interval: Floats
    total: Floats
    total_interval: Floats


def find_sensitivities(store: Store, metrics: Sequence[str] = ()) -> Iterator[Sensitivity]:
    """Yield the sensitivities of a sweep with `sample` by the method `saltelli`; none otherwise.

    The shares are those of I. M. Sobol (1993), by the estimators of A. Saltelli et al., "Variance
    based sensitivity analysis of model output", 2010, as SciPy has them. Metrics are those of the
    summary unless some are named; one that a run lacks, or that does not vary, is left out.
    """
    sweep = store.sweep
    if sweep.sample is None or sweep.sample.method != "saltelli":
        return
    columns = store.columns
    drawn_axes = sweep.drawn_axes
    axes = tuple(name for name in sweep.axes if name in drawn_axes)
    others = [name for name in (*columns.axis_names, "seed") if name not in drawn_axes]
    names = [name for name in metrics or summary_metrics() if name in columns.metric_columns]
    groups = defaultdict[tuple[object, ...], list[dict[str, object]]](list)
    for row in columns.read_arrow([*dict.fromkeys(["label", *others, *names])]).to_pylist():
        groups[tuple(row[name] for name in others)].append(row)
    base = sweep.sample.n
    for key, rows in [*groups.items()][:MOST_SENSITIVITIES]:
        shared = {n: v for n, v in zip(others, key, strict=True) if columns.varies(n)}
        # Equal runs, as of axes of whole numbers, are made once.
        if len(rows) != base * (len(axes) + 2):
            continue
        failed = [float(row["label"] != "stable") for row in rows]
        values = {FAILED: failed, **{name: [row[name] for row in rows] for name in names}}
        for name, metric_values in values.items():
            if None not in metric_values and len({*metric_values}) > 1:
                yield _measure_sensitivity(
                    name, shared, axes, np.array(metric_values, float).reshape(-1, base)
                )


def _measure_sensitivity(
    metric: str, shared: dict[str, object], axes: tuple[str, ...], values: Floats
) -> Sensitivity:
    """Return the sensitivity of values (2 + d, n) at the points A, B and A with a column of B."""
    # It takes a while to load.
    from scipy.stats import sobol_indices  # noqa: PLC0415

    samples = {"f_A": values[None, 0], "f_B": values[None, 1], "f_AB": values[2:, None]}
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)
        indices = sobol_indices(func=samples, n=values.shape[1], rng=0)
        resamples = 199
        again = indices.bootstrap(n_resamples=resamples)
    intervals = list[Floats]()
    for one, share in (
        (again.first_order, indices.first_order),
        (again.total_order, indices.total_order),
    ):
        ends = np.stack((one.confidence_interval.low, one.confidence_interval.high), axis=-1)
        # Resamples that are all equal have no interval but their value.
        intervals.append(np.where(np.isnan(ends), share[:, None], ends))
    return Sensitivity(
        metric, shared, axes, indices.first_order, intervals[0], indices.total_order, intervals[1]
    )


def sensitivity_lines(sensitivity: Sensitivity) -> Iterator[str]:
    """Yield a line for each axis, those that decide most first."""
    shared = ", ".join(f"{name} {value}" for name, value in sensitivity.shared.items())
    of = f"{sensitivity.metric} of {shared}" if shared else sensitivity.metric
    alone, total = (
        [
            f"{format_percent(share)} ({format_interval(low, high)})"
            for share, (low, high) in zip(*each, strict=True)
        ]
        for each in (
            (sensitivity.first.tolist(), sensitivity.first_interval.tolist()),
            (sensitivity.total.tolist(), sensitivity.total_interval.tolist()),
        )
    )
    for axis in np.argsort(-sensitivity.total).tolist():
        yield (
            f"{of}: {sensitivity.axes[axis]} alone explains {alone[axis]} of its variance, "
            f"{total[axis]} together with others"
        )


def budget_sentence(budget: ParameterBudget, store: Store) -> str:
    """Return the run of a budget in words, with its numerical error."""
    varying = [*budget.shared.items(), *budget.middle.items()]
    at = ", ".join(f"{n} {format_setting(v, 4)}" for n, v in varying if store.columns.varies(n))
    return f"error budget of the run at {at}: numerical error {_format_error(budget.run)}"


def budget_lines(store: Store) -> Iterator[str]:
    """Yield the errors of sampled axes, in the windows of the run in the middle of their ranges."""
    for budget in store.manifest.parameter_budgets:
        yield budget_sentence(budget, store)
        for row in by_share(budget):
            yield (
                f"  {row.axis} at {row.low:g} or {row.high:g}: {_format_error(row.share)}, "
                f"worst body {row.body}"
            )
        if others := axes_of_starts(budget):
            yield f"  without a row, as they change no number of the model: {', '.join(others)}"


def by_share(budget: ParameterBudget) -> list[ParameterRow]:
    """Return the rows of a budget, the largest first; without a share, the engine gave up."""
    return sorted(budget.rows, key=lambda row: -np.inf if row.share is None else -row.share)


def axes_of_starts(budget: ParameterBudget) -> list[str]:
    """Return the sampled axes that have no row, since they change no number of the model."""
    rows = {row.axis for row in budget.rows}
    return [name for name in budget.middle if name not in rows]


def _format_error(share: float | None) -> str:
    return "not measured, because the engine gave up" if share is None else format_percent(share)
