"""Accuracy against time, as a Vega-Lite specification of few enough marks."""

import re
from collections.abc import Iterator
from typing import Any

from contactlab.report.gathering import Gathered
from contactlab.report.theme import configured
from contactlab.schema import Configuration, Setting, Settings, TradeoffReport
from contactlab.tradeoff import specify

_MOST = 600
_TIMESTEP = "timestep"
_COUNT = re.compile(r"^\d+ of \d+")
Key = tuple[tuple[str, Setting], ...]


def tradeoff_chart(gathered: Gathered) -> dict[str, Any] | None:
    """Return accuracy against time; None where the store does not have both.

    Of very many configurations it shows those of the best methods, and some of the others.
    """
    report = gathered.weighing.report if gathered.weighing else None
    if report is None or not any(map(_has_place, report.configurations)):
        return None
    kept = _kept(report)
    shown = tuple(report.configurations[place] for place in kept)
    spec = specify(report.model_copy(update={"configurations": shown}))
    for layer in spec["layer"]:
        for row in layer["data"]["values"]:
            if "place" in row:
                row["place"] = kept[row["place"]]
    subtitle = spec["title"]["subtitle"]
    subtitle[0] = _COUNT.sub(_counted(report), subtitle[0])
    return configured(spec)


def _has_place(each: Configuration) -> bool:
    return each.time is not None and each.error is not None


def _counted(report: TradeoffReport) -> str:
    feasible = sum(each.feasible for each in report.configurations)
    return f"{feasible} of {len(report.configurations)}"


def _kept(report: TradeoffReport) -> list[int]:
    """Return the places of what is drawn: whole methods, those of the fronts before others."""
    found: dict[Key, list[int]] = {}
    for place, each in enumerate(report.configurations):
        found.setdefault(_method(each.configuration), []).append(place)
    kept: list[int] = []
    for key in dict.fromkeys((*_best(report), *_spread(list(found)))):
        if len(kept) < _MOST:
            kept += found[key]
    return sorted(kept)


def _best(report: TradeoffReport) -> Iterator[Key]:
    picks = [each for each in (report.recommendation, report.robust) if each is not None]
    for each in (*picks, *report.front, *report.unconstrained_front):
        yield _method(each.configuration)


def _spread(keys: list[Key]) -> Iterator[Key]:
    """Yield keys, those far from each other first."""
    stride = max(1, len(keys) // 64)
    for start in range(stride):
        yield from keys[start::stride]


def _method(values: Settings) -> Key:
    return tuple((name, value) for name, value in values.items() if name != _TIMESTEP)
