"""Methods: all knobs but the timestep, each with its order of convergence and its floor."""

from collections.abc import Mapping, Sequence

import numpy as np

from contactlab.schema import Floor, Method, Order, Setting
from contactlab.tradeoff.configurations import Weighed
from contactlab.tradeoff.convergence import Steps, find_floor, none, order

Key = tuple[tuple[str, Setting], ...]

TIMESTEP = "timestep"
_NUMERICS = {
    *("integrator", "solver", "jacobian", "iterations", "tolerance"),
    *("ls_iterations", "ls_tolerance"),
}
# What did not go through says nothing of how an error falls.
LOST = {"crashed", "timeout", "invalid", "diverged"}


def methods(found: Sequence[Weighed], *, is_modelling: bool) -> list[Method]:
    """Return the methods, in the order of their first configuration.

    Args:
        found: the configurations.
        is_modelling: whether the error is held against something else than the model itself, so
            that it may have a floor.
    """
    members: dict[Key, list[Weighed]] = {}
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


def method_key(values: dict[str, Setting]) -> Key:
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
    members: Sequence[Weighed],
    floor: Floor | None,
    known: float,
) -> Method:
    return Method(
        name=method_name(values, differing),
        configuration=values,
        order=_order(members, known),
        floor=floor,
    )


def _order(members: Sequence[Weighed], floor: float) -> Order:
    impacts = max(each.impacts for each in members)
    if impacts:
        return none(f"up to {impacts:.0f} impacts a run, and where in a step one falls is chance")
    return order(_steps(members), floor)


def _least_floors(floors: Mapping[Key, Floor | None]) -> dict[Key, float]:
    """Return the least floor of all methods with the same physics, 0 where none was found.

    Integrators and solvers differ in how they get to an answer; where the timestep goes to zero,
    it is the same.
    """
    found: dict[Key, float] = {}
    for key, floor in floors.items():
        if floor is not None:
            found[_physics(key)] = min(floor.error, found.get(_physics(key), np.inf))
    return {key: found.get(_physics(key), 0.0) for key in floors}


def _physics(key: Key) -> Key:
    return tuple(pair for pair in key if pair[0] not in _NUMERICS)


def _steps(members: Sequence[Weighed]) -> Steps:
    """Return the timesteps that went through with the contact that was asked for."""
    points = sorted(
        (float(step), each.summary.error, each.estimate)
        for each in members
        if isinstance(step := each.group.values.get(TIMESTEP), int | float)
        and each.summary.error
        and not LOST & each.failures.keys()
        and not each.summary.solref_clamped
    )
    table = np.array(points, dtype=np.float64).reshape(-1, 3)
    return Steps(timestep=table[:, 0], error=table[:, 1], hidden=table[:, 2])
