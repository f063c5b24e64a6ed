"""Ledgers of motions with closed forms, and the order of errors that are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.store.mcap.trace_reader import StoredTrace
from contactlab.studies.check.free_motion import convergence_order, energy_budget


def stored(
    time: np.ndarray, qpos: np.ndarray, qvel: np.ndarray, kinetic: np.ndarray
) -> StoredTrace:
    """Return a trace of N steps from N + 1 states; without a potential."""
    steps = len(time) - 1
    counts = np.zeros(steps, dtype=np.int32)
    return StoredTrace(
        time=time,
        qpos=qpos,
        qvel=qvel,
        kinetic=kinetic[:-1],
        potential=np.zeros(steps),
        contacts=counts,
        least_distance=np.zeros(steps),
        iterations=counts,
        iterations_most=counts,
        momentum=None,
        angular_momentum=None,
        pairs=(),
        record_json=b"",
        metadata={},
        model_xml=b"",
    )


@given(st.floats(0.1, 10), st.floats(0.05, 5), st.floats(-5, 5).filter(lambda v: abs(v) > 0.01))
def test_the_rate_is_what_a_damper_takes(mass: float, damping: float, speed: float) -> None:
    """A body that only a damper slows: v = v0 exp(-b t / m), so that exp(-2 b t / m) is left."""
    time = np.arange(1001) * 1e-3
    kinetic = mass * (speed * np.exp(-damping / mass * time)) ** 2 / 2
    budget = energy_budget(1.0, kinetic, np.zeros(len(time)))
    assert budget.peak == kinetic[0]
    assert budget.rate(budget.peak) == pytest.approx(np.exp(-2 * damping / mass) - 1, rel=1e-9)
    assert budget.most == -budget.change


@given(st.integers(1, 6), st.floats(0.1, 10), st.floats(-3, 3))
def test_the_order_of_an_error_is_found(order: int, factor: float, start: float) -> None:
    def at(timestep: float) -> StoredTrace:
        time = np.arange(round(0.5 / timestep) + 1) * timestep
        qpos = (start + factor * time * (timestep / 4e-3) ** order)[:, None]
        return stored(time, qpos, qpos, np.ones(len(time)))

    found = convergence_order(at(4e-3), at(2e-3), at(1e-3))
    # Rounding of start is 1e-15 of a second difference that is at least 0.025 / 64^2 = 6e-6.
    assert found == pytest.approx(order, abs=1e-8)


def test_no_order_where_there_is_rounding_only() -> None:
    def at(timestep: float, noise: float) -> StoredTrace:
        time = np.arange(round(0.5 / timestep) + 1) * timestep
        qpos = np.full((len(time), 1), 1 + noise)
        return stored(time, qpos, qpos, np.ones(len(time)))

    assert np.isnan(convergence_order(at(4e-3, 0), at(2e-3, 1e-15), at(1e-3, 3e-15)))
