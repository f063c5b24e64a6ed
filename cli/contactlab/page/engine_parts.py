"""Engines side by side: the cost of their runs, their differences, and a report of parity."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import ValidationError

from contactlab.comparison.pairing import round_values
from contactlab.errors import StoreError
from contactlab.rendering.amounts import format_percent
from contactlab.reporting.report import ReportData
from contactlab.reporting.report_columns import Codes
from contactlab.studies.parity.parity_report import ParityReport

_AXIS, _REFERENCE = "engine", "mujoco"
_PENETRATION = "penetration_mean"
GATE = 0.05
"""Tolerances of the practice before anything is scaled."""


class EngineCost(NamedTuple):
    """One engine's runs: how many, of them stable, and the median cost of a simulated second."""

    name: str
    version: str
    runs: int
    stable: int
    cost: float  # CPU s; NaN if no engine reports it
    ratio: float  # over that of the reference


class GateRow(NamedTuple):
    """One quantity in paired runs by MuJoCo and by an engine; differences as shares."""

    engine: str
    quantity: str
    pairs: int
    ours: float  # means
    theirs: float
    mean: float
    worst: float
    verdict: str


@dataclass(frozen=True)
class EngineParts:
    """Parts of a page about engines; the report of parity is optional."""

    costs: Sequence[EngineCost]
    gate: Sequence[GateRow]
    parity: ParityReport | None


def engine_parts(data: ReportData, parity: Path | None) -> EngineParts | None:
    """Return the parts on the engines of a store; None for one engine without a report."""
    report = _read_parity(parity, data) if parity else None
    # The rows of each engine's runs, MuJoCo's first.
    names = data.store.columns.read_codes("engine_name")
    if report is None and len(names.values) < 2:
        return None
    engine_runs = {
        name: np.flatnonzero(names.codes == code) for code, name in enumerate(names.values)
    }
    codes: dict[str, Codes] = {
        engine: engine_runs[engine]
        for engine in sorted(engine_runs, key=lambda name: name != _REFERENCE)
    }
    gate = _gate_of_report(report) if report else _gate_of_store(data, codes)
    engine_costs = list[EngineCost]()
    columns, failed = data.store.columns, data.labels.failed
    versions, seconds = (
        columns.read_codes("engine_version"),
        columns.numbers("cost_cpu_per_sim_s")[0],
    )
    first = math.nan
    for engine_name, own_rows in codes.items():
        costs = seconds[own_rows][np.isfinite(seconds[own_rows])]
        cost = float(np.median(costs)) if len(costs) else math.nan
        first = cost if math.isnan(first) else first
        version = versions.values[versions.codes[own_rows[0]]]
        stable = len(own_rows) - int(failed[own_rows].sum())
        engine_costs.append(
            EngineCost(engine_name, version, len(own_rows), stable, cost, cost / first)
        )
    return EngineParts(engine_costs, list(gate), report)


def _read_parity(path: Path, data: ReportData) -> ParityReport:
    """Return a report of parity; a StoreError says that it is not one, or of another scene."""
    try:
        report = ParityReport.model_validate_json(path.read_bytes())
    except OSError as error:
        raise StoreError(f"cannot read {path}: {error.strerror}") from error
    except ValidationError as error:
        write = "contactlab parity SWEEP --against ENGINE --format json"
        raise StoreError(f"{path} is not a parity report; write one: {write}") from error
    scene = data.store.manifest.sweep.scene
    if report.scene != scene:
        raise StoreError(f"{path} is of {report.scene}, the store of {scene}")
    return report


def _gate_of_store(data: ReportData, rows: dict[str, Codes]) -> Iterator[GateRow]:
    """Yield the differences of paired runs, without floors for the effect of rounding."""
    # Runs that differ in their engines alone have equal keys.
    keys = np.zeros(data.store.columns.runs, np.int64)
    axes = [axis for axis in data.axes if axis.name != _AXIS]
    columns = [axis.codes if axis.numbers is None else round_values(axis.numbers) for axis in axes]
    for column in (*columns, data.store.columns.numbers("seed")[0]):
        codes = np.unique(column, return_inverse=True)[1]
        keys = np.unique(keys * (codes.max() + 1) + codes, return_inverse=True)[1]

    reference, *others = rows.items()
    quantities = {"success": (~data.labels.failed).astype(float)}
    quantities |= {
        quantity.name: quantity.values for quantity in data.quantities_named(_PENETRATION)
    }
    for name, own in others:
        _, ours, theirs = np.intersect1d(keys[reference[1]], keys[own], return_indices=True)
        for quantity, values in quantities.items():
            one, other = values[reference[1][ours]], values[own[theirs]]
            both_finite = np.isfinite(one) & np.isfinite(other)
            if not both_finite.any():
                continue
            one, other = one[both_finite], other[both_finite]
            scale, change = np.abs(one), np.abs(other - one)
            if quantity == "success":
                scale = np.ones_like(one)
            out = np.where(change > 0, np.inf, 0.0)
            shares = np.divide(change, scale, out=out, where=scale > 0)
            mean, worst = float(shares.mean()), float(shares.max())
            verdict = (
                "within" if worst <= GATE else "worst run beyond" if mean <= GATE else "beyond"
            )
            means = float(one.mean()), float(other.mean())
            yield GateRow(name, quantity, len(one), *means, mean, worst, verdict)


def _gate_of_report(report: ParityReport) -> Iterator[GateRow]:
    """Yield the judged quantities of a report: its checks name those beyond their tolerance."""
    failed = {check.name for check in report.findings if check.outcome == "failed"}
    for name in dict.fromkeys(name for run in report.runs for name in run.measured):
        readings = [run.measured[name] for run in report.runs if name in run.measured]
        ours, theirs, shares = (
            np.array([math.nan if value is None else value for value in values])
            for values in zip(
                *[(reading.mujoco, reading.engine, reading.difference) for reading in readings],
                strict=True,
            )
        )
        both_finite = np.isfinite(ours) & np.isfinite(theirs)
        if both_finite.any():
            beyond = [of for of in ("on average", "of each run") if f"{name} {of}" in failed]
            verdict = f"beyond {' and '.join(beyond)}" if beyond else "within"
            shares = np.where(np.isnan(shares), np.inf, shares)[both_finite]
            means = float(ours[both_finite].mean()), float(theirs[both_finite].mean())
            far = float(shares.mean()), float(shares.max())
            yield GateRow(report.engine, name, int(both_finite.sum()), *means, *far, verdict)


def engines_sentence(parts: EngineParts) -> str:
    """Return the conclusion of the engines' runs."""
    if parts.parity:
        return f"{parts.parity.headline}."
    off = [metric for metric in parts.gate if metric.verdict != "within"]
    pairs = max((metric.pairs for metric in parts.gate), default=0)
    if not pairs:
        return "No two runs differ in their engine alone."
    if not off:
        return f"{pairs:,} pairs of runs agree within {format_percent(GATE)}."
    most = max(off, key=lambda metric: metric.mean)
    return (
        f"Of {pairs:,} pairs of runs, {most.quantity} differs by {format_percent(most.mean)} on "
        f"average with {most.engine}, by {format_percent(most.worst)} at worst."
    )
