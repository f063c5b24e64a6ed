"""Toggles of effects, runs of toggled configurations, and their differences."""

import json
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import inf, isfinite
from statistics import fmean, median, stdev
from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np

from contactlab.measure import METRICS, Requirement
from contactlab.modifications.catalogue import list_features
from contactlab.modifications.modification import Feature
from contactlab.scene.effects.effect import EffectState
from contactlab.schema.drive import NoiseDrive, parse_drive
from contactlab.schema.study_reports import MetricChange
from contactlab.schema.time_ratio import TimeRatio
from contactlab.schema.tradeoff_report import REALITY
from contactlab.store.finished_store import Store
from contactlab.store.table_layout import axis_cell
from contactlab.studies.effects.configuration_runs import ConfigurationRows, Row, run_configurations
from contactlab.studies.effects.effects_request import AblationSetup
from contactlab.tasks.session import Session, Values

States = Mapping[str, EffectState]  # the state of every effect in a run, by name


class Toggle(NamedTuple):
    """One effect, whether it is on in the base configuration, and axis values that toggle it.

    The proof says why results do not depend on it, if that is known without a run.
    """

    effect: str
    on: bool
    values: Values
    proof: str | None


def find_toggles(setup: AblationSetup) -> tuple[Toggle, ...]:
    """Return a toggle of every effect that can be toggled in the base configuration."""
    written, proven = list(_choices(setup, "all")), list(_choices(setup, "auto"))
    known = [feature for feature in list_features() if feature.name in written[0]]
    return tuple(filter(None, (_toggle(feature, written, proven) for feature in known)))


def _choices(setup: AblationSetup, rest: str) -> Iterator[States]:
    scene = setup.scene.with_effects(rest)
    for scenario in setup.scenarios:
        run = scene.resolve({**setup.base, **scenario}, setup.seeds[0], setup.duration)
        yield scene.prepare(run, scene.initial_states([run])).effects


def _toggle(feature: Feature, written: list[States], proven: list[States]) -> Toggle | None:
    name = feature.name
    if not any(states[name].on for states in written):
        return Toggle(name, False, feature.on, None) if feature.on else None
    unused = not any(states[name].on for states in proven)
    proof = proven[0][name].reason if unused and written[0][name].on else None
    return Toggle(name, True, feature.off_values, proof)


def settings_sweep(settings: Values, proven: Iterable[str]) -> tuple[str, ...]:
    """Return the lines of a sweep file for settings of toggles; `auto` covers proven ones."""
    switched = {
        name: value
        for name, value in settings.items()
        if isinstance(value, bool) and name not in set(proven)
    }
    axes = {name: value for name, value in settings.items() if not isinstance(value, bool)}
    words = ["base: auto", *(f"{name}: {str(value).lower()}" for name, value in switched.items())]
    lines = [f"effects: {{{', '.join(words)}}}"]
    if axes:
        lines.append("axes:")
        lines += [f"  {name}: [{axis_cell(value)}]" for name, value in axes.items()]
    return tuple(lines)


Changed = tuple[str, ...]
"""A configuration: the sorted effects that it toggles in the base configuration."""

BASE: Changed = ()


MOTION = "motion"
"""Joint positions over time: (N, nq) qpos, as shares of limited ranges, otherwise in m or rad."""
_MOST_STATES_COMPARED = 500


def _motion(store: Store, run: str, model: mujoco.MjModel) -> Row:
    """Return the motion of a run at about 500 times, the same in all runs with as many steps."""
    ranges, limited, record = np.ones(model.nq), model.jnt_limited == 1, store.record(run)
    ranges[model.jnt_qposadr[limited]] = np.ptp(model.jnt_range[limited], axis=1)
    qpos = store.trace(record).qpos if record.trace else np.zeros((0, model.nq))
    return {MOTION: qpos[:: max(1, len(qpos) // _MOST_STATES_COMPARED)] / ranges}


_PAIRS = 6  # matched pairs that are timed; their range contains the median in 97 of 100 cases


@dataclass
class ConfigurationRunner:
    """Runs configurations; each set of them has its own store."""

    setup: AblationSetup  # the base configuration, scenarios and seeds
    toggles: Mapping[str, Toggle]
    session: Session
    rounds: int | None  # of a timing pass; None for no timing
    stores: list[str] = field(default_factory=list[str])  # names of the stores written

    def run(
        self,
        name: str,
        description: str,
        configurations: Sequence[Changed],
        setup: AblationSetup | None = None,
        *,
        timed: bool = False,
    ) -> dict[Changed, ConfigurationRows]:
        """Run configurations, with another setup if given; if timed, interleaved."""
        setup = setup or self.setup
        moved = not (setup.tolerances or timed)
        asked = {
            "description": description,
            "tolerances": dict(setup.tolerances),
            "timing": {"rounds": self.rounds} if timed and self.rounds else None,
            "trace": "all" if moved else "none",
        }
        values = [
            {
                name: value
                for effect in changed
                for name, value in self.toggles[effect].values.items()
            }
            for changed in configurations
        ]
        measure = {"measure": _motion} if moved else {}
        found = run_configurations(self.session, setup, name, values, asked, **measure)
        self.stores.append(name)
        return dict(zip(configurations, found, strict=True))

    def timed(
        self, name: str, configurations: Sequence[Changed], seeds: Sequence[int] = ()
    ) -> dict[Changed, ConfigurationRows]:
        """Time configurations, interleaved, in at most six matched pairs of each with the base."""
        if self.rounds is None:
            return dict.fromkeys(configurations, ConfigurationRows((), ()))
        scenarios = self.setup.scenarios
        scenarios = scenarios[:: max(1, len(scenarios) // _PAIRS)][:_PAIRS]
        seeds = tuple(seeds or self.setup.seeds)[: max(1, _PAIRS // len(scenarios))]
        setup = replace(self.setup, seeds=seeds, scenarios=scenarios)
        return self.run(name, "Configurations timed in turns", configurations, setup, timed=True)


_SHARE = 0.01
# Smallest relevant change of the mean distance from recordings: as a share, and in standard errors.
_CLOSER, _ERRORS = 0.05, 3
# Quantities that cannot be measured with or without an effect: energies that are not recorded, and
# distances of speculative contacts, which are not depths.
_UNMEASURED: Mapping[str, Requirement] = {"energy": "energy", "speculative": "depth"}


def judged_metrics(changed: Collection[str] = ()) -> list[str]:
    """Return the metrics of the physics; all others count work, or explain one of these.

    Metrics that cannot be measured with or without a changed effect are excluded.
    """
    missing = {_UNMEASURED[effect] for effect in changed if effect in _UNMEASURED}
    physics = [metric for metric in METRICS.values() if metric.kind == "physics"]
    return [effect.name for effect in physics if effect.requires not in missing]


@dataclass(frozen=True)
class ConfigurationDifference:
    """The difference between matched pairs of runs of two configurations."""

    # The change of every metric, in the scenario where it is largest; largest first.
    metric_changes: tuple[MetricChange, ...]
    # Changes to labels that the base has with no seed, by runs.
    labels: Mapping[str, int]

    @property
    def is_significant(self) -> bool:
        """Whether any change exceeds both tolerance and spread."""
        return bool(self.labels) or any(change.significant for change in self.metric_changes)

    @property
    def within_spread(self) -> tuple[str, ...]:
        """Metrics that change by more than the tolerance, but less than the spread over seeds."""
        return tuple(
            change.metric
            for change in self.metric_changes
            if change.change is not None and change.tolerance < abs(change.change) <= change.spread
        )

    @property
    def reason(self) -> str:
        """The largest change, as text."""
        if self.labels:
            return ", ".join(self.labels)
        if worst := next((change for change in self.metric_changes if change.significant), None):
            return _change_text(worst)
        if [change.metric for change in self.metric_changes] == [REALITY]:
            return _change_text(self.metric_changes[0])
        for change in self.metric_changes:
            if change.metric in self.within_spread:
                return (
                    f"{change.metric} changes by {change.change:.3g} {change.unit}, within the "
                    f"spread of {change.spread:.3g} over seeds"
                )
        return "no metric changes by its tolerance"


def difference(
    tolerances: Mapping[str, float],
    base: ConfigurationRows,
    other: ConfigurationRows,
    changed: Changed = BASE,
    *,
    matters: Literal["if unsure", "if closer", "if farther"] = "if unsure",
) -> ConfigurationDifference:
    """Return the difference that changed effects make, over scenarios and seeds.

    If only `reality` has a tolerance, its mean over recorded runs counts. `matters` says when it is
    significant: if runs get closer to recordings, if they get farther away, or unless they surely
    do not.
    """
    if real := {*tolerances} == {REALITY}:
        base, other = _compared(base), _compared(other)
    matched = list(zip(base.scenarios, base.rows, other.rows, strict=True))
    largest = [
        max((_change(name, tolerances, *rows) for rows in matched), key=_weight)
        for name in tolerances or (*judged_metrics(changed), *({MOTION} & base.flat[0].keys()))
    ]
    for change in largest if real else ():
        farther, limit = change.change or 0.0, max(change.tolerance, change.spread)
        sure = {"if closer": -farther > limit, "if farther": farther > limit}
        told = sure.get(matters, farther + change.spread > change.tolerance)
        largest = [change.model_copy(update={"significant": told})]
    changes = sorted(
        (change for change in largest if _weight(change)[1]), key=_weight, reverse=True
    )
    labels: Counter[str] = Counter()
    for _, first, second in matched:
        known = {row["label"] for row in first}
        labels.update(
            f"{one['label']} -> {two['label']}"
            for one, two in zip(first, second, strict=True)
            if two["label"] not in known
        )
    return ConfigurationDifference(tuple(changes), dict(labels))


def _compared(configuration: ConfigurationRows) -> ConfigurationRows:
    """Return the mean distance from the recordings in each scenario, as rows of one."""
    rows = [[row[REALITY] for row in rows_of_case] for rows_of_case in configuration.rows]
    means = [None if None in row else fmean(row) for row in rows]
    words = ["ends early" if mean is None else "compared" for mean in means]
    pairs = zip(means, words, strict=True)
    return ConfigurationRows([{}], [[{REALITY: mean, "label": word} for mean, word in pairs]])


def _weight(change: MetricChange) -> tuple[bool, float]:
    return (
        change.significant,
        inf if change.ratio_to_tolerance is None else change.ratio_to_tolerance,
    )


def _change(
    name: str,
    given: Mapping[str, float],
    scenario: Values,
    base: Sequence[Row],
    other: Sequence[Row],
) -> MetricChange:
    """Compare a metric in one scenario; differences within its spread over seeds are ignored."""
    own = [row[name] for row in base if row[name] is not None]
    pairs = [
        _difference(second[name], first[name])
        for first, second in zip(base, other, strict=True)
        if first[name] is not None and second[name] is not None
    ]
    tolerance = given.get(name, _SHARE)
    if real := {*given} == {REALITY}:
        tolerance = tolerance or _CLOSER * fmean(own or [0.0])
    elif name not in given and name != MOTION:
        tolerance = max(METRICS[name].tolerance, _SHARE * max(map(abs, own), default=0.0))
    alike = () if name == MOTION and any(map(_is_drawn, base)) else combinations(own, 2)
    spread = max((abs(_difference(*pair)) for pair in alike), default=0.0)
    if real:
        spread = _ERRORS * stdev(pairs) / len(pairs) ** 0.5 if len(pairs) > 1 else inf
    # measured in all runs of one configuration and in none of the other
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
        ratio_to_tolerance=None
        if appears or (size and not tolerance)
        else size / (tolerance or 1.0),
        spread=spread,
        scenario={key: axis_cell(value) for key, value in scenario.items()},
        significant=size > tolerance and size > spread,
    )


def _is_drawn(row: Row) -> bool:
    """Return whether the seed draws a run's controls, so that motions differ by seed."""
    drive = parse_drive(json.loads(row.get("drive") or '"none"'))
    return drive == "exercise" or isinstance(drive, NoiseDrive)


def _difference(value: Any, other: Any) -> float:  # noqa: ANN401 - a number or an array
    """Return the difference of two numbers, or the largest difference of two motions."""
    if not isinstance(value, np.ndarray):
        return value - other
    steps = min(len(value), len(other))
    return float(np.nan_to_num(np.abs(value[:steps] - other[:steps])).max(initial=0.0))


def _change_text(change: MetricChange) -> str:
    if change.change is None:
        return f"{change.metric} can be measured in one of the configurations only"
    if change.metric == REALITY:
        return f"{REALITY} {change.change:+.3g}, give or take {change.spread:.2g}"
    unit = "" if change.unit in {"1", "any"} else f" {change.unit}"
    where = ", ".join(f"{name} {value}" for name, value in change.scenario.items())
    return (
        f"{change.metric} {change.change:+.3g}{unit}, {change.ratio_to_tolerance:.3g} tolerances"
        f"{f' at {where}' if where else ''}"
    )


_WORK = ("work_iterations", "work_contacts", "work_rows")


def cost_ratio(base: ConfigurationRows, other: ConfigurationRows) -> TimeRatio | None:
    """Return the ratio of CPU times; None without any timed pair."""
    ratios = list(_ratios(base, other, "time_min"))
    return TimeRatio.of_pairs(ratios) if ratios else None


def work_ratios(base: ConfigurationRows, other: ConfigurationRows) -> dict[str, float]:
    """Return the ratio of each work counter that the base has."""
    ratios = {name: list(_ratios(base, other, name)) for name in _WORK}
    return {name: median(ratio) for name, ratio in ratios.items() if ratio}


def _ratios(base: ConfigurationRows, other: ConfigurationRows, name: str) -> Iterator[float]:
    for first, second in zip(base.flat, other.flat, strict=True):
        below, above = first.get(name), second.get(name)
        if below and above is not None and isfinite(above / below):
            yield above / below
