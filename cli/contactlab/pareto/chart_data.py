"""What the chart of a trade-off shows: its configurations, names of methods, rows of data."""

from dataclasses import dataclass
from typing import Any

from contactlab.palette import LETTERS
from contactlab.pareto.convergence import TIMESTEP, MethodKey, method_key, method_name, varying
from contactlab.pareto.recommendation import front_of
from contactlab.schema.tradeoff_report import Configuration, Settings, TradeoffReport

OTHERS = "others"
# A run labelled oracle_miss has a large error, which the chart shows.
_MEASURED = {"stable", "oracle_miss"}


@dataclass(frozen=True)
class ChartSelection:
    """The configurations of a chart.

    Attributes:
        configurations: with one value of each idle knob, that of the recommendation.
        front: the Pareto front of the feasible ones.
        names: of the methods with a colour, with their letters; the best first.
    """

    configurations: tuple[Configuration, ...]
    front: tuple[Configuration, ...]
    names: dict[MethodKey, str]


def select(report: TradeoffReport) -> ChartSelection:
    """Return the configurations that the chart of a report shows.

    At most eight methods get a colour: the recommended first, then those on the front, then the
    most accurate.
    """
    keys = {method_key(each.configuration) for each in report.methods}
    shown = tuple(each for each in report.configurations if method_key(each.configuration) in keys)
    feasible = [each for each in shown if each.feasible]
    front = tuple(feasible[index] for index in front_of(feasible))
    return ChartSelection(shown, front, _names(report, shown, front))


def is_failed(each: Configuration) -> bool:
    """Say whether a configuration has no place on the axis of errors."""
    return each.error is None or not set(each.outcomes.labels) <= _MEASURED


def _names(
    report: TradeoffReport, shown: tuple[Configuration, ...], front: tuple[Configuration, ...]
) -> dict[MethodKey, str]:
    idle = {name: report.methods[0].configuration[name] for name in report.idle}
    recommended = [
        {**each.configuration, **idle} for each in (report.recommendation, report.robust) if each
    ]
    by_error = sorted(
        (each for each in shown if not is_failed(each)), key=lambda each: each.error or 0.0
    )
    ordered = [*recommended, *(each.configuration for each in (*front, *by_error, *shown))]
    keys = list(dict.fromkeys(map(method_key, ordered)))
    differing = varying([dict(key) for key in keys])
    return {
        key: f"{letter}  {method_name(dict(key), differing)}"
        for letter, key in zip(LETTERS, keys, strict=False)
    }


def ends(selection: ChartSelection) -> set[int]:
    """Return the indices of the configurations with the shortest and longest step of a method."""
    lines: dict[MethodKey, list[tuple[float, int]]] = {}
    for index, each in enumerate(selection.configurations):
        step = each.configuration.get(TIMESTEP)
        if isinstance(step, int | float) and not is_failed(each):
            lines.setdefault(method_key(each.configuration), []).append((step, index))
    return {end[1] for line in lines.values() for end in (min(line), max(line))}


_PADDING = 1.6
"""Factor by which the axes extend beyond the outermost points."""
RECOMMENDED = "recommended"
ROBUST = "margin 1.25"
_MOST_EXCESS = 30.0
"""Errors above so many tolerances are drawn at the edge, to leave room for the others."""


@dataclass(frozen=True)
class ChartFrame:
    """The limits of the axes.

    Attributes:
        time: lower and upper [CPU s per simulated s].
        error: lower and upper, in the error's unit; never 0.
    """

    time: tuple[float, float]
    error: tuple[float, float]


@dataclass(frozen=True)
class ChartData:
    """The rows of the figure's layers.

    Attributes:
        methods: names of the methods with a colour, with their letters; the best first.
        points: one per configuration.
        front: the feasible Pareto front, cheapest first.
        floors: one per coloured method with a floor.
    """

    frame: ChartFrame
    methods: list[str]
    points: list[dict[str, Any]]
    front: list[dict[str, Any]]
    floors: list[dict[str, Any]]


def chart_data(report: TradeoffReport) -> ChartData:
    """Return the rows of every layer of a report's chart."""
    shown = select(report)
    floors: list[dict[str, Any]] = [
        {"method": shown.names[key], "error": each.floor.error}
        for each in report.methods
        if each.floor and (key := method_key(each.configuration)) in shown.names
    ]
    frame = _frame(report, shown, [each["error"] for each in floors])
    return ChartData(
        frame=frame,
        methods=list(shown.names.values()),
        points=_points(report, shown, frame),
        front=[
            {"time": each.time, "error": _above(each.error or 0.0, frame)} for each in shown.front
        ],
        floors=floors,
    )


def _frame(report: TradeoffReport, shown: ChartSelection, floors: list[float]) -> ChartFrame:
    limit = report.tolerances.get(report.error.name)
    times = [each.time for each in shown.configurations if each.time]
    errors = [each.error for each in shown.configurations if each.error and not is_failed(each)]
    near = [error for error in errors if not limit or error <= _MOST_EXCESS * limit]
    return ChartFrame(_around(times), _around([*near, *floors, *([limit] if limit else [])]))


def _around(values: list[float]) -> tuple[float, float]:
    return min(values, default=1.0) / _PADDING, max(values, default=1.0) * _PADDING


def _points(
    report: TradeoffReport, shown: ChartSelection, frame: ChartFrame
) -> list[dict[str, Any]]:
    outermost = ends(shown)
    places = {id(each): place for place, each in enumerate(report.configurations)}
    return [
        {"place": places[id(each)]}
        | _point(each, report, shown, frame)
        | {"labelled": index in outermost or any(each is other for other in shown.front)}
        for index, each in enumerate(shown.configurations)
    ]


def _point(
    each: Configuration, report: TradeoffReport, shown: ChartSelection, frame: ChartFrame
) -> dict[str, Any]:
    key = method_key(each.configuration)
    name = shown.names.get(key, OTHERS)
    failed = is_failed(each) or (each.error or 0.0) > frame.error[1]
    step = each.configuration.get(TIMESTEP)
    label = f"{1e3 * step:.3g} ms" if isinstance(step, int | float) else ""
    chosen = _chosen(each.configuration, report)
    return {
        "method": name,
        "line": "; ".join(f"{axis} {value}" for axis, value in key),
        "time": each.time or frame.time[0],
        "error": frame.error[1] if failed else _above(each.error or 0.0, frame),
        "timestep": step,
        "bound": each.below_estimate,
        "label": f"{name[:1]} {label}",
        "state": "failed" if failed else f"{'within' if each.feasible else 'beyond'} tolerance",
        "chosen": f"{chosen} {name[:1]} {label}".strip() if chosen else "",
    }


def _above(error: float, frame: ChartFrame) -> float:
    """Return an error that a logarithmic axis can show: at least the lower limit."""
    return max(error, frame.error[0])


def _chosen(values: Settings, report: TradeoffReport) -> str:
    """Return the words at a recommended configuration; empty at others."""
    knobs = [name for name in report.knobs if name not in report.idle]
    for word, pick in ((RECOMMENDED, report.recommendation), (ROBUST, report.robust)):
        if pick and all(pick.configuration[name] == values[name] for name in knobs):
            return word
    return ""
