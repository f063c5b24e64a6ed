"""Pareto fronts of time and error, and the recommended configuration, also in sentences."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.mjcf import MODEL_ENGINE
from contactlab.pareto.configurations import EvaluatedConfiguration
from contactlab.rendering.amounts import format_amount, format_setting
from contactlab.schema.evidence import Setting
from contactlab.schema.time_ratio import BUILD_NOISE
from contactlab.schema.tradeoff_report import Configuration, Settings, TradeoffReport


def pareto_front(time: Floats, error: Floats) -> list[int]:
    """Return the indices of the Pareto front of points, time (n,) and error (n,), cheapest first.

    A point dominates another if it is no worse in both, and better in one; equal points do not
    dominate each other. A point with NaN as time or error is on no front.
    """
    measured_places = np.flatnonzero(np.isfinite(time) & np.isfinite(error))
    order = measured_places[np.lexsort((error[measured_places], time[measured_places]))]
    front: list[int] = []
    for index in order:
        last = front[-1] if front else None
        is_better = last is None or error[index] < error[last]
        if is_better or (error[index] == error[last] and time[index] == time[last]):
            front.append(int(index))
    return front


EQUALLY_FAST = 1 + BUILD_NOISE
"""Two timing passes of one build agree within this ratio, on an idle machine."""

MORE_ACCURATE = 1.05  # a configuration counts as more accurate from this ratio of errors

SAFE_MARGIN = 1.25  # margin of every tolerance that the robust recommendation keeps


def equally_fast(
    evaluated: Sequence[EvaluatedConfiguration],
    least_margin: float = 0.0,
    baseline: Settings | None = None,
) -> list[EvaluatedConfiguration]:
    """Return the feasible configurations that are as fast as the fastest of them, within noise.

    They are within 5 % of the smallest time, and keep a least margin to every tolerance. The most
    accurate comes first, and equally accurate ones in the order of the plan, so that noise of the
    times decides nothing. With a baseline, those within 5 % of the most accurate count as equally
    accurate, and the one with most of its values comes first.
    """
    feasible = [
        (configuration.summary.time, configuration)
        for configuration in evaluated
        if configuration.summary.feasible
        and configuration.summary.time is not None
        and all(m is None or m >= least_margin for m in configuration.summary.margins.values())
    ]
    limit = EQUALLY_FAST * min((time for time, _ in feasible), default=0.0)
    near = sorted(
        (configuration for time, configuration in feasible if time <= limit), key=_known_error
    )
    if baseline is None or not near:
        return near
    same = MORE_ACCURATE * _known_error(near[0])

    def preference(configuration: EvaluatedConfiguration) -> tuple[bool, int]:
        changed = sum(configuration.values[name] != value for name, value in baseline.items())
        return (True, 0) if _known_error(configuration) > same else (False, changed)

    return sorted(near, key=preference)


def recommendable_places(configurations: Sequence[Configuration]) -> list[int]:
    """Return the configurations of the engine for models that end as the most accurate ones do.

    If none names an engine, those of any.
    """
    engines = [configuration.configuration.get("engine") for configuration in configurations]
    own = [place for place, engine in enumerate(engines) if engine == MODEL_ENGINE]
    places = own or [*range(len(engines))]
    return [place for place in places if not configurations[place].ends_elsewhere]


def feasible_front(evaluated: Sequence[EvaluatedConfiguration]) -> list[EvaluatedConfiguration]:
    """Return the Pareto front of the feasible configurations, the cheapest first."""
    feasible = [configuration for configuration in evaluated if configuration.summary.feasible]
    return [
        feasible[index] for index in front_of([configuration.summary for configuration in feasible])
    ]


def front_of(configurations: Sequence[Configuration]) -> list[int]:
    """Return the indices of the Pareto front of some configurations, the cheapest first."""
    points = np.array(
        [(configuration.time, configuration.error) for configuration in configurations],
        dtype=np.float64,
    )
    return pareto_front(*points.reshape(-1, 2).T)


def next_more_accurate(
    front: Sequence[EvaluatedConfiguration], chosen: EvaluatedConfiguration
) -> EvaluatedConfiguration | None:
    """Return the cheapest on a front with an error smaller by a factor of at least 1.05."""
    limit = _known_error(chosen) / MORE_ACCURATE
    return next(
        (configuration for configuration in front if _known_error(configuration) < limit), None
    )


def _known_error(configuration: EvaluatedConfiguration) -> float:
    return np.inf if configuration.summary.error is None else configuration.summary.error


def settings_text(values: Settings, names: Iterable[str], units: Mapping[str, str]) -> str:
    """Return some settings with their units, as `timestep 1 ms, cone elliptic`."""
    texts = {name: setting_text(values[name], units.get(name, "")) for name in names}
    return ", ".join(f"{name} {text}" for name, text in texts.items())


def setting_text(value: Setting, unit: str = "") -> str:
    """Return the value of a setting in words; below 1 s or 1 m in ms or mm."""
    if value is None:
        return "as in the scene"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str | tuple):
        return format_setting(value)
    small_units = {"s": "ms", "m": "mm"}
    shown_unit = small_units.get(unit, unit) if abs(value) < 1 else unit
    return format_amount(value, shown_unit, digits=6)


def robust_text(report: TradeoffReport) -> str:
    """Return the cost of a margin to every tolerance; empty without tolerances."""
    if not report.tolerances or report.recommendation is None:
        return ""
    if report.robust is None:
        return f"No configuration has all margins at least {SAFE_MARGIN}."
    if report.robust.run_id == report.recommendation.run_id:
        return f"Every tolerance is at least {SAFE_MARGIN} times the worst value."
    ratio = report.robust.time / report.recommendation.time
    values = _varying_text(report, report.robust.configuration)
    return f"All margins at least {SAFE_MARGIN} cost x{ratio:.3g} time: {values}."


def next_step_text(report: TradeoffReport) -> str:
    """Return the gain of more time; empty if no feasible configuration is more accurate."""
    after = report.next_step
    if after is None:
        return ""
    gain = "no error" if after.error_ratio is None else f"{after.error_ratio:.3g}x less error"
    values = _varying_text(report, after.configuration)
    return f"x{after.time_ratio:.3g} time gives {gain}: {values}."


def _varying_text(report: TradeoffReport, values: Settings) -> str:
    return settings_text(values, report.varying, report.units) or "as in the sweep"
