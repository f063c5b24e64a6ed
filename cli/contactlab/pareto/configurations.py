"""Configurations: the stored runs of each, and how they compare with the criteria."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.mjcf import OPTIONS
from contactlab.schema.evidence import EvidenceRecord, Setting
from contactlab.schema.sweep_schema import Sweep
from contactlab.schema.tradeoff_report import (
    REALITY,
    Configuration,
    ConfigurationOutcomes,
    ErrorMeasure,
    TimeMeasure,
)
from contactlab.schema.vocabulary import Role
from contactlab.shares import wilson
from contactlab.store.finished_store import Store
from contactlab.store.run_columns import CodedColumn

_UNCHANGED = 1.01  # ratio of errors within which a knob counts as idle

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
_MOST_KEYS = 1 << 62
Rows = NDArray[np.int64]


@dataclass(frozen=True)
class StoredRuns:
    """The runs of a store, n of them."""

    knobs: Mapping[str, CodedColumn]  # the axes with the role knob
    scenarios: Mapping[str, CodedColumn]  # the axes with the role scenario
    seeds: CodedColumn
    labels: CodedColumn
    numbers: Mapping[str, Floats]  # column to (n,) values, in their units; NaN where there is none
    # Whether solref is absolute or tied to the timestep; empty if unknown.
    solref_rules: tuple[str | None, ...] = ()
    baseline: int | None = None  # a run of the model as written, if there is one, by its place
    written: Mapping[str, Setting] | None = None  # option to its value there


def read_runs(store: Store, names: Iterable[str]) -> StoredRuns:
    """Read the runs of a store with some columns, NaN where the store does not have one."""
    columns, present = store.columns, store.columns.schema.names
    roles = Sweep.model_validate(store.manifest.sweep.resolved).roles

    def of(kind: Role) -> dict[str, CodedColumn]:
        swept = [name for name in columns.axis_names if roles.get(name, "knob") == kind]
        return {name: columns.coded(name) for name in swept}

    first = store.manifest.sweep.baseline
    place = None if first is None else columns.place_of(first)
    return StoredRuns(
        knobs=of("knob"),
        scenarios=of("scenario"),
        seeds=columns.coded("seed"),
        labels=columns.coded("label"),
        numbers={
            name: columns.numbers(name).values
            if name in present
            else np.broadcast_to(np.nan, columns.runs)
            for name in names
        },
        solref_rules=columns.coded(_SOLREF_RULE).values if _SOLREF_RULE in present else (),
        baseline=place,
        written=None if place is None else _options_of(store.record(columns.run_id(place))),
    )


def _options_of(record: EvidenceRecord) -> dict[str, Setting]:
    """Return the options of a run; contact parameters may differ between its geoms."""
    options = {name: record.settings[name] for name in OPTIONS}
    return {name: value for name, value in options.items() if not isinstance(value, tuple)}


def is_chaotic(runs: StoredRuns) -> bool:
    """Say whether any run is known to diverge from a run with a perturbed start."""
    return bool((runs.numbers["chaotic"] > 0).any()) if "chaotic" in runs.numbers else False


@dataclass(frozen=True)
class GroupedRuns:
    """The runs of c configurations, the model as written first, then in the order of the plan."""

    rows: list[Rows]  # the runs of each
    cases: Rows  # (c,) in how many scenarios and seeds each was run
    every: int  # in how many any of them was


def group_runs(runs: StoredRuns) -> GroupedRuns:
    """Return the runs of each configuration."""
    member = _combinations([*runs.knobs.values()], len(runs.seeds.codes))
    if runs.baseline is not None:
        now = member[runs.baseline]
        member = np.where(member == now, 0, member + (member < now))
    case = _combinations([*runs.scenarios.values(), runs.seeds], len(member))
    every = int(case.max()) + 1
    pairs = np.sort(member * every + case)
    cases = np.bincount(pairs[np.diff(pairs, prepend=-1) > 0] // every)
    ends = np.bincount(member).cumsum()
    return GroupedRuns(np.split(np.argsort(member, kind="stable"), ends[:-1]), cases, every)


def _combinations(columns: Sequence[CodedColumn], count: int) -> Rows:
    """Return (n,) which combination of values each run has, counted as they first occur."""
    keys, size = np.zeros(count, dtype=np.int64), 1
    for codes, values in columns:
        if size * len(values) > _MOST_KEYS:
            keys, size = np.unique(keys, return_inverse=True)[1], count
        keys, size = keys * len(values) + codes, size * len(values)
    _, first, keys = np.unique(keys, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[keys]


@dataclass(frozen=True)
class ResolvedCriteria:
    """The columns for accuracy and cost, and the largest magnitude of tolerated metrics."""

    error: ErrorMeasure
    time: TimeMeasure
    tolerances: Mapping[str, float]


@dataclass(frozen=True)
class Evaluated:
    """One configuration."""

    summary: Configuration
    rows: Rows  # indices of its runs in `StoredRuns`
    cases: int  # in how many scenarios and seeds it was run
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
        return _failures(self.summary.outcomes.labels)


def evaluate(runs: StoredRuns, criteria: ResolvedCriteria) -> list[Evaluated]:
    """Evaluate every configuration, the model as written first, then in the order of the plan.

    A configuration is feasible if it was run in every scenario and seed that any other was run in,
    has no failure label in any of them, meets every tolerance in the worst of them, and was timed.
    """
    groups, found = group_runs(runs), list[Evaluated]()
    for rows, cases in zip(groups.rows, groups.cases.tolist(), strict=True):
        values = {name: settings[codes[rows[0]]] for name, (codes, settings) in runs.knobs.items()}
        if runs.written and not found:
            for name, (codes, settings) in runs.knobs.items():
                # What others leave to the scene as well is the same there.
                if values[name] is None and (codes == settings.index(None)).sum() == len(rows):
                    values[name] = runs.written.get(name)
        found.append(_evaluate_one(runs, values, rows, criteria, (cases, groups.every)))
    return found


def _evaluate_one(
    runs: StoredRuns,
    values: dict[str, Setting],
    rows: Rows,
    criteria: ResolvedCriteria,
    ran: tuple[int, int],
) -> Evaluated:
    (cases, every), (codes, names) = ran, runs.labels
    outcomes = codes[rows].tolist()
    labels = {names[code]: count for code, count in Counter(outcomes).items()}
    limits, error = criteria.tolerances, criteria.error
    sizes = {name: magnitudes(runs.numbers, rows, name) for name in limits}
    worst = {name: _size(name, amounts) for name, amounts in sizes.items()}
    exceeded = tuple(
        name for name, limit in limits.items() if (value := worst[name]) is None or value > limit
    )
    stable = np.array([names[code] == STABLE for code in outcomes])
    # A comparison with NaN is false, as it should be.
    good = np.logical_and.reduce(
        [stable, *(sizes[name] <= limit for name, limit in limits.items())]
    )
    low, high = wilson(int(good.sum()), len(rows))
    time = runs.numbers[criteria.time.name][rows]
    time = time[np.isfinite(time)]
    mean = float(np.mean(time)) if len(time) else None
    reasons = [
        *(f"{n} of {len(rows)} runs are {name}" for name, n in _failures(labels).items()),
        *(_excess(name, worst[name], limits[name]) for name in exceeded),
        *([f"run in {cases} of {every} cases"] if cases < every else []),
        *([] if len(time) else ["not timed"]),
    ]
    is_estimated = error.kind == "discretisation"
    estimate = (_largest(runs, rows, ESTIMATES[error.name]) or 0.0) if is_estimated else 0.0
    errors = magnitudes(runs.numbers, rows, error.name)
    size = _size(error.name, errors)
    summary = Configuration(
        configuration=values,
        time=mean,
        time_worst=float(np.max(time)) if len(time) else None,
        real_time_factor=1 / mean if mean else None,
        error=None if size is None else max(size, error.resolution),
        error_spread=_spread(errors),
        below_estimate=size is not None and 0 < size <= estimate,
        solref_clamped=(_largest(runs, rows, "solref_clamped") or 0) > 0,
        step_p99=_largest(runs, rows, "step_p99"),
        feasible=not reasons,
        reasons=tuple(reasons),
        worst=worst,
        margins={name: _margin(limit, worst[name]) for name, limit in limits.items()},
        outcomes=ConfigurationOutcomes(
            runs=len(rows), good=int(good.sum()), low=low, high=high, labels=labels
        ),
    )
    impacts = _largest(runs, rows, "impacts") or 0.0
    return Evaluated(summary, rows, cases, estimate, impacts, exceeded)


def _failures(labels: Mapping[str, int]) -> dict[str, int]:
    return {name: count for name, count in labels.items() if name != STABLE}


def _margin(tolerance: float, worst: float | None) -> float | None:
    """Return by what factor a value could grow; None if the value is unknown, or zero."""
    ratio = tolerance / worst if worst else math.inf
    return ratio if math.isfinite(ratio) else None


def _largest(runs: StoredRuns, rows: Rows, name: str) -> float | None:
    """Return the largest magnitude of a column over some runs; None if any has no value."""
    return _most(np.abs(runs.numbers[name][rows])) if name in runs.numbers else None


def _most(sizes: Floats) -> float | None:
    return None if np.isnan(sizes).any() else float(sizes.max())


def _size(name: str, sizes: Floats) -> float | None:
    """Return what counts of the sizes of a column; None if any is unknown."""
    most = _most(sizes)
    return most if most is None or name != REALITY else float(sizes.mean())


def _spread(sizes: Floats) -> tuple[float, float] | None:
    own = np.sort(sizes).tolist()  # what is unknown is last
    known, middle = len(own) > 1 and own[-1] == own[-1], len(own) // 2
    return (own[0], (own[middle] + own[-1 - middle]) / 2) if known else None


def magnitudes(numbers: Mapping[str, Floats], rows: Rows, name: str) -> Floats:
    """Return the magnitude of a column in each run, as tolerances bound it; NaN without a value.

    An error against a reference is at least the uncertainty of the reference.
    """
    sizes, estimate = np.abs(numbers[name][rows]), numbers.get(ESTIMATES.get(name, ""))
    return sizes if estimate is None else np.maximum(sizes, np.nan_to_num(estimate[rows]))


def _excess(name: str, worst: float | None, tolerance: float) -> str:
    if worst is None:
        return f"{name} could not be measured in every run"
    return f"{name} reaches {worst:.3g} of {tolerance:.3g}"


def idle_knobs(evaluated: Sequence[Evaluated]) -> list[str]:
    """Return the knobs that change no error by more than 1 %, and no label, all else equal."""
    known = any(configuration.summary.error is not None for configuration in evaluated)
    names = list(evaluated[0].values) if known else []
    return [name for name in names if _is_idle(evaluated, name)]


def with_one_idle_value(
    evaluated: Sequence[Evaluated], idle: Sequence[str], chosen: Evaluated | None
) -> list[Evaluated]:
    """Return the configurations with one value of each idle knob: the chosen's, or the first."""
    alike = (chosen or evaluated[0]).values
    return [
        configuration
        for configuration in evaluated
        if all(configuration.values[name] == alike[name] for name in idle)
    ]


def _is_idle(evaluated: Sequence[Evaluated], name: str) -> bool:
    alike: dict[tuple[Setting, ...], list[Evaluated]] = {}
    for configuration in evaluated:
        others = tuple(value for key, value in configuration.values.items() if key != name)
        alike.setdefault(others, []).append(configuration)
    compared = [group for group in alike.values() if len(group) > 1]
    return bool(compared) and all(_is_equal(group) for group in compared)


def _is_equal(evaluated: Sequence[Evaluated]) -> bool:
    errors = [configuration.summary.error for configuration in evaluated]
    known = [error for error in errors if error is not None]
    if known and (len(known) < len(errors) or max(known) > _UNCHANGED * min(known)):
        return False
    return len({tuple(sorted(configuration.failures)) for configuration in evaluated}) == 1
