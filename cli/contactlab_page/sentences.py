"""What parts of a page show, each in one sentence that their numbers bear out."""

from collections.abc import Mapping, Sequence

import numpy as np

from contactlab.pareto.recommendation import setting_text
from contactlab.reporting.report import ReportData
from contactlab.reporting.report_columns import number_with_unit
from contactlab.reporting.start_noise import start_noise
from contactlab.schema.evidence import Setting
from contactlab.schema.tradeoff_report import TradeoffReport

_MOST_CLOSEST = 12


def tradeoff_sentence(report: TradeoffReport) -> str:
    """Return how many configurations will do, and what the recommended one saves."""
    every, chosen = report.configurations, report.recommendation
    feasible = [each for each in every if each.feasible]
    are = "configuration is" if len(every) == 1 else "configurations are"
    said = f"{len(feasible):,} of {len(every):,} {are} within every tolerance"
    if chosen is None:
        return f"{said}; none can be recommended."
    what = _settings(chosen.configuration, report.varying)
    timed = [each for each in feasible if each.error is not None and each.time]
    finest = min(timed, key=lambda each: each.error or 0.0, default=None)
    if finest is None or finest.configuration == chosen.configuration or not chosen.time:
        return f"{said}; the recommended {what} is the most accurate of them."
    ratio = (finest.time or 0.0) / chosen.time
    other = _settings(finest.configuration, report.varying)
    pace = f"takes {ratio:.3g} times as long as the recommended {what}"
    return f"{said}; the most accurate, {other}, {pace}."


def _settings(values: Mapping[str, Setting], names: Sequence[str]) -> str:
    told = [f"{name} {setting_text(values[name])}" for name in names]
    return " with ".join(told) or "the only one"


def reality_sentence(data: ReportData) -> str:
    """Return which run is closest to its recording, and how far off the median run is."""
    [reality] = data.quantities_named("reality")
    measured = np.flatnonzero(np.isfinite(reality.values))
    best = int(measured[np.argmin(reality.values[measured])])
    what = " with ".join(f"{a.name} {a.ticks[a.codes[best]]}" for a in data.axes) or "the run"
    least, median = reality.values[best], float(np.median(reality.values[measured]))
    unit = reality.column.unit
    floor = start_noise(data.axes, reality.values)
    moved = number_with_unit(f"{floor or 0:.3g}", unit)
    noise = f" Noise of the start alone moves a run by {moved} on average." if floor else ""
    return (
        f"Of {len(measured):,} runs that were compared with a recording, {what} is closest: "
        f"{number_with_unit(f'{least:.3g}', unit)} away on average, "
        f"the median run {number_with_unit(f'{median:.3g}', unit)}.{noise}"
    )


def closest_runs(data: ReportData) -> tuple[list[str], list[list[str]], list[str]]:
    """Return header and rows of the runs that are closest to recordings, and noise floors."""
    quantities = [each for each in data.quantities if each.name.startswith("reality")]
    values = next(each.values for each in quantities if each.name == "reality")
    order = np.argsort(values, kind="stable")[: min(_MOST_CLOSEST, int(np.isfinite(values).sum()))]
    ids, labels = data.store.columns.run_ids, data.labels
    rows = [
        [str(ids[row]), labels.names[labels.codes[row]]]
        + [axis.ticks[axis.codes[row]] for axis in data.axes]
        + [f"{each.values[row]:.3g}" for each in quantities]
        for row in order.tolist()
    ]
    floors = [start_noise(data.axes, each.values) for each in quantities]
    foot = ["start noise", "", *("" for _ in data.axes)]
    foot += ["" if each is None else f"{each:.3g}" for each in floors]
    header = ["run", "label", *(each.title for each in (*data.axes, *quantities))]
    return header, rows, foot if any(floors) else []
