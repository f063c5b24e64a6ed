"""How much a metric may change before an effect is said to matter."""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from statistics import fmean, median
from types import MappingProxyType

from contactlab.measure import METRICS
from contactlab.run.evidence_record import as_written
from contactlab.schema import MetricChange, Ratio
from contactlab.studies.effects.effect_toggles import Row, TrialOutcome
from contactlab.studies.effects.effects_request import EffectsRequest, Values

# Metrics that count work, or that a second pass measures: no results of the physics.
_NOT_JUDGED = {
    "solver_iterations_mean",
    "solver_iterations_max",
    "solver_iterations",
    "saturated_share",
    "contacts_mean",
    "contacts_max",
    "contacts_cut",
    "ungraded_contacts",
    "solver_residual",
    "jacobian_difference",
    "overlap_missed",
    "distance_phantom",
    "repeats",
    "oracle_expected",
    "oracle_measured",
}
JUDGED = tuple(name for name in METRICS if name not in _NOT_JUDGED)
# What cannot be measured with an effect off, or on: energies that are not recorded, and depths of
# contacts ahead of touch, whose distance is made up.
UNMEASURED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "energy": (
            "energy_gain",
            "energy_drift",
            "speed_ratio",
            "momentum_drift",
            "spin_drift",
            "settle_time",
        ),
        "speculative": (
            "penetration_max",
            "penetration_mean",
            "penetration_steady",
            "penetration_growth",
            "hold_penetration",
            "distance_min",
        ),
    }
)
# By unit: 0.1 mm is the depth that practice accepts; 1 mm/s is a fifth of what tells sliding
# from sticking; ratios count to 1 %.
_BY_UNIT = {
    "m": 1e-4,
    "m/s": 1e-3,
    "rad": 0.01,
    "1": 0.01,
    "any": 0.01,
    "s": 0.02,
    "J": 1e-3,
    "N s": 0.0,
}
# 0.1 % a second is what practice lets free motion lose; 5 a second is what it calls chatter.
_BY_NAME = {
    "energy_drift": 1e-3,
    "mode_switches": 5.0,
    "contact_losses": 5.0,
    "hold_switches": 5.0,
    "penetration_growth": 1e-4,
    "creep_speed": 1e-4,
}
_SHARE = 0.01


def tolerance_of(name: str, given: Mapping[str, float], values: Sequence[float]) -> float:
    """Return the largest change of a metric that is none, in its unit.

    Args:
        name: the metric.
        given: what sweep or scene say; taken as it is.
        values: the metric without the change; 1 % of its largest size is none.
    """
    if name in given:
        return given[name]
    usual = _BY_NAME.get(name, _BY_UNIT.get(METRICS[name].unit, 0.0))
    return max(usual, _SHARE * max(map(abs, values), default=0.0))


@dataclass(frozen=True)
class TrialDifference:
    """What changed between matched pairs of runs.

    Attributes:
        changes: of every metric, in the scenario where it changes most; largest first.
        labels: label changes beyond those between seeds, with their counts.
    """

    changes: tuple[MetricChange, ...]
    labels: Mapping[str, int]

    @property
    def matters(self) -> bool:
        """Whether anything changed beyond tolerance and spread."""
        return bool(self.labels) or any(each.matters for each in self.changes)

    @property
    def within_spread(self) -> tuple[str, ...]:
        """Metrics that changed by more than their tolerance, but less than between seeds."""
        return tuple(
            each.metric
            for each in self.changes
            if not each.matters and each.times is not None and each.times > 1
        )

    @property
    def reason(self) -> str:
        """What changed most, in words."""
        if self.labels:
            return ", ".join(self.labels)
        worst = next((each for each in self.changes if each.matters), None)
        if worst is not None:
            return _told(worst)
        if self.within_spread:
            named = {each.metric: each for each in self.changes}
            first = named[self.within_spread[0]]
            return (
                f"{first.metric} changes by {first.change:.3g} {first.unit}, within the spread "
                f"of {first.spread:.3g} over seeds"
            )
        return "no metric changes by its tolerance"


def difference(
    question: EffectsRequest,
    scenarios: Sequence[Values],
    base: TrialOutcome,
    other: TrialOutcome,
    exempt: Collection[str] = (),
) -> TrialDifference:
    """Return what a configuration changes over scenarios and seeds.

    Args:
        question: says tolerances.
        scenarios: those of the outcomes.
        base: without the change.
        other: with it.
        exempt: metrics that the change leaves unmeasured by what it is.
    """
    names = [name for name in question.tolerances or JUDGED if name not in exempt]
    found = [max(_changes(name, question, scenarios, base, other), key=_weight) for name in names]
    changes = sorted((each for each in found if _weight(each)[1]), key=_weight, reverse=True)
    labels: Counter[str] = Counter()
    for first, second in zip(base.rows, other.rows, strict=True):
        labels.update(_label_changes(first, second))
    return TrialDifference(tuple(changes), dict(labels))


def _weight(change: MetricChange) -> tuple[bool, float]:
    return change.matters, inf if change.times is None else change.times


def _changes(
    name: str,
    question: EffectsRequest,
    scenarios: Sequence[Values],
    base: TrialOutcome,
    other: TrialOutcome,
) -> Iterator[MetricChange]:
    for scenario, first, second in zip(scenarios, base.rows, other.rows, strict=True):
        yield _change(name, question.tolerances, scenario, first, second)


def _change(
    name: str,
    given: Mapping[str, float],
    scenario: Values,
    base: Sequence[Row],
    other: Sequence[Row],
) -> MetricChange:
    """Compare a metric in one scenario; what differs between seeds alone is no change."""
    own = [row[name] for row in base if row[name] is not None]
    pairs = [
        second[name] - first[name]
        for first, second in zip(base, other, strict=True)
        if first[name] is not None and second[name] is not None
    ]
    tolerance = tolerance_of(name, given, own)
    spread = max(own) - min(own) if own else 0.0
    # Measured in all runs of one configuration and in none of the other.
    appears = not pairs and (
        len(own) == len(base) or (not own and all(row[name] is not None for row in other))
    )
    mean = fmean(pairs) if pairs else None
    size = abs(mean) if mean is not None else inf if appears else 0.0
    return MetricChange(
        metric=name,
        unit=METRICS[name].unit,
        change=mean,
        tolerance=tolerance,
        times=None if appears or (size and not tolerance) else size / (tolerance or 1.0),
        spread=spread,
        scenario={key: as_written(value) for key, value in scenario.items()},
        matters=size > tolerance and size > spread,
    )


def _label_changes(base: Sequence[Row], other: Sequence[Row]) -> Iterator[str]:
    """Yield label changes to what the scene shows from none of its seeds."""
    usual = {row["label"] for row in base}
    for first, second in zip(base, other, strict=True):
        if second["label"] not in usual:
            yield f"{first['label']} -> {second['label']}"


def _told(change: MetricChange) -> str:
    if change.change is None:
        return f"{change.metric} can be measured in one case only"
    unit = "" if change.unit in {"1", "any"} else f" {change.unit}"
    where = ", ".join(f"{name} {value}" for name, value in change.scenario.items())
    return (
        f"{change.metric} {change.change:+.3g}{unit}, {change.times:.3g} tolerances"
        f"{f' at {where}' if where else ''}"
    )


_WORK = ("work_iterations", "work_contacts", "work_rows")


def cost_ratio(base: TrialOutcome, other: TrialOutcome) -> Ratio | None:
    """Return the ratio of CPU times, or None if no pair went through."""
    ratios = list(_ratios(base, other, "time_min"))
    if not ratios:
        return None
    return Ratio(ratio=median(ratios), low=min(ratios), high=max(ratios), pairs=len(ratios))


def work_ratios(base: TrialOutcome, other: TrialOutcome) -> dict[str, float]:
    """Return the ratio of each work counter, of those that the base has."""
    found = {name: list(_ratios(base, other, name)) for name in _WORK}
    return {name: median(each) for name, each in found.items() if each}


def _ratios(base: TrialOutcome, other: TrialOutcome, name: str) -> Iterator[float]:
    for first, second in zip(base.flat, other.flat, strict=True):
        below, above = first.get(name), second.get(name)
        if below and above is not None and isfinite(above / below):
            yield above / below
