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
from contactlab.store.finished_store import Store

_Z = 1.959963984540054  # 97.5 % quantile of the normal distribution

_UNCHANGED = 1.01  # ratio of errors within which a knob counts as idle

_STABLE = "stable"

# Columns of the timing and accuracy passes that a trade-off reads, where they exist.
_PASS_COLUMNS = ("step_p99", "impacts")
# The column with the estimated uncertainty of the reference, by error.
ESTIMATES = {
    "error_final": "error_final_estimate",
    "error_mean": "error_mean_estimate",
    "error_peak": "error_estimate",
}
_FLAGS = ("chaotic", "solref_clamped")
_SOLREF_RULE = "solref_rule"
_FIXED = ("run_id", "seed", "label")


@dataclass(frozen=True)
class StoredRuns:
    """The runs of a store, n of them."""

    ids: list[str]
    knobs: Mapping[str, Sequence[Setting]]  # axis to its n values, of the axes with the role knob
    scenarios: Mapping[str, Sequence[Setting]]  # the same of the axes with the role scenario
    seeds: Sequence[int]
    labels: list[str]
    numbers: Mapping[str, Floats]  # column to (n,) values, in their units; NaN where there is none
    # Whether solref is absolute or tied to the timestep; empty if unknown.
    solref_rules: tuple[str, ...] = ()
    baseline: int | None = None  # a run of the model as written, if there is one, by its place
    written: Mapping[str, Setting] | None = None  # option to its value there


def read_runs(store: Store, names: Iterable[str]) -> StoredRuns:
    """Read the runs of a store, with these columns beside those that every trade-off needs."""
    columns = store.columns
    required = [*names]
    names = [*required, *_PASS_COLUMNS, *ESTIMATES.values(), *_FLAGS]
    present = columns.schema.names
    roles = Sweep.model_validate(store.manifest.sweep.resolved).roles
    values = columns.to_pydict(list(dict.fromkeys((*_FIXED, *columns.axis_names))))

    def of(kind: Role) -> dict[str, list[Setting]]:
        return {
            name: values[name] for name in columns.axis_names if roles.get(name, "knob") == kind
        }

    first = store.manifest.sweep.baseline or ""
    known = first in values["run_id"]
    return StoredRuns(
        ids=values["run_id"],
        knobs=of("knob"),
        scenarios=of("scenario"),
        seeds=values["seed"],
        labels=values["label"],
        numbers=dict.fromkeys(required, np.full(len(values["run_id"]), np.nan))
        | {name: columns.numbers(name).values for name in names if name in present},
        solref_rules=columns.strings(_SOLREF_RULE).categories if _SOLREF_RULE in present else (),
        baseline=values["run_id"].index(first) if known else None,
        written=_options_of(store.record(first)) if known else None,
    )


def _options_of(record: EvidenceRecord) -> dict[str, Setting]:
    """Return the options of a run; contact parameters may differ between its geoms."""
    options = {name: record.settings[name] for name in OPTIONS}
    return {name: value for name, value in options.items() if not isinstance(value, tuple)}


def is_chaotic(runs: StoredRuns) -> bool:
    """Say whether any run is known to diverge from a run with a perturbed start."""
    return bool((runs.numbers["chaotic"] > 0).any()) if "chaotic" in runs.numbers else False


def _rows(columns: Mapping[str, Sequence[Setting]], count: int) -> Iterable[tuple[Setting, ...]]:
    return zip(*columns.values(), strict=True) if columns else [()] * count


def wilson(good: int, runs: int) -> tuple[float, float]:
    """Return the 95 % interval of a rate, between 0 and 1.

    The score interval of E. B. Wilson, "Probable inference, the law of succession, and statistical
    inference", 1927: the rates p whose distance to the observed share is at most
    z sqrt(p (1 - p) / n).
    """
    share, weight = good / runs, _Z * _Z / runs
    centre = (share + weight / 2) / (1 + weight)
    reach = _Z * math.sqrt(share * (1 - share) / runs + weight / (4 * runs)) / (1 + weight)
    return max(0.0, centre - reach), min(1.0, centre + reach)


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
    rows: list[int]  # indices of its runs in `StoredRuns`
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
    keys = list(_rows(runs.knobs, len(runs.ids)))
    now = None if runs.baseline is None else keys[runs.baseline]
    members: dict[tuple[Setting, ...], list[int]] = {} if now is None else {now: []}
    for row, key in enumerate(keys):
        members.setdefault(key, []).append(row)
    cases = list(_rows({**runs.scenarios, "seed": runs.seeds}, len(runs.ids)))
    every = len(set(cases))
    found: list[Evaluated] = []
    for key, rows in members.items():
        values, own = dict(zip(runs.knobs, key, strict=True)), len({cases[row] for row in rows})
        if key == now and runs.written:
            # What others leave to the scene as well is the same there.
            empty = [name for name, each in runs.knobs.items() if each.count(None) == len(rows)]
            values |= {name: runs.written.get(name) for name in empty if values[name] is None}
        found.append(_evaluate_one(runs, values, rows, criteria, own, every))
    return found


def _evaluate_one(
    runs: StoredRuns,
    values: dict[str, Setting],
    rows: list[int],
    criteria: ResolvedCriteria,
    cases: int,
    every: int,
) -> Evaluated:
    labels = Counter(runs.labels[row] for row in rows)
    limits, error = criteria.tolerances, criteria.error
    sizes = {name: magnitudes(runs, rows, name) for name in limits}
    worst = {name: _size(name, each) for name, each in sizes.items()}
    exceeded = tuple(
        name for name, limit in limits.items() if (value := worst[name]) is None or value > limit
    )
    stable = np.array([runs.labels[row] == _STABLE for row in rows])
    # A comparison with NaN is false, as it should be.
    good = np.logical_and.reduce([stable, *(sizes[name] <= each for name, each in limits.items())])
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
    size = _size(error.name, magnitudes(runs, rows, error.name))
    summary = Configuration(
        configuration=values,
        time=mean,
        time_worst=float(np.max(time)) if len(time) else None,
        real_time_factor=1 / mean if mean else None,
        error=None if size is None else max(size, error.resolution),
        error_spread=_spread(magnitudes(runs, rows, error.name)),
        below_estimate=size is not None and 0 < size <= estimate,
        solref_clamped=(_largest(runs, rows, "solref_clamped") or 0) > 0,
        step_p99=_largest(runs, rows, "step_p99"),
        feasible=not reasons,
        reasons=tuple(reasons),
        worst=worst,
        margins={name: _margin(limit, worst[name]) for name, limit in limits.items()},
        outcomes=ConfigurationOutcomes(
            runs=len(rows), good=int(good.sum()), low=low, high=high, labels=dict(labels)
        ),
    )
    impacts = _largest(runs, rows, "impacts") or 0.0
    return Evaluated(summary, rows, cases, estimate, impacts, exceeded)


def _failures(labels: Mapping[str, int]) -> dict[str, int]:
    return {name: count for name, count in labels.items() if name != _STABLE}


def _margin(tolerance: float, worst: float | None) -> float | None:
    """Return by what factor a value could grow; None if the value is unknown, or zero."""
    ratio = tolerance / worst if worst else math.inf
    return ratio if math.isfinite(ratio) else None


def _largest(runs: StoredRuns, rows: list[int], name: str) -> float | None:
    """Return the largest magnitude of a column over some runs; None if any has no value."""
    return _most(np.abs(runs.numbers[name][rows])) if name in runs.numbers else None


def _most(sizes: Floats) -> float | None:
    return None if np.isnan(sizes).any() else float(sizes.max())


def _size(name: str, sizes: Floats) -> float | None:
    """Return what counts of the sizes of a column; None if any is unknown."""
    most = _most(sizes)
    return most if most is None or name != REALITY else float(sizes.mean())


def _spread(sizes: Floats) -> tuple[float, float] | None:
    known = len(sizes) > 1 and not np.isnan(sizes).any()
    return (float(sizes.min()), float(np.median(sizes))) if known else None


def magnitudes(runs: StoredRuns, rows: Sequence[int] | NDArray[np.integer], name: str) -> Floats:
    """Return the magnitude of a column in each run, as tolerances bound it; NaN without a value.

    An error against a reference is at least the uncertainty of the reference.
    """
    sizes = np.abs(runs.numbers[name][rows])
    estimate = ESTIMATES.get(name)
    if estimate is None or estimate not in runs.numbers:
        return sizes
    return np.maximum(sizes, np.nan_to_num(runs.numbers[estimate][rows]))


def _excess(name: str, worst: float | None, tolerance: float) -> str:
    if worst is None:
        return f"{name} could not be measured in every run"
    return f"{name} reaches {worst:.3g} of {tolerance:.3g}"


def idle_knobs(evaluated: Sequence[Evaluated]) -> list[str]:
    """Return the knobs that change no error by more than 1 %, and no label, all else equal."""
    known = any(each.summary.error is not None for each in evaluated)
    names = list(evaluated[0].values) if known else []
    return [name for name in names if _is_idle(evaluated, name)]


def with_one_idle_value(
    evaluated: Sequence[Evaluated], idle: Sequence[str], chosen: Evaluated | None
) -> list[Evaluated]:
    """Return the configurations with one value of each idle knob: the chosen's, or the first."""
    alike = (chosen or evaluated[0]).values
    return [each for each in evaluated if all(each.values[name] == alike[name] for name in idle)]


def _is_idle(evaluated: Sequence[Evaluated], name: str) -> bool:
    alike: dict[tuple[Setting, ...], list[Evaluated]] = {}
    for each in evaluated:
        others = tuple(value for key, value in each.values.items() if key != name)
        alike.setdefault(others, []).append(each)
    compared = [each for each in alike.values() if len(each) > 1]
    return bool(compared) and all(_is_equal(each) for each in compared)


def _is_equal(evaluated: Sequence[Evaluated]) -> bool:
    errors = [each.summary.error for each in evaluated]
    known = [error for error in errors if error is not None]
    if known and (len(known) < len(errors) or max(known) > _UNCHANGED * min(known)):
        return False
    return len({tuple(sorted(each.failures)) for each in evaluated}) == 1
