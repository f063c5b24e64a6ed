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
def test_what_a_damper_takes_is_what_is_lost(mass: float, damping: float, speed: float) -> None:
    """A body that only a damper slows: v = v0 exp(-b t / m)."""
    timestep, rate = 1e-3, damping / mass
    time = np.arange(1001) * timestep
    qvel = (speed * np.exp(-rate * time))[:, None]
    kinetic = mass * qvel[:, 0] ** 2 / 2
    trace = stored(time, qvel, qvel, kinetic)
    ledger = energy_budget(trace, np.array([damping]), kinetic, np.zeros(len(time)))
    lost = kinetic[0] - kinetic[-1]
    assert ledger.change == pytest.approx(-lost, rel=1e-9)
    assert ledger.peak == kinetic[0]
    # The trapezoidal rule: h^2 T / 12 times the largest second derivative of the power b v^2.
    bound = timestep**2 * ledger.seconds / 12 * damping * speed**2 * (2 * rate) ** 2
    assert ledger.dampers == pytest.approx(lost, abs=bound + 1e-12 * lost)
    scale = ledger.peak * ledger.seconds
    assert abs(ledger.unexplained(ledger.peak)) <= (bound + 1e-9 * lost) / scale
    assert ledger.rate(ledger.peak) == pytest.approx(-lost / scale)


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
