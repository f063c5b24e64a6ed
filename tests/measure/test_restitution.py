"""Restitution of flights that are exact parabolas."""

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import Barrier, FreeBody
from contactlab.measure import assess_runs

G, RADIUS, TIMESTEP = 9.81, 0.05, 1e-3


def bounces(height: float, restitution: list[float], steps: int) -> tuple[Floats, Floats, Floats]:
    """Sample (height of the centre, velocity, distance) of a ball that bounces in no time.

    Contact is one sample at each impact, a little deep, as a stiff contact would show it.
    """
    time = np.arange(steps + 1) * TIMESTEP
    start, speed, gap = 0.0, 0.0, height
    z, v, distance = (np.zeros(steps + 1) for _ in range(3))
    for ratio in [*restitution, 0.0]:
        impact = start + (speed + np.sqrt(speed**2 + 2 * G * gap)) / G
        flight = (time >= start) & (time <= impact)
        since = time[flight] - start
        z[flight] = RADIUS + gap + speed * since - G * since**2 / 2
        v[flight] = speed - G * since
        touch = np.searchsorted(time, impact)
        start, speed, gap = impact, ratio * np.sqrt(speed**2 + 2 * G * gap), 0.0
        if touch > steps:
            break
        distance[touch] = -1e-4
    touching = distance < 0
    z[touching] = RADIUS - 1e-4
    return z, v, distance


def ball(
    trace_of: Any, setup_of: Any, pair_of: Any, flight: tuple[Floats, Floats, Floats], side: int = 1
) -> tuple[Any, Any]:
    z, v, distance = flight
    steps = len(z) - 1
    pair = pair_of(
        1,
        steps,
        distance=distance[None, :-1, None],
        touching=distance[None, :-1, None] < 0,
    )
    trace = trace_of(1, steps, TIMESTEP, pairs=(pair,))
    trace.qpos[0, :, 2], trace.qvel[0, :, 2] = side * z, side * v
    body = FreeBody("ball", 0, 0, np.ones(1))
    floor = Barrier(0, body, np.zeros(3), np.array([0.0, 0.0, 1.0]), np.inf)
    gravity = np.array([[0, 0, -G * side]])
    return trace, setup_of(trace, barriers=(floor,), free_bodies=(body,), gravity=gravity)


# The fixtures are functions without state.
@settings(
    deadline=None,
    max_examples=30,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.floats(0.3, 0.99), st.floats(0.5, 2.0), st.sampled_from([1, -1]))
def test_parabolas_give_their_restitution(
    trace_of: Any, setup_of: Any, pair_of: Any, ratio: float, height: float, side: int
) -> None:
    flight = bounces(height, [ratio] * 8, 3000)
    trace, setup = ball(trace_of, setup_of, pair_of, flight, side)
    # Exact but for rounding of the square roots.
    assert assess_runs(trace, setup).metrics["restitution_measured"][0] == pytest.approx(
        ratio, abs=1e-9
    )


def test_only_the_first_strong_impacts_count(trace_of: Any, setup_of: Any, pair_of: Any) -> None:
    flight = bounces(1.0, [0.8, 0.3, 0.9, 0.9], 3000)
    trace, setup = ball(trace_of, setup_of, pair_of, flight)
    # The third impact is at .8 x .3 = .24 of the first one's speed.
    expected = np.mean([0.8, 0.3])
    assert assess_runs(trace, setup).metrics["restitution_measured"][0] == pytest.approx(
        expected, abs=1e-9
    )


def test_a_ball_that_stays_has_none(trace_of: Any, setup_of: Any, pair_of: Any) -> None:
    flight = z, v, distance = bounces(1.0, [], 1000)
    first = int((distance < 0).argmax())
    z[first:], v[first:], distance[first:] = RADIUS, 0, -1e-4
    trace, setup = ball(trace_of, setup_of, pair_of, flight)
    assert np.isnan(assess_runs(trace, setup).metrics["restitution_measured"][0])
