"""Which configurations a figure shows, and how it calls their methods."""

from dataclasses import dataclass

import numpy as np

from contactlab.schema import Configuration, Settings, TradeoffReport
from contactlab.tradeoff.front import front
from contactlab.tradeoff.methods import TIMESTEP, Key, method_key, method_name, varying
from contactlab.tradeoff.palette import LETTERS

OTHERS = "others"
# An oracle's miss is a large error, and nothing else went wrong.
_MEASURED = {"stable", "oracle_miss"}


@dataclass(frozen=True)
class Selection:
    """What a figure shows.

    Attributes:
        configurations: with one value of each idle knob only, the recommended one.
        front: the feasible ones of them that none beats in both time and error.
        names: of the methods that get a colour, with their letters; the best first.
    """

    configurations: tuple[Configuration, ...]
    front: tuple[Configuration, ...]
    names: dict[Key, str]


def select(report: TradeoffReport) -> Selection:
    """Return what the figure of a report shows.

    At most eight methods get a colour: the recommended first, then those on the front, then the
    most accurate.
    """
    keys = {method_key(each.configuration) for each in report.methods}
    shown = tuple(each for each in report.configurations if method_key(each.configuration) in keys)
    fit = [each for each in shown if each.feasible]
    line = tuple(fit[index] for index in front(_times(fit), _errors(fit)))
    return Selection(shown, line, _names(report, shown, line))


def is_failed(each: Configuration) -> bool:
    """Say whether a configuration has no place on the axis of errors."""
    return each.error is None or not set(each.outcomes.labels) <= _MEASURED


def without(values: Settings, names: tuple[str, ...]) -> Settings:
    """Return settings without some of them."""
    return {name: value for name, value in values.items() if name not in names}


def _names(
    report: TradeoffReport, shown: tuple[Configuration, ...], line: tuple[Configuration, ...]
) -> dict[Key, str]:
    alike = {name: report.methods[0].configuration[name] for name in report.idle}
    picks = [
        {**each.configuration, **alike} for each in (report.recommendation, report.robust) if each
    ]
    by_error = sorted(
        (each for each in shown if not is_failed(each)), key=lambda each: each.error or 0.0
    )
    ordered = [*picks, *(each.configuration for each in (*line, *by_error, *shown))]
    keys = list(dict.fromkeys(map(method_key, ordered)))
    differing = varying([dict(key) for key in keys])
    return {
        key: f"{letter}  {method_name(dict(key), differing)}"
        for letter, key in zip(LETTERS, keys, strict=False)
    }


def ends(selection: Selection) -> set[int]:
    """Return the places of the configurations at the ends of the lines of methods."""
    lines: dict[Key, list[tuple[float, int]]] = {}
    for index, each in enumerate(selection.configurations):
        step = each.configuration.get(TIMESTEP)
        if isinstance(step, int | float) and not is_failed(each):
            lines.setdefault(method_key(each.configuration), []).append((step, index))
    return {end[1] for line in lines.values() for end in (min(line), max(line))}


def _times(found: list[Configuration]) -> np.ndarray:
    return np.array([np.nan if each.time is None else each.time for each in found])


def _errors(found: list[Configuration]) -> np.ndarray:
    return np.array([np.nan if each.error is None else each.error for each in found])
