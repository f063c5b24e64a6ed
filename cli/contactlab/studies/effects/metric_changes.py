"""Differences between configurations: metrics in tolerances, labels, and CPU time."""

import json
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import inf, isfinite
from statistics import fmean, median
from typing import Any

import numpy as np

from contactlab.measure import METRICS, Requirement
from contactlab.run.evidence_record import as_written
from contactlab.schema.drive import NoiseDrive, parse_drive
from contactlab.schema.effects_report import MetricChange, Ratio
from contactlab.studies.configuration_runs import ConfigurationRows, Row
from contactlab.studies.effects.effect_toggles import BASE, MOTION, Changed
from contactlab.studies.session import Values

_SHARE = 0.01
# What an effect makes unmeasurable: energies that are not recorded while it is off, and distances
# of speculative contacts, which are no depths.
_UNMEASURED: Mapping[str, Requirement] = {"energy": "energy", "speculative": "depth"}


def judged_metrics(changed: Collection[str] = ()) -> list[str]:
    """Return the metrics of the physics; all others count work, or explain one of these.

    Those are left out that cannot be measured with or without one of the changed effects.
    """
    missing = {_UNMEASURED[effect] for effect in changed if effect in _UNMEASURED}
    physics = [each for each in METRICS.values() if each.kind == "physics"]
    return [each.name for each in physics if each.requires not in missing]


@dataclass(frozen=True)
class ConfigurationDifference:
    """The difference between matched pairs of runs of two configurations."""

    # The change of every metric, in the scenario where it is largest; largest first.
    changes: tuple[MetricChange, ...]
    # Changes of labels to any that the base does not have with some seed, by runs.
    labels: Mapping[str, int]

    @property
    def matters(self) -> bool:
        """Whether any change exceeds both tolerance and spread."""
        return bool(self.labels) or any(each.matters for each in self.changes)

    @property
    def within_spread(self) -> tuple[str, ...]:
        """Metrics that change by more than the tolerance, but less than the spread over seeds."""
        return tuple(
            each.metric
            for each in self.changes
            if not each.matters and each.times is not None and each.times > 1
        )

    @property
    def reason(self) -> str:
        """The largest change, as text."""
        if self.labels:
            return ", ".join(self.labels)
        if worst := next((each for each in self.changes if each.matters), None):
            return _change_text(worst)
        for each in self.changes:
            if each.metric in self.within_spread:
                return (
                    f"{each.metric} changes by {each.change:.3g} {each.unit}, within the spread "
                    f"of {each.spread:.3g} over seeds"
                )
        return "no metric changes by its tolerance"


def difference(
    tolerances: Mapping[str, float],
    base: ConfigurationRows,
    other: ConfigurationRows,
    changed: Changed = BASE,
) -> ConfigurationDifference:
    """Return the difference that changed effects make, over scenarios and seeds."""
    matched = list(zip(base.scenarios, base.rows, other.rows, strict=True))
    largest = [
        max((_change(name, tolerances, *each) for each in matched), key=_weight)
        for name in tolerances or (*judged_metrics(changed), *({MOTION} & base.flat[0].keys()))
    ]
    changes = sorted((each for each in largest if _weight(each)[1]), key=_weight, reverse=True)
    labels: Counter[str] = Counter()
    for _, first, second in matched:
        known = {row["label"] for row in first}
        labels.update(
            f"{one['label']} -> {two['label']}"
            for one, two in zip(first, second, strict=True)
            if two["label"] not in known
        )
    return ConfigurationDifference(tuple(changes), dict(labels))


def _weight(change: MetricChange) -> tuple[bool, float]:
    return change.matters, inf if change.times is None else change.times


def _change(
    name: str,
    given: Mapping[str, float],
    scenario: Values,
    base: Sequence[Row],
    other: Sequence[Row],
) -> MetricChange:
    """Compare a metric in one scenario; differences within its spread over seeds do not matter."""
    own = [row[name] for row in base if row[name] is not None]
    pairs = [
        _difference(second[name], first[name])
        for first, second in zip(base, other, strict=True)
        if first[name] is not None and second[name] is not None
    ]
    tolerance = given.get(name, _SHARE)
    if name not in given and name != MOTION:
        tolerance = max(METRICS[name].tolerance, _SHARE * max(map(abs, own), default=0.0))
    alike = () if name == MOTION and any(map(_has_noise, base)) else combinations(own, 2)
    spread = max((abs(_difference(*pair)) for pair in alike), default=0.0)
    # Measured in all runs of one configuration and in none of the other.
    appears = not pairs and (
        len(own) == len(base) or (not own and all(row[name] is not None for row in other))
    )
    mean = fmean(pairs) if pairs else None
    size = abs(mean) if mean is not None else inf if appears else 0.0
    return MetricChange(
        metric=name,
        unit="1" if name == MOTION else METRICS[name].unit,
        change=mean,
        tolerance=tolerance,
        times=None if appears or (size and not tolerance) else size / (tolerance or 1.0),
        spread=spread,
        scenario={key: as_written(value) for key, value in scenario.items()},
        matters=size > tolerance and size > spread,
    )


def _has_noise(row: Row) -> bool:
    """Return whether a run's controls are noise, which its seed draws: motions differ by seed."""
    drive = row.get("drive")
    return bool(drive) and isinstance(parse_drive(json.loads(drive)), NoiseDrive)


def _difference(value: Any, other: Any) -> float:  # noqa: ANN401 - a number or an array
    """Return the difference of two numbers; of motions, the largest at a time that both have."""
    if not isinstance(value, np.ndarray):
        return value - other
    steps = min(len(value), len(other))
    return float(np.nan_to_num(np.abs(value[:steps] - other[:steps])).max(initial=0.0))


def _change_text(change: MetricChange) -> str:
    if change.change is None:
        return f"{change.metric} can be measured in one of the configurations only"
    unit = "" if change.unit in {"1", "any"} else f" {change.unit}"
    where = ", ".join(f"{name} {value}" for name, value in change.scenario.items())
    return (
        f"{change.metric} {change.change:+.3g}{unit}, {change.times:.3g} tolerances"
        f"{f' at {where}' if where else ''}"
    )


_WORK = ("work_iterations", "work_contacts", "work_rows")


def cost_ratio(base: ConfigurationRows, other: ConfigurationRows) -> Ratio | None:
    """Return the ratio of CPU times; None without any timed pair."""
    ratios = list(_ratios(base, other, "time_min"))
    return Ratio.of(ratios) if ratios else None


def work_ratios(base: ConfigurationRows, other: ConfigurationRows) -> dict[str, float]:
    """Return the ratio of each work counter that the base has."""
    ratios = {name: list(_ratios(base, other, name)) for name in _WORK}
    return {name: median(each) for name, each in ratios.items() if each}


def _ratios(base: ConfigurationRows, other: ConfigurationRows, name: str) -> Iterator[float]:
    for first, second in zip(base.flat, other.flat, strict=True):
        below, above = first.get(name), second.get(name)
        if below and above is not None and isfinite(above / below):
            yield above / below
