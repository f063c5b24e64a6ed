"""Random traces of any size, and what a file of them should say, by an obvious loop."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from contactlab.contact import (
    ANGULAR_VELOCITY,
    DISTANCE,
    FORCE,
    FOUND,
    LINEAR_VELOCITY,
    NORMAL,
    POSITION,
    SLOT_WIDTH,
    TANGENT,
    TORQUE,
    PairSeries,
    PairTrace,
    Trace,
)
from contactlab.store.mcap import TraceExtras

SPECIALS = (np.nan, np.inf, -np.inf, 0.0, -0.0, 5e-324, 1.7976931348623157e308)
MODES = ("NO_CONTACT", "STICK", "SLIDE")


class Sampler:
    """Random arrays, a tenth of whose numbers are the awkward ones."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def floats(self, *shape: int) -> np.ndarray[Any, np.dtype[np.float64]]:
        values = self.rng.standard_normal(shape) * 10.0 ** self.rng.integers(-9, 9, shape)
        awkward = self.rng.random(shape) < 0.1
        return np.where(awkward, self.rng.choice(SPECIALS, shape), values)

    def counts(self, *shape: int) -> np.ndarray[Any, np.dtype[np.int32]]:
        return self.rng.integers(0, 1000, shape).astype(np.int32)

    def time(self, runs: int, rows: int) -> np.ndarray[Any, np.dtype[np.float64]]:
        start = self.rng.choice([0.0, 1.5], (runs, 1))
        return np.cumsum(np.hstack([start, self.rng.uniform(1e-6, 0.1, (runs, rows - 1))]), axis=1)

    def pair(self, name: str, runs: int, steps: int, slots: int) -> tuple[PairTrace, PairSeries]:
        values = self.floats(runs, steps, slots, SLOT_WIDTH)
        counts = (self.rng.random((runs, steps, slots)) < self.rng.choice([0.0, 0.3, 0.9])).sum(
            axis=2
        )
        touching = np.arange(slots) < counts[..., None]
        found = touching.sum(axis=2, keepdims=True) + self.rng.integers(0, 3, (runs, steps, 1))
        values[..., FOUND] = np.where(touching, found, 0)
        net = [self.floats(runs, steps) for _ in range(5)]
        mode = self.rng.integers(0, 3, (runs, steps)).astype(np.int8)
        contacts = touching.sum(axis=2).astype(np.int32)
        series = PairSeries(name, contacts, *net, mode=mode)
        return PairTrace(name, values, np.ones((runs, 5))), series


def sample(
    *,
    nq: int = 7,
    nv: int = 6,
    pairs: tuple[str, ...] = ("floor-ball",),
    slots: int = 3,
    steps: int = 20,
    runs: int = 1,
    momentum: bool = False,
    seed: int = 0,
) -> tuple[Trace, list[PairSeries]]:
    make = Sampler(seed)
    sampled = [make.pair(name, runs, steps, slots) for name in pairs]
    trace = Trace(
        timestep=make.rng.uniform(1e-4, 1e-2, runs),
        steps_asked=steps,
        time=make.time(runs, steps + 1),
        qpos=make.floats(runs, steps + 1, nq),
        qvel=make.floats(runs, steps + 1, nv),
        kinetic=make.floats(runs, steps),
        potential=make.floats(runs, steps),
        contacts=make.counts(runs, steps),
        least_distance=make.floats(runs, steps),
        iterations=make.counts(runs, steps),
        iterations_most=make.counts(runs, steps),
        momentum=make.floats(runs, steps, 3) if momentum else None,
        angular_momentum=make.floats(runs, steps, 3) if momentum else None,
        pairs=tuple(pair for pair, _ in sampled),
        warnings=({},) * runs,
    )
    return trace, [series for _, series in sampled]


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
def make_trace() -> Callable[..., tuple[Trace, list[PairSeries]]]:
    return sample


@pytest.fixture(scope="session")
def expected_messages() -> Callable[..., Iterator[tuple[str, int, dict[str, Any]]]]:
    return messages_of


@pytest.fixture(scope="session")
def exactly() -> Callable[[Any], Any]:
    return exact


@pytest.fixture(scope="session")
def extras() -> TraceExtras:
    return TraceExtras(
        record_json=b'{"run_id": "r1", "label": "stable", "metrics": {"penetration": 1e-4}}',
        record_schema=b'{"type": "object"}',
        metadata={"run_id": "r1", "seed": "0", "unité": "m/s²"},
        model_xml=b"<mujoco><worldbody/></mujoco>",
    )
