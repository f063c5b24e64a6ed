"""Chooses the columns of a store for accuracy and cost, and their tolerances."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from contactlab.errors import StoreError, SweepFileError
from contactlab.schema.evidence import ERRORS
from contactlab.schema.tradeoff_report import REALITY, ErrorMeasure, TimeMeasure
from contactlab.store.finished_store import Store
from contactlab.store.store_files import Address, parse_address

MODELING_ERROR = "oracle_error"
TIMED_COLUMN = "time_median"
RECORDED_TIME_COLUMN = "cost_cpu_per_sim_s"


@dataclass(frozen=True)
class Criteria:
    """Criteria for a sufficiently accurate configuration."""

    # The metric of accuracy; None to take the first error that has a tolerance.
    metric: str | None = None
    # Metric to largest magnitude, over those of the sweep.
    tolerances: Mapping[str, float] = field(default_factory=dict[str, float])


def find_store(source: str, target: Address | None = None) -> Address | None:
    """Return the store that a text names; None for a sweep; only a sweep may have a target."""
    address = parse_address(source)
    is_folder = isinstance(address, Path) and address.is_dir()
    if isinstance(address, Path) and not is_folder:
        return None
    if target is not None:
        kind = "folder" if is_folder else "store"
        raise SweepFileError(f"{address} is a {kind}; -o is the store of a sweep")
    return address


def tolerances_of(store: Store, criteria: Criteria) -> dict[str, float]:
    """Return tolerances of sweep and criteria; a SweepFileError for a column without numbers."""
    sweep = store.sweep
    tolerances = {**sweep.tolerances, **criteria.tolerances}
    for name in tolerances:
        _check_number(store, name)
    return tolerances


def error_measure(
    store: Store, criteria: Criteria, tolerances: Mapping[str, float]
) -> ErrorMeasure:
    """Return the error of the criteria, or the first with a tolerance, or the first measured.

    Raises a SweepFileError if the store has no such column; a StoreError if no run has a value of
    it, or of any error, although not every run failed.
    """
    if criteria.metric is not None:
        _check_number(store, criteria.metric)
    name = criteria.metric or find_error_metric(tolerances)
    if name is None:
        candidates = (ERRORS[0], MODELING_ERROR, REALITY, *tolerances)
        other = ERRORS[0] if _all_failed(store) else None
        name = next((each for each in candidates if _is_measured(store, each)), other)
    if name is None:
        raise StoreError(
            f"{store.address} has neither an error nor a tolerated metric; sweep with "
            "`accuracy: {error: auto}`, or name a metric with --metric"
        )
    if not _is_measured(store, name) and not _all_failed(store):
        hint = "; sweep with `accuracy: {error: auto}`" if name in ERRORS else ""
        raise StoreError(f"no run in {store.address} has a value of {name}{hint}")
    described = store.columns.described.get(name)
    # All runs of a sweep have the same kind of error.
    kinds = store.columns.read_codes("error_kind").values if name in ERRORS else ()
    accuracy = store.sweep.accuracy
    modeling = "modeling" if name == MODELING_ERROR else "metric"
    return ErrorMeasure(
        name=name,
        unit=described.unit if described else "",
        kind="discretization" if name in ERRORS else modeling,
        against=next(filter(None, kinds), None),
        reference=accuracy.against if name in ERRORS and accuracy else "own",
        resolution=described.resolution if described else 0.0,
    )


def find_error_metric(names: Sequence[str] | Mapping[str, float]) -> str | None:
    """Return the first of these names that is an error against a reference."""
    return next((name for name in names if name in {*ERRORS, MODELING_ERROR, REALITY}), None)


def time_measure(store: Store) -> TimeMeasure:
    """Return the time of the timing pass or, without one, of the recorded runs."""
    if not _is_measured(store, TIMED_COLUMN):
        return TimeMeasure(name=RECORDED_TIME_COLUMN, source="recording", spread=None)
    middle, least = (store.columns.numbers(name).values for name in (TIMED_COLUMN, "time_min"))
    # One round has no spread.
    is_timed = np.isfinite(middle) & (least > 0) & (middle > least)
    spread = float(np.median(middle[is_timed] / least[is_timed] - 1)) if is_timed.any() else None
    return TimeMeasure(name=TIMED_COLUMN, source="timing", spread=spread)


def _all_failed(store: Store) -> bool:
    """Return whether no run was stable, so that there may be nothing to measure."""
    return "stable" not in store.columns.read_codes("label").values


def _check_number(store: Store, name: str) -> None:
    number_columns = [
        column for column in store.columns.schema.names if store.columns.is_number(column)
    ]
    message = f"no number '{name}' in the table of {store.address}"
    SweepFileError.unless_known(
        name, number_columns, message, rest="\nsee `contactlab list metrics`"
    )


def _is_measured(store: Store, name: str) -> bool:
    columns = store.columns
    return name in columns.schema.names and columns.has_any(name)
