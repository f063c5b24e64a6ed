"""How an error falls with the timestep: its order, and the floor that it does not fall below."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from contactlab.contact import Floats
from contactlab.measure import LABELS
from contactlab.schema import Floor, Method, Order, Setting
from contactlab.tradeoff.configurations import Evaluated

FEWEST = 3
# An error this many times what hides it is off by a third at most, from one side.
CLEAR = 3.0
# Twice this is how far a slope may be off: whole orders are told apart with room to spare.
WORST_STANDARD_ERROR = 0.1
LEAST_SLOPE = 0.25
FLAT = 1.5
FLAT_SPAN = 4.0


@dataclass(frozen=True)
class TimestepErrors:
    """What one method makes of n timesteps, the finest first.

    Attributes:
        timestep: (n,) distinct [s].
        error: (n,) positive.
        hidden: (n,) what of an error may not be its own: the reference's estimate, or 0.
    """

    timestep: Floats
    error: Floats
    hidden: Floats


def order(steps: TimestepErrors, floor: float = 0.0) -> Order:
    """Return the order of convergence.

    A line through log error over log timestep is fitted to the widest range, from the finest clear
    step up, over which its slope has a standard error of at most 0.1; coarser steps are beyond
    where the order shows. A step is clear if its error is three times the reference's estimate, and
    three times the floor.

    Args:
        steps: the timesteps that went through, and whose contact is not clamped.
        floor: the error that no timestep removes; 0 if none is known.
    """
    hidden = np.maximum(steps.hidden, floor)
    clear = steps.error > CLEAR * hidden
    timestep, error = np.log(steps.timestep[clear]), np.log(steps.error[clear])
    if len(timestep) < FEWEST:
        return none(_too_few(len(timestep), steps, floor))
    for count in range(len(timestep), FEWEST - 1, -1):
        slope, standard_error = _line(timestep[:count], error[:count])
        if standard_error <= WORST_STANDARD_ERROR:
            return _judged(slope, standard_error, count)
    return none("the errors of the finest timesteps do not lie on a line")


def none(reason: str) -> Order:
    """Return that there is no order, and why."""
    return Order(slope=None, standard_error=None, points=0, reason=reason)


def find_floor(steps: TimestepErrors) -> Floor | None:
    """Return the error that no longer falls with the timestep, or None.

    It is the median over the widest range, from the finest step up, of at least three steps that
    span a factor of four and whose errors stay within a factor of 1.5. An error of order 1/2 would
    change by 2 over that span, one of order 1 by 4.
    """
    found = None
    for count in range(FEWEST, len(steps.timestep) + 1):
        timestep, error = steps.timestep[:count], steps.error[:count]
        if error.max() > FLAT * error.min():
            break
        # The span is compared with a little room, since timesteps such as 1e-3 / 4 are rounded.
        if timestep[-1] >= FLAT_SPAN * timestep[0] * (1 - 1e-9):
            found = Floor(error=float(np.median(error)), points=count, timestep=float(timestep[-1]))
    return found


def _too_few(clear: int, steps: TimestepErrors, floor: float) -> str:
    if not floor and not steps.hidden.any():
        return f"{clear} timesteps, and a line takes {FEWEST}"
    what = "the floor" if floor else "the reference's own error"
    return f"{clear} of {FEWEST} or more timesteps have an error above three times {what}"


def _judged(slope: float, standard_error: float, count: int) -> Order:
    if slope < LEAST_SLOPE:
        return none(f"the error does not fall with the timestep (slope {slope:.2g})")
    return Order(slope=slope, standard_error=standard_error, points=count, reason=None)


def _line(x: Floats, y: Floats) -> tuple[float, float]:
    """Return the slope of the least-squares line through (n,) points, and its standard error."""
    across = x - x.mean()
    spread = float(across @ across)
    slope = float(across @ y) / spread
    residual = y - y.mean() - slope * across
    return slope, float(np.sqrt(residual @ residual / (len(x) - 2) / spread))


MethodKey = tuple[tuple[str, Setting], ...]

TIMESTEP = "timestep"
_NUMERICS = {
    *("integrator", "solver", "jacobian", "iterations", "tolerance"),
    *("ls_iterations", "ls_tolerance"),
}


def methods(found: Sequence[Evaluated], *, is_modelling: bool) -> list[Method]:
    """Return the methods, in the order of their first configuration.

    Args:
        found: the configurations.
        is_modelling: whether the error is held against something else than the model itself, so
            that it may have a floor.
    """
    members: dict[MethodKey, list[Evaluated]] = {}
    for each in found:
        members.setdefault(method_key(each.group.values), []).append(each)
    differing = varying([dict(key) for key in members])
    floors = {
        key: find_floor(_steps(each)) if is_modelling else None for key, each in members.items()
    }
    known = _least_floors(floors)
    return [
        _method(dict(key), differing, each, floors[key], known[key])
        for key, each in members.items()
    ]


def method_key(values: dict[str, Setting]) -> MethodKey:
    """Return what tells the method of a configuration from others."""
    return tuple((name, value) for name, value in values.items() if name != TIMESTEP)


def method_name(values: Mapping[str, Setting], differing: Sequence[str]) -> str:
    """Return a method in words: the values of what varies, with the axis where it is a number.

    What is not swept in a row that a sweep includes is as the scene has it, and goes unsaid.
    """
    words = [_word(name, values[name]) for name in differing if values[name] is not None]
    return ", ".join(words) or "as the scene has it"


def _word(name: str, value: Setting) -> str:
    if isinstance(value, str) and not value[:1].isdigit() and not value.startswith("-"):
        return value
    return f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"


def varying(keys: Sequence[Mapping[str, Setting]]) -> list[str]:
    """Return the knobs that differ between methods."""
    return [name for name in keys[0] if len({key[name] for key in keys}) > 1] if keys else []


def _method(
    values: dict[str, Setting],
    differing: Sequence[str],
    members: Sequence[Evaluated],
    floor: Floor | None,
    known: float,
) -> Method:
    return Method(
        name=method_name(values, differing),
        configuration=values,
        order=_order(members, known),
        floor=floor,
    )


def _order(members: Sequence[Evaluated], floor: float) -> Order:
    impacts = max(each.impacts for each in members)
    if impacts:
        return none(f"up to {impacts:.0f} impacts a run, and where in a step one falls is chance")
    return order(_steps(members), floor)


def _least_floors(floors: Mapping[MethodKey, Floor | None]) -> dict[MethodKey, float]:
    """Return the least floor of all methods with the same physics, 0 where none was found.

    Integrators and solvers differ in how they get to an answer; where the timestep goes to zero,
    it is the same.
    """
    found: dict[MethodKey, float] = {}
    for key, floor in floors.items():
        if floor is not None:
            found[_physics(key)] = min(floor.error, found.get(_physics(key), np.inf))
    return {key: found.get(_physics(key), 0.0) for key in floors}


def _physics(key: MethodKey) -> MethodKey:
    return tuple(pair for pair in key if pair[0] not in _NUMERICS)


def _steps(members: Sequence[Evaluated]) -> TimestepErrors:
    """Return the timesteps that went through with the contact that was asked for."""
    # Runs that mean nothing tell nothing of how an error falls.
    voided = {each.name for each in LABELS.values() if each.voids}
    points = sorted(
        (float(step), each.summary.error, each.estimate)
        for each in members
        if isinstance(step := each.group.values.get(TIMESTEP), int | float)
        and each.summary.error
        and not voided & each.failures.keys()
        and not each.summary.solref_clamped
    )
    table = np.array(points, dtype=np.float64).reshape(-1, 3)
    return TimestepErrors(timestep=table[:, 0], error=table[:, 1], hidden=table[:, 2])
