"""Sentences about parts of a page, each borne out by the numbers shown."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.pareto.recommendation import setting_text
from contactlab.reporting.report import ReportData
from contactlab.reporting.report_columns import (
    GridAxis,
    Quantity,
    combination_codes,
    number_with_unit,
)
from contactlab.reporting.start_noise import (
    PERTURBATION,
    code_alike_runs,
    noise_floor,
    start_noise,
)
from contactlab.schema.evidence import Setting
from contactlab.schema.tradeoff_report import TradeoffReport


def tradeoff_sentence(report: TradeoffReport) -> str:
    """Return how many configurations will do, and what the recommended one saves."""
    every, chosen = report.configurations, report.recommendation
    feasible = [configuration for configuration in every if configuration.feasible]
    are = "configuration is" if len(every) == 1 else "configurations are"
    sentence = f"{len(feasible):,} of {len(every):,} {are} within every tolerance"
    if chosen is None:
        return f"{sentence}; none can be recommended."
    what = _settings_in_words(chosen.configuration, report)
    timed_configurations = [
        configuration
        for configuration in feasible
        if configuration.error is not None and configuration.time
    ]
    finest = min(
        timed_configurations, key=lambda configuration: configuration.error or 0.0, default=None
    )
    if finest is None or finest.configuration == chosen.configuration or not chosen.time:
        return f"{sentence}; the recommended {what} is the most accurate of them."
    ratio = (finest.time or 0.0) / chosen.time
    other = _settings_in_words(finest.configuration, report)
    pace = f"takes {ratio:.3g} times as long as the recommended {what}"
    return f"{sentence}; the most accurate, {other}, {pace}."


def _settings_in_words(values: Mapping[str, Setting], report: TradeoffReport) -> str:
    phrases = [
        f"{name} {setting_text(values[name], report.units.get(name, ''))}"
        for name in report.varying
    ]
    return " with ".join(phrases) or "the only one"


class ComparedSettings(NamedTuple):
    """Runs of the same knobs that were compared with recordings, by rows; the closest first."""

    rows: NDArray[np.int64]
    distance: float  # its mean
    name: str  # the knobs by which settings can be told apart


def compared_settings(data: ReportData) -> list[ComparedSettings]:
    """Return the settings of a store whose runs were compared with recordings."""
    [reality] = data.quantities_named("reality")
    measured_rows = np.flatnonzero(np.isfinite(reality.values))
    knobs = _list_varying_knobs(data)
    groups = combination_codes(knobs, len(reality.values))[measured_rows]
    several = len(np.unique(groups))
    enough = next(
        ([axis] for axis in knobs if len(np.unique(axis.codes[measured_rows])) == several), knobs
    )
    order = np.argsort(groups, kind="stable")
    ends = np.flatnonzero(np.diff(groups[order])) + 1
    compared: list[ComparedSettings] = []
    for rows in np.split(measured_rows[order], ends) if several else []:
        name = " with ".join(f"{axis.name} {axis.ticks[axis.codes[rows[0]]]}" for axis in enough)
        compared.append(ComparedSettings(rows, float(reality.values[rows].mean()), name))
    return sorted(compared, key=lambda settings: settings.distance)


def _list_varying_knobs(data: ReportData) -> list[GridAxis]:
    """Return the knobs that vary, each with all its values."""
    knobs = [axis for axis in data.axes if axis.role == "knob" and axis.name != PERTURBATION]
    return [
        axis if axis.numbers is None else _numbers_of_bins(axis, axis.numbers) for axis in knobs
    ]


def _numbers_of_bins(axis: GridAxis, numbers: Floats) -> GridAxis:
    values, codes = np.unique(numbers, return_inverse=True)
    return replace(axis, ticks=tuple(f"{value:.6g}" for value in values), codes=codes, numbers=None)


def reality_sentence(data: ReportData) -> str:
    """Return which setting is closest to the recordings on average, and how far off others are."""
    [reality] = data.quantities_named("reality")
    compared = compared_settings(data)
    first, last = compared[0], compared[-1]
    runs = len(first.rows)
    over = f"on average over {runs:,} runs" if runs > 1 else "from its recording"
    away = f"{_distance_in_words(first.distance, reality)} away {over}"
    floor = start_noise(data.axes, reality.values)
    moved = _distance_in_words(floor or 0.0, reality)
    noise = f" Noise of the start alone moves a run by {moved} on average." if floor else ""
    if len(compared) == 1:
        return f"Simulation is {away}.{noise}"
    return (
        f"Of {len(compared):,} settings, {first.name} is closest to reality: {away}; "
        f"{last.name} is farthest, {_distance_in_words(last.distance, reality)}.{noise}"
    )


def _distance_in_words(value: float, reality: Quantity) -> str:
    return number_with_unit(f"{value:.3g}", reality.column.unit)


def closest_settings(data: ReportData) -> tuple[list[str], list[list[str]], list[str]]:
    """Return header, rows and noise floors of a table of settings, the closest to reality first.

    A row begins with the id of the run that is farthest from its recording.
    """
    knobs, closest = _list_varying_knobs(data), _find_closest(data)
    rows: list[list[str]] = []
    for setting, farthest in closest:
        ticks = [axis.ticks[axis.codes[farthest]] for axis in knobs]
        rows.append([data.store.columns.run_id(farthest), *ticks, f"{len(setting):,}"])
    header = ["farthest run", *(axis.title for axis in knobs), "runs"]
    foot = ["start noise", *("" for _ in knobs), ""]
    alike, has_floor = code_alike_runs(data.axes, data.store.columns.runs), False
    columns = data.quantities.columns
    names = [column.name for column in columns if column.name.startswith("reality")]
    # A large store has one column in memory at a time.
    for quantity in data.quantities.select_named(names):
        header.append(f"mean {quantity.title}")
        for row, (setting, _) in zip(rows, closest, strict=True):
            row.append(_mean_of_finite(quantity.values[setting]))
        floor = noise_floor(alike, quantity.values)
        foot.append("" if floor is None else f"{floor:.3g}")
        has_floor |= bool(floor)
    return header, rows, foot if has_floor else []


def _find_closest(data: ReportData) -> list[tuple[NDArray[np.int64], int]]:
    # Each entry has the runs of one of the closest settings, and the one farthest from reality.
    [reality] = data.quantities_named("reality")
    most_closest = 12  # lines of the page
    # Copies, so that the rows of all other settings leave memory.
    closest = [setting.rows.copy() for setting in compared_settings(data)[:most_closest]]
    return [(rows, int(rows[np.argmax(reality.values[rows])])) for rows in closest]


def _mean_of_finite(values: Floats) -> str:
    finite = values[np.isfinite(values)]
    return f"{finite.mean():.3g}" if len(finite) else "-"
