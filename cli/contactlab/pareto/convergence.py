"""Methods, that is, all knobs except the timestep: their orders of convergence and floors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.measure import LABELS
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.pareto.configurations import EvaluatedConfiguration
from contactlab.pareto.recommendation import setting_text
from contactlab.schema.evidence import Setting
from contactlab.schema.tradeoff_report import Floor, Method, Order


@dataclass(frozen=True)
class ConvergenceRules:
    """The errors of timesteps that show an order or a floor.

    Attributes:
        min_timesteps: of a line.
        clear_ratio: an error this many times the uncertainty of its reference is wrong by at most
            a third.
        worst_standard_error: of a slope, which may be wrong by twice this, so that whole orders are
            clearly distinguishable.
        least_slope: of an error that falls with the timestep.
        flat_ratio: of the errors of a floor.
        flat_span: of its timesteps.
    """

    min_timesteps: int = 3
    clear_ratio: float = 3.0
    worst_standard_error: float = 0.1
    least_slope: float = 0.25
    flat_ratio: float = 1.5
    flat_span: float = 4.0


RULES = ConvergenceRules()


class TimestepErrors(NamedTuple):
    """The errors of one method at n timesteps, the finest first."""

    timestep: Floats  # (n,) distinct [s]
    error: Floats  # (n,) positive
    uncertainty: Floats  # (n,) of the reference, in the error's unit; 0 without one


def convergence_order(steps: TimestepErrors, floor: float = 0.0) -> Order:
    """Return the order of convergence.

    A line through log error over log timestep is fitted to the widest range, from the finest clear
    step up, with a standard error of the slope of at most 0.1. Coarser steps lie outside of the
    asymptotic range. A step is clear if its error exceeds three times the uncertainty of the
    reference, and three times the floor, which remains at any timestep; 0 if none is known.
    """
    clear = steps.error > RULES.clear_ratio * np.maximum(steps.uncertainty, floor)
    timestep, error = np.log(steps.timestep[clear]), np.log(steps.error[clear])
    if len(timestep) < RULES.min_timesteps:
        usable_count = len(timestep)
        if not floor and not steps.uncertainty.any():
            return no_order(f"{usable_count} timesteps, but a line needs {RULES.min_timesteps}")
        threshold = "the floor" if floor else "the reference's own error"
        return no_order(
            f"{usable_count} of at least {RULES.min_timesteps} timesteps have an error above three "
            "times "
            f"{threshold}"
        )
    for count in range(len(timestep), RULES.min_timesteps - 1, -1):
        slope, standard_error = _fit_line(timestep[:count], error[:count])
        if standard_error <= RULES.worst_standard_error and slope < RULES.least_slope:
            return no_order(f"the error does not fall with the timestep (slope {slope:.2g})")
        if standard_error <= RULES.worst_standard_error:
            return Order(slope=slope, standard_error=standard_error, points=count, reason=None)
    return no_order("the errors of the finest timesteps do not lie on a line")


def no_order(reason: str) -> Order:
    """Return an order without a slope, with the reason."""
    return Order(slope=None, standard_error=None, points=0, reason=reason)


def find_floor(steps: TimestepErrors) -> Floor | None:
    """Return the error that no longer falls with the timestep, or None.

    It is the median over the widest range, from the finest step up, of at least three steps that
    span a factor of four and have errors within a factor of 1.5. An error of order 1/2 would change
    by 2 over that span, one of order 1 by 4.
    """
    floor = None
    for count in range(RULES.min_timesteps, len(steps.timestep) + 1):
        timestep, error = steps.timestep[:count], steps.error[:count]
        if error.max() > RULES.flat_ratio * error.min():
            break
        # The span is compared with a little room, since timesteps such as 1e-3 / 4 are rounded.
        if timestep[-1] >= RULES.flat_span * timestep[0] * (1 - SUM_ROUNDING):
            floor = Floor(error=float(np.median(error)), points=count, timestep=float(timestep[-1]))
    return floor


def _fit_line(x: Floats, y: Floats) -> tuple[float, float]:
    """Return the slope of the least-squares line through (n,) points, and its standard error."""
    across = x - x.mean()
    spread = float(across @ across)
    slope = float(across @ y) / spread
    residual = y - y.mean() - slope * across
    return slope, float(np.sqrt(residual @ residual / (len(x) - 2) / spread))


MethodKey = tuple[tuple[str, Setting], ...]

TIMESTEP = "timestep"
_NUMERIC_KNOBS = {
    *("integrator", "solver", "jacobian", "iterations", "tolerance"),
    *("ls_iterations", "ls_tolerance"),
}


def find_methods(
    evaluated: Sequence[EvaluatedConfiguration],
    units: Mapping[str, str],
    swept: Sequence[str] = (),
    *,
    is_modeling: bool,
) -> list[Method]:
    """Return the methods, in the order of their first configurations.

    A single one is named by the `swept` knobs, which may have one value here.
    They may have a floor if the error has another reference than the model: if `is_modelling`.
    """
    members: dict[MethodKey, list[EvaluatedConfiguration]] = {}
    for configuration in evaluated:
        members.setdefault(method_key(configuration.values), []).append(configuration)
    differing = varying_knobs([dict(key) for key in members]) or swept_methods(swept)
    floors: dict[MethodKey, Floor | None] = dict.fromkeys(members)
    # Methods that differ only in integrator or solver converge to the same solution, and share
    # the smallest floor of any of them.
    least: dict[MethodKey, float] = {}
    for key, family in members.items() if is_modeling else ():
        floors[key] = floor = find_floor(_timestep_errors(family))
        if floor is not None:
            least[_physics_key(key)] = min(floor.error, least.get(_physics_key(key), np.inf))
    return [
        Method(
            name=method_name(dict(key), differing, units),
            configuration=dict(key),
            order=_method_order(family, least.get(_physics_key(key), 0.0)),
            floor=floors[key],
        )
        for key, family in members.items()
    ]


def method_key(values: dict[str, Setting]) -> MethodKey:
    """Return the identity of a configuration's method: every knob except the timestep."""
    return tuple((name, value) for name, value in values.items() if name != TIMESTEP)


def method_name(
    values: Mapping[str, Setting], differing: Sequence[str], units: Mapping[str, str]
) -> str:
    """Return a method in words: the values of varying knobs, with the axis for a number.

    Knobs that an included row does not set keep the scene's value, and are omitted.
    """
    words = [
        _knob_word(name, values[name], units.get(name, ""))
        for name in differing
        if values[name] is not None
    ]
    return ", ".join(words) or "as the scene has it"


def swept_methods(swept: Sequence[str]) -> list[str]:
    """Return the swept knobs that a method has."""
    return [name for name in swept if name != TIMESTEP]


def _knob_word(name: str, value: Setting, unit: str) -> str:
    if isinstance(value, str) and not value[:1].isdigit() and not value.startswith("-"):
        return value
    return f"{name} {setting_text(value, unit)}"


def varying_knobs(keys: Sequence[Mapping[str, Setting]]) -> list[str]:
    """Return the knobs that differ between methods."""
    return [name for name in keys[0] if len({key[name] for key in keys}) > 1] if keys else []


def _method_order(members: Sequence[EvaluatedConfiguration], floor: float) -> Order:
    impacts = max(member.impacts for member in members)
    if impacts:
        most = "one impact" if impacts == 1 else f"up to {impacts:.0f} impacts"
        return no_order(f"a run has {most}, at a chance place within a step")
    return convergence_order(_timestep_errors(members), floor)


def _physics_key(key: MethodKey) -> MethodKey:
    return tuple(pair for pair in key if pair[0] not in _NUMERIC_KNOBS)


def _timestep_errors(members: Sequence[EvaluatedConfiguration]) -> TimestepErrors:
    """Return the timesteps with completed runs, without a raised time constant."""
    # The errors of meaningless runs show no convergence.
    voided = {label.name for label in LABELS.values() if label.voids}
    points = sorted(
        (float(step), member.summary.error, member.estimate)
        for member in members
        if isinstance(step := member.values.get(TIMESTEP), int | float)
        and member.summary.error
        and not voided & member.failures.keys()
        and not member.summary.solref_clamped
    )
    return TimestepErrors(*np.array(points, dtype=np.float64).reshape(-1, 3).T)
