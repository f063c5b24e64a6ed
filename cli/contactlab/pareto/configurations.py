"""Configurations: the stored runs of each, and their comparison with the criteria."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.mjcf import OPTIONS
from contactlab.schema.evidence import Setting
from contactlab.schema.tradeoff_report import (
    REALITY,
    Configuration,
    ConfigurationOutcomes,
    ErrorMeasure,
    TimeMeasure,
)
from contactlab.schema.vocabulary import Role
from contactlab.shares import wilson_interval
from contactlab.store.finished_store import Store
from contactlab.store.run_columns import CodedColumn, RunColumns

STABLE = "stable"

# The column with the estimated uncertainty of the reference, by error.
ESTIMATES = {
    "error_final": "error_final_estimate",
    "error_mean": "error_mean_estimate",
    "error_peak": "error_estimate",
}
# Columns of the timing and accuracy passes that a trade-off reads.
PASS_COLUMNS = ("step_p99", "impacts", "chaotic", "solref_clamped", *ESTIMATES.values())
_SOLREF_RULE = "solref_rule"
Rows = NDArray[np.int64]
_Value = TypeVar("_Value", bound=np.generic)


@dataclass(frozen=True)
class StoredRuns:
    """The runs of a store, n of them."""

    knobs: Mapping[str, CodedColumn]  # the axes with the role knob
    scenarios: Mapping[str, CodedColumn]  # the axes with the role scenario
    seeds: CodedColumn
    labels: CodedColumn
    numbers: Mapping[str, Floats]  # column to (n,) values, in their units; NaN for missing ones
    # Whether solref is absolute or tied to the timestep; empty if unknown.
    solref_rules: tuple[str | None, ...] = ()
    baseline: int | None = None  # place of a run of the model as written, if there is one
    written_options: Mapping[str, Setting] | None = None  # option to its value in that run


def read_runs(store: Store, names: Iterable[str]) -> StoredRuns:
    """Read the runs of a store with some columns; a missing column is NaN."""
    columns, present = store.columns, store.columns.schema.names
    roles = store.reported_roles

    def of(kind: Role) -> dict[str, CodedColumn]:
        swept = [name for name in columns.axis_names if roles.get(name, "knob") == kind]
        return {name: _compact_codes(columns.read_codes(name)) for name in swept}

    first = store.manifest.sweep.baseline
    place = None if first is None else columns.place_of(first)
    written_options = None
    if place is not None:
        # Contact parameters may differ between the geoms of a run.
        settings = store.record(columns.run_id(place)).settings
        options = {name: settings[name] for name in OPTIONS if name in settings}
        written_options = {
            name: value for name, value in options.items() if not isinstance(value, tuple)
        }
    return StoredRuns(
        knobs=of("knob"),
        scenarios=of("scenario"),
        seeds=_compact_codes(columns.read_codes("seed")),
        labels=_compact_codes(columns.read_codes("label")),
        numbers=StoredNumbers(columns, names),
        solref_rules=columns.read_codes(_SOLREF_RULE).values if _SOLREF_RULE in present else (),
        baseline=place,
        written_options=written_options,
    )


def _compact_codes(column: CodedColumn) -> CodedColumn:
    return column._replace(codes=column.codes.astype(np.min_scalar_type(len(column.values))))


class StoredNumbers(Mapping[str, Floats]):
    """Some columns of a store, each read on request, since all of many runs fill memory."""

    def __init__(self, columns: RunColumns, names: Iterable[str]) -> None:
        self._columns, self._names = columns, dict.fromkeys(names)

    def __getitem__(self, name: str) -> Floats:
        if name not in self._names:
            raise KeyError(name)
        if name not in self._columns.schema.names:
            return np.broadcast_to(np.nan, self._columns.runs)
        return self._columns.numbers(name).values

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def is_chaotic(runs: StoredRuns) -> bool:
    """Return whether any run is known to diverge from a run with a perturbed start."""
    return bool((runs.numbers["chaotic"] > 0).any()) if "chaotic" in runs.numbers else False


@dataclass(frozen=True)
class GroupedRuns:
    """The n runs of c configurations, the model as written first, then in the order of the plan."""

    order: Rows  # (n,) the runs, configuration by configuration
    starts: Rows  # (c,) position in this order of the first run of each
    cases: Rows  # (c,) number of scenarios and seeds in the runs of each
    every: int  # number of scenarios and seeds in all runs

    @property
    def counts(self) -> Rows:
        """(c,) number of runs of each."""
        return np.diff(self.starts, append=len(self.order))

    def split_values(self, values: NDArray[_Value]) -> list[NDArray[_Value]]:
        """Return values (n,) by configuration, in the order of its runs."""
        return np.split(values, self.starts[1:])


def group_runs(runs: StoredRuns) -> GroupedRuns:
    """Return the runs of each configuration."""
    member = _combination_indices([*runs.knobs.values()], len(runs.seeds.codes))
    if runs.baseline is not None:
        now = member[runs.baseline]
        member = np.where(member == now, 0, member + (member < now))
    case = _combination_indices([*runs.scenarios.values(), runs.seeds], len(member))
    every = int(case.max()) + 1
    case += member * every
    case.sort()
    cases = np.bincount(case[np.diff(case, prepend=-1) > 0] // every)
    counts = np.bincount(member)
    # Small integers are sorted by their digits, in linear time.
    order = np.argsort(member.astype(np.min_scalar_type(len(counts))), kind="stable")
    return GroupedRuns(order, counts.cumsum() - counts, cases, every)


def _combination_indices(columns: Sequence[CodedColumn], count: int) -> Rows:
    """Return (n,) the index of each run's combination of values, in order of first occurrence."""
    keys, size = np.zeros(count, dtype=np.int64), 1
    most_keys = 1 << 62
    for codes, values in columns:
        if size * len(values) > most_keys:
            keys, size = np.unique(keys, return_inverse=True)[1], count
        keys, size = keys * len(values) + codes, size * len(values)
    if size > count:
        keys, size = np.unique(keys, return_inverse=True)[1], count
    first = np.full(size, count)
    # The last assignment of equal keys stays, so the reversed order keeps the first run.
    first[keys[::-1]] = np.arange(count)[::-1]
    return np.argsort(np.argsort(first))[keys]


@dataclass(frozen=True)
class ResolvedCriteria:
    """The columns for accuracy and cost, and the largest magnitude of tolerated metrics."""

    error: ErrorMeasure
    time: TimeMeasure
    tolerances: Mapping[str, float]


@dataclass(frozen=True)
class EvaluatedConfiguration:
    """One configuration."""

    summary: Configuration
    first: int  # the first of its runs in `StoredRuns`
    cases: int  # number of scenarios and seeds in its runs
    estimate: float  # uncertainty of the reference of its error, in the error's unit; 0 without one
    impacts: float  # largest number of impacts in any of its runs
    exceeded: tuple[str, ...]  # metrics that exceed their tolerance

    @property
    def values(self) -> dict[str, Setting]:
        """Knob to value."""
        return self.summary.configuration

    @property
    def failures(self) -> dict[str, int]:
        """Failed runs by label."""
        return _failed_labels(self.summary.outcomes.labels)


class _Figures(NamedTuple):
    """Measured values of the runs of one configuration; None if any run has no value."""

    labels: Mapping[str, int]
    good: int  # runs that are stable and within all tolerances
    worst: Mapping[str, float | None]  # metric with a tolerance to the value that it bounds
    times: Floats  # of the timed runs
    error: float | None
    error_spread: tuple[float, float] | None
    estimate: float
    solref_clamped: float | None
    step_p99: float | None
    impacts: float


def evaluate_configurations(
    runs: StoredRuns, criteria: ResolvedCriteria, groups: GroupedRuns
) -> list[EvaluatedConfiguration]:
    """Evaluate every configuration, the model as written first, then in the order of the plan.

    A configuration is feasible if it was run in every scenario and seed of any other, has no
    failure label in any of them, meets every tolerance in the worst of them, and was timed.
    """
    evaluated = list[EvaluatedConfiguration]()
    firsts, counts = groups.order[groups.starts].tolist(), groups.counts.tolist()
    each = zip(
        firsts,
        counts,
        groups.cases.tolist(),
        _measured_figures(runs, criteria, groups),
        strict=True,
    )
    for first, count, cases, figures in each:
        values = {name: settings[codes[first]] for name, (codes, settings) in runs.knobs.items()}
        if runs.written_options and not evaluated:
            for name, (codes, settings) in runs.knobs.items():
                # Settings that others also leave to the scene are the same there.
                if values[name] is None and (codes == settings.index(None)).sum() == count:
                    values[name] = runs.written_options.get(name)
        evaluated.append(_evaluate_one(values, first, figures, criteria, (cases, groups.every)))
    return evaluated


def _measured_figures(
    runs: StoredRuns, criteria: ResolvedCriteria, groups: GroupedRuns
) -> Iterator[_Figures]:
    """Yield the measured values of each configuration, one column of all runs after the other."""
    codes, names = runs.labels
    codes = codes[groups.order]
    labels_of = _label_counts(codes, names, groups)
    good = np.array([name == STABLE for name in names])[codes]
    worst: dict[str, list[float | None]] = {}
    for name, limit in criteria.tolerances.items():
        sizes = bounded_magnitudes(runs.numbers, groups.order, name)
        worst[name] = _criterion_sizes(name, sizes, groups)
        # A comparison with NaN is false, as required.
        good &= sizes <= limit
    times = groups.split_values(runs.numbers[criteria.time.name][groups.order])
    error = criteria.error
    sizes = bounded_magnitudes(runs.numbers, groups.order, error.name)
    is_estimated = error.kind == "discretization"
    none = [None] * len(groups.starts)
    estimates = _largest_values(runs, groups, ESTIMATES[error.name]) if is_estimated else none
    columns = zip(
        labels_of,
        np.add.reduceat(good, groups.starts, dtype=np.int64).tolist(),
        zip(*worst.values(), strict=True) if worst else ([()] * len(none)),
        (part[np.isfinite(part)] for part in times),
        _criterion_sizes(error.name, sizes, groups),
        map(_error_spread, groups.split_values(sizes)),
        (estimate or 0.0 for estimate in estimates),
        _largest_values(runs, groups, "solref_clamped"),
        _largest_values(runs, groups, "step_p99"),
        (impacts or 0.0 for impacts in _largest_values(runs, groups, "impacts")),
        strict=True,
    )
    for labels, number, sizes_of, *others in columns:
        yield _Figures(labels, number, dict(zip(worst, sizes_of, strict=True)), *others)


def _label_counts(
    codes: NDArray[np.integer], names: Sequence[str], groups: GroupedRuns
) -> list[dict[str, int]]:
    # Return the number of runs by label in each configuration, in the order of their first run.
    ends = np.append(groups.starts[1:], len(codes))
    counts = np.zeros((len(ends), len(names)), np.int64)
    first = np.full(counts.shape, len(codes))
    for code in range(len(names)):
        own = np.flatnonzero(codes == code)
        starts, stops = np.searchsorted(own, groups.starts), np.searchsorted(own, ends)
        is_there = stops > starts
        counts[:, code] = stops - starts
        first[is_there, code] = own[starts[is_there]]
    order: list[list[int]] = np.argsort(first, axis=1, kind="stable").tolist()
    return [
        {names[code]: numbers[code] for code in places if numbers[code]}
        for places, numbers in zip(order, counts.tolist(), strict=True)
    ]


def _evaluate_one(
    values: dict[str, Setting],
    first: int,
    figures: _Figures,
    criteria: ResolvedCriteria,
    ran: tuple[int, int],
) -> EvaluatedConfiguration:
    (cases, every), limits, worst = ran, criteria.tolerances, figures.worst
    runs = sum(figures.labels.values())
    exceeded = tuple(
        name for name, limit in limits.items() if (value := worst[name]) is None or value > limit
    )
    low, high = wilson_interval(figures.good, runs)
    times, size = figures.times, figures.error
    mean = float(np.mean(times)) if len(times) else None
    reasons = [
        *(f"{n} of {runs} runs are {name}" for name, n in _failed_labels(figures.labels).items()),
        *(_excess_text(name, worst[name], limits[name]) for name in exceeded),
        *([f"run in {cases} of {every} cases"] if cases < every else []),
        *([] if len(times) else ["not timed"]),
    ]
    summary = Configuration(
        configuration=values,
        time=mean,
        time_worst=float(np.max(times)) if len(times) else None,
        real_time_factor=1 / mean if mean else None,
        error=None if size is None else max(size, criteria.error.resolution),
        error_spread=figures.error_spread,
        below_estimate=size is not None and 0 < size <= figures.estimate,
        solref_clamped=(figures.solref_clamped or 0) > 0,
        step_p99=figures.step_p99,
        feasible=not reasons,
        reasons=tuple(reasons),
        worst=dict(worst),
        margins={name: _tolerance_margin(limit, worst[name]) for name, limit in limits.items()},
        outcomes=ConfigurationOutcomes(
            runs=runs, good=figures.good, low=low, high=high, labels=dict(figures.labels)
        ),
    )
    return EvaluatedConfiguration(
        summary, first, cases, figures.estimate, figures.impacts, exceeded
    )


def _failed_labels(labels: Mapping[str, int]) -> dict[str, int]:
    return {name: count for name, count in labels.items() if name != STABLE}


def _tolerance_margin(tolerance: float, worst: float | None) -> float | None:
    """Return the allowed growth factor of a value; None if the value is unknown, or zero."""
    ratio = tolerance / worst if worst else math.inf
    return ratio if math.isfinite(ratio) else None


def _largest_values(runs: StoredRuns, groups: GroupedRuns, name: str) -> list[float | None]:
    """Return the largest magnitude of a column in each configuration; None if any has no value."""
    if name not in runs.numbers:
        return [None] * len(groups.starts)
    return _largest_sizes(np.abs(runs.numbers[name][groups.order]), groups)


def _largest_sizes(sizes: Floats, groups: GroupedRuns) -> list[float | None]:
    most = np.maximum.reduceat(sizes, groups.starts)
    return [None if value != value else value for value in most.tolist()]  # noqa: PLR0124


def _criterion_sizes(name: str, sizes: Floats, groups: GroupedRuns) -> list[float | None]:
    """Return the size of a column that counts for each configuration; None if any is unknown."""
    most = _largest_sizes(sizes, groups)
    if name != REALITY:
        return most
    pairs = zip(most, groups.split_values(sizes), strict=True)
    return [None if value is None else float(part.mean()) for value, part in pairs]


def _error_spread(sizes: Floats) -> tuple[float, float] | None:
    own, middle = np.sort(sizes), len(sizes) // 2  # unknown sizes are last
    least, upper, lower, last = own[[0, middle, -1 - middle, -1]].tolist()
    return (least, (upper + lower) / 2) if len(own) > 1 and last == last else None  # noqa: PLR0124


def bounded_magnitudes(numbers: Mapping[str, Floats], rows: Rows, name: str) -> Floats:
    """Return the magnitude of a column in each run, as tolerances bound it; NaN without a value.

    An error against a reference is at least the uncertainty of the reference.
    """
    sizes = numbers[name][rows]
    np.abs(sizes, out=sizes)
    estimate = numbers.get(ESTIMATES.get(name, ""))
    if estimate is not None:
        np.maximum(sizes, np.nan_to_num(estimate[rows], copy=False), out=sizes)
    return sizes


def _excess_text(name: str, worst: float | None, tolerance: float) -> str:
    if worst is None:
        return f"{name} could not be measured in every run"
    return f"{name} reaches {worst:.3g} of {tolerance:.3g}"


def find_insensitive_knobs(evaluated: Sequence[EvaluatedConfiguration]) -> list[str]:
    """Return the knobs that alone change no error by more than 1 %, and no label."""
    has_errors = any(configuration.summary.error is not None for configuration in evaluated)
    names = list(evaluated[0].values) if has_errors else []
    return [name for name in names if _is_insensitive(evaluated, name)]


def fix_insensitive_knobs(
    evaluated: Sequence[EvaluatedConfiguration],
    insensitive: Sequence[str],
    chosen: EvaluatedConfiguration | None,
) -> list[EvaluatedConfiguration]:
    """Return the configurations with one value of each insensitive knob."""
    alike = (chosen or evaluated[0]).values
    return [
        configuration
        for configuration in evaluated
        if all(configuration.values[name] == alike[name] for name in insensitive)
    ]


def _is_insensitive(evaluated: Sequence[EvaluatedConfiguration], name: str) -> bool:
    alike: dict[tuple[Setting, ...], list[EvaluatedConfiguration]] = {}
    for configuration in evaluated:
        others = tuple(value for key, value in configuration.values.items() if key != name)
        alike.setdefault(others, []).append(configuration)
    compared = [group for group in alike.values() if len(group) > 1]
    return bool(compared) and all(_is_equal(group) for group in compared)


def _is_equal(evaluated: Sequence[EvaluatedConfiguration]) -> bool:
    errors = [configuration.summary.error for configuration in evaluated]
    known_errors = [error for error in errors if error is not None]
    idle_ratio = 1.01  # a knob counts as insensitive within this ratio of errors
    if known_errors and (
        len(known_errors) < len(errors) or max(known_errors) > idle_ratio * min(known_errors)
    ):
        return False
    return len({tuple(sorted(configuration.failures)) for configuration in evaluated}) == 1
