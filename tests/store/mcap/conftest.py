"""The messages that a trace file should hold, by an obvious loop."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from contactlab.contact.trace_arrays import (
    ANGULAR_VELOCITY,
    DISTANCE,
    FORCE,
    FOUND,
    LINEAR_VELOCITY,
    NORMAL,
    POSITION,
    TANGENT,
    TORQUE,
    PairSeries,
    Trace,
)

MODES = ("NO_CONTACT", "STICK", "SLIDE")


def messages_of(
    trace: Trace, run: int, series: list[PairSeries]
) -> Iterator[tuple[str, int, dict[str, Any]]]:
    """Yield (pair or /state, log time in ns, fields by name), in the order of the file."""
    for row in range(trace.steps + 1):
        time = round(trace.time[run, row] * 1e9)
        yield "/state", time, _state(trace, run, row)
        if row < trace.steps:
            for pair, net in zip(trace.pairs, series, strict=True):
                slots = [slot for slot in pair.slots[run, row] if slot[FOUND] > 0]
                if slots:
                    timestep = trace.timestep[run]
                    yield pair.name, time, _contacts(net, run, row, timestep, slots)


def _state(trace: Trace, run: int, row: int) -> dict[str, Any]:
    state: dict[str, Any] = {
        "time": trace.time[run, row],
        "qpos": list(trace.qpos[run, row]),
        "qvel": list(trace.qvel[run, row]),
    }
    if row < trace.steps:
        state["step"] = {
            "kinetic_energy": trace.kinetic[run, row],
            "potential_energy": trace.potential[run, row],
            "contacts": trace.contacts[run, row],
            "least_distance": trace.least_distance[run, row],
            "solver_iterations": trace.iterations[run, row],
            "solver_iterations_most": trace.iterations_most[run, row],
            "linear_momentum": [] if trace.momentum is None else list(trace.momentum[run, row]),
            "angular_momentum": []
            if trace.angular_momentum is None
            else list(trace.angular_momentum[run, row]),
        }
    return state


def _contacts(
    net: PairSeries, run: int, row: int, timestep: float, slots: list[Any]
) -> dict[str, Any]:
    return {
        "count": len(slots),
        "found": slots[0][FOUND],
        "mode": MODES[net.mode[run, row]],
        "normal_force": net.normal[run, row],
        "tangential_force": net.tangential[run, row],
        "friction_usage": net.usage[run, row],
        "normal_impulse": net.normal[run, row] * timestep,
        "tangential_impulse": net.tangential[run, row] * timestep,
        "slip_speed": net.slip[run, row],
        "distance": net.distance[run, row],
        "penetration": max(0.0 - net.distance[run, row], 0.0),
        "points": [
            {
                "position": list(slot[POSITION]),
                "normal": list(slot[NORMAL]),
                "tangent": list(slot[TANGENT]),
                "distance": slot[DISTANCE],
                "force": list(slot[FORCE]),
                "torque": list(slot[TORQUE]),
                "linear_velocity": list(slot[LINEAR_VELOCITY]),
                "angular_velocity": list(slot[ANGULAR_VELOCITY]),
            }
            for slot in map(single, slots)
        ],
    }


def single(values: np.ndarray[Any, Any]) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Return numbers as contact points hold them, rounded to single precision."""
    with np.errstate(over="ignore"):
        return values.astype(np.float32)


def exact(value: Any) -> Any:
    """Return a value with each number as hex digits, so that == compares bits; NaNs are equal."""
    if isinstance(value, dict):
        return {name: exact(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [exact(each) for each in value]
    return value if isinstance(value, str) or value is None else float(value).hex()


@pytest.fixture(scope="session")
def expected_messages() -> Callable[..., Iterator[tuple[str, int, dict[str, Any]]]]:
    return messages_of


@pytest.fixture(scope="session")
def exactly() -> Callable[[Any], Any]:
    return exact
