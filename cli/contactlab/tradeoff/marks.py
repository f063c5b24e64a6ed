"""What the figure shows, as rows of data."""

from dataclasses import dataclass
from typing import Any

from contactlab.schema import Configuration, Settings, TradeoffReport
from contactlab.tradeoff.methods import TIMESTEP, method_key
from contactlab.tradeoff.selection import OTHERS, Selection, ends, is_failed, select, without

_ROOM = 1.6
"""How far the frame reaches beyond the outermost points."""
RECOMMENDED = "recommended"
ROBUST = "margin 1.25"
# Errors farther above the tolerance would squeeze all others into a corner.
_OFF = 30.0


@dataclass(frozen=True)
class Frame:
    """The ends of the axes.

    Attributes:
        time: least and most [CPU s per simulated s].
        error: least and most, in the error's unit; never 0.
    """

    time: tuple[float, float]
    error: tuple[float, float]


@dataclass(frozen=True)
class Marks:
    """The rows of the figure's layers.

    Attributes:
        frame: the ends of the axes.
        methods: names of the methods that get a colour, with their letters; the best first.
        points: one a configuration.
        front: the feasible front, cheapest first.
        floors: one a coloured method that has a floor.
    """

    frame: Frame
    methods: list[str]
    points: list[dict[str, Any]]
    front: list[dict[str, Any]]
    floors: list[dict[str, Any]]


def marks(report: TradeoffReport) -> Marks:
    """Return what the figure of a report shows."""
    shown = select(report)
    floors: list[dict[str, Any]] = [
        {"method": shown.names[key], "error": each.floor.error}
        for each in report.methods
        if each.floor and (key := method_key(each.configuration)) in shown.names
    ]
    frame = _frame(report, shown, [each["error"] for each in floors])
    return Marks(
        frame=frame,
        methods=list(shown.names.values()),
        points=_points(report, shown, frame),
        front=[
            {"time": each.time, "error": _above(each.error or 0.0, frame)} for each in shown.front
        ],
        floors=floors,
    )


def _frame(report: TradeoffReport, shown: Selection, floors: list[float]) -> Frame:
    limit = report.tolerances.get(report.error.name)
    times = [each.time for each in shown.configurations if each.time]
    errors = [each.error for each in shown.configurations if each.error and not is_failed(each)]
    near = [error for error in errors if not limit or error <= _OFF * limit]
    return Frame(_around(times), _around([*near, *floors, *([limit] if limit else [])]))


def _around(values: list[float]) -> tuple[float, float]:
    return min(values, default=1.0) / _ROOM, max(values, default=1.0) * _ROOM


def _points(report: TradeoffReport, shown: Selection, frame: Frame) -> list[dict[str, Any]]:
    outermost = ends(shown)
    places = {id(each): place for place, each in enumerate(report.configurations)}
    return [
        {"place": places[id(each)]}
        | _point(each, report, shown, frame)
        | {"labelled": index in outermost or any(each is other for other in shown.front)}
        for index, each in enumerate(shown.configurations)
    ]


def _point(
    each: Configuration, report: TradeoffReport, shown: Selection, frame: Frame
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
        "state": "failed" if failed else _state(each),
        "chosen": f"{chosen} {name[:1]} {label}".strip() if chosen else "",
    }


def _above(error: float, frame: Frame) -> float:
    """Return an error that a logarithmic axis can show: none lies below the frame."""
    return max(error, frame.error[0])


def _state(each: Configuration) -> str:
    return "within tolerance" if each.feasible else "beyond tolerance"


def _chosen(values: Settings, report: TradeoffReport) -> str:
    """Return what is said of a configuration that is recommended; else nothing."""
    for name, pick in ((RECOMMENDED, report.recommendation), (ROBUST, report.robust)):
        if pick and without(pick.configuration, report.idle) == without(values, report.idle):
            return name
    return ""
