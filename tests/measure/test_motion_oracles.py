"""Closed forms of free motion, collision and release, on traces made by hand."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.special import elliprf

from contactlab.contact.rotations import rotate_vectors
from contactlab.contact.trace_arrays import FOUND, NORMAL, PairTrace, Trace
from contactlab.contact.trace_setup import FreeBody, Setup
from contactlab.measure import ORACLES, Context, context_of
from contactlab.measure.oracle_error import carlson_rf, middle_axis_flip

GRAVITY = 9.81
Vector = Callable[[np.ndarray], np.ndarray]


def trace_of(qpos: np.ndarray, qvel: np.ndarray, timestep: float = 1e-3, **more: Any) -> Trace:
    """Return the trace of one run with these states (N + 1, nq) and (N + 1, nv)."""
    steps = len(qpos) - 1
    zeros, counts = np.zeros((1, steps)), np.zeros((1, steps), np.int32)
    plain = Trace(
        timestep=np.array([timestep]),
        steps_asked=steps,
        time=timestep * np.arange(steps + 1.0)[None],
        qpos=qpos[None],
        qvel=qvel[None],
        kinetic=zeros,
        potential=zeros,
        contacts=counts,
        least_distance=zeros,
        iterations=counts,
        iterations_most=counts,
        momentum=None,
        angular_momentum=None,
        pairs=(),
        warnings=({},),
    )
    return replace(plain, **more)


def result(name: str, trace: Trace, bodies: int = 0, **values: object) -> list[float]:
    """Return what an oracle expects of the one run, what it measured, and the error."""
    setup = Setup(
        settings={key: [value] for key, value in values.items()},
        elliptic=np.ones(1, np.bool_),
        iterations=np.full(1, 100, np.int32),
        gravity=np.array([[0.0, 0.0, -GRAVITY]]),
        moving_mass=np.ones(1),
        size=0.1,
        exact=1e-6,
        steered=False,
        passive=True,
        conservative=False,
        quaternions=(3,) if bodies else (0,),
        free_bodies=tuple(FreeBody(f"body{k}", 7 * k, 6 * k, np.ones(1)) for k in range(bodies)),
        barriers=(),
        thickness=np.full(len(trace.pairs), np.inf),
        reaches=np.full(1, 0.1),
        widths=np.zeros(1),
        masses=np.ones(1),
        slots=np.ones(len(trace.pairs), np.int32),
        duration=trace.timestep * trace.steps,
    )
    context: Context = context_of(trace, setup)
    return [float(part[0]) for part in ORACLES[name].of(context)]


def by_runge_kutta(rate: Vector, state: np.ndarray, step: float, steps: int) -> np.ndarray:
    """Return the states (steps + 1, ...) of a fourth-order integration."""
    states = [state]
    for _ in range(steps):
        one = rate(state)
        two = rate(state + step / 2 * one)
        three = rate(state + step / 2 * two)
        four = rate(state + step * three)
        state = state + step / 6 * (one + 2 * two + 2 * three + four)
        states.append(state)
    return np.array(states)


def euler_equations(inertia: np.ndarray) -> Vector:
    after, before = np.roll(inertia, -1), np.roll(inertia, 1)
    return lambda w: (after - before) * np.roll(w, -1) * np.roll(w, 1) / inertia


@pytest.mark.long
@settings(max_examples=30)
@given(
    st.floats(0.3, 0.8), st.floats(1.2, 2.0), st.booleans(), st.floats(0.05, 0.5), st.floats(-2, 2)
)
def test_flip_time_is_that_of_eulers_equations(
    least: float, most: float, swapped: bool, wobble: float, spin: float
) -> None:
    """Integrated with 10 ms at rates up to 2 rad/s: 1e-8 in the state, 1e-5 s in the zero."""
    inertia = np.array([most, 1.0, least] if swapped else [least, 1.0, most])
    start = np.array([wobble, spin if abs(spin) > 0.1 else 1.0, -1.5 * wobble])
    (time,) = middle_axis_flip(inertia[None], start[None])
    w = by_runge_kutta(euler_equations(inertia), start, 1e-2, int(time / 1e-2) + 3)[:, 1]
    step = int(np.flatnonzero(w[:-1] * w[1:] < 0)[0])
    assert 1e-2 * (step + w[step] / (w[step] - w[step + 1])) == pytest.approx(time, abs=1e-5)


def test_first_flip_of_the_intermediate_axis() -> None:
    """Moments 1, 2, 3 and (0.1, 10, 0.1) rad/s, as integrated elsewhere: 1.092 s."""
    assert middle_axis_flip(np.array([[1.0, 2, 3]]), np.array([[0.1, 10, 0.1]])) == pytest.approx(
        1.092, abs=5e-4
    )


@given(arrays(np.float64, (3, 4), elements=st.floats(1e-3, 1e3)))
def test_carlsons_integral_is_that_of_scipy(arguments: np.ndarray) -> None:
    # Both are right to a few roundings of 2^-52; the iteration takes 30 of them.
    assert carlson_rf(*arguments) == pytest.approx(elliprf(*arguments), rel=30 * 2**-52)


def test_flip_time_reads_the_moments_off_the_start() -> None:
    """Also where the body does not start along the world's axes."""
    inertia, spin = np.array([1.0, 2, 3]), np.array([0.1, 10, 0.1])
    w = by_runge_kutta(euler_equations(inertia), spin, 1e-3, 1500)
    half = np.array([0.5, 0.5, 0.5, 0.5])
    qpos, qvel = np.zeros((1501, 7)), np.zeros((1501, 6))
    qpos[:, 3:], qvel[:, 3:] = half, w
    spins = np.tile(rotate_vectors(half, inertia * spin), (1, 1500, 1))
    expected, measured, error = result(
        "flip_time", trace_of(qpos, qvel, angular_momentum=spins), bodies=1
    )
    assert expected == pytest.approx(1.0917, abs=1e-4)
    assert measured == pytest.approx(expected, rel=1e-6)
    assert error < 1e-6
    still = trace_of(qpos, np.tile(qvel[:1], (1501, 1)), angular_momentum=spins)
    assert np.isnan(result("flip_time", still, bodies=1)[1])


def test_precession_is_the_rate_of_the_axis() -> None:
    """An axis at 30 degrees that turns by 2.5 rad/s for 4 s, more than once around."""
    rate, tilt, time = 2.5, np.radians(30), np.arange(4001) * 1e-3
    azimuth = rate * time / 2
    lean = np.array([np.cos(tilt / 2), np.sin(tilt / 2)])
    qpos = np.stack(
        [
            np.cos(azimuth) * lean[0],
            np.cos(azimuth) * lean[1],
            np.sin(azimuth) * lean[1],
            np.sin(azimuth) * lean[0],
        ],
        axis=1,
    )
    qvel = np.tile([0.0, rate * np.sin(tilt), 200.0], (4001, 1))
    assert result("precession", trace_of(qpos, qvel)) == pytest.approx([rate, rate, 0], abs=1e-9)
    faster = np.tile([0.0, 1.01 * rate * np.sin(tilt), 200.0], (4001, 1))
    assert result("precession", trace_of(qpos, faster))[2] == pytest.approx(1 - 1 / 1.01)


def test_conserved_energy_counts_gains_and_losses() -> None:
    height = np.linspace(0, 2, 101)[None, :-1]
    still = np.zeros((101, 1))
    fair = trace_of(still, still, kinetic=2 - height, potential=height)
    assert result("conserved_energy", fair) == [0, 0, 0]
    for factor in (0.9, 1.1):
        unfair = trace_of(still, still, kinetic=(2 - height) * factor**height, potential=height)
        assert result("conserved_energy", unfair)[2] == pytest.approx(
            np.abs((2 - height) * (factor**height - 1)).max() / 2
        )


def test_a_cradle_s_last_ball_swings_as_far_as_the_first_came() -> None:
    """The last hinge swings to the other side; smaller swings before and after do not count."""
    swing = np.concatenate([np.zeros(50), 0.5 * np.sin(np.linspace(0, np.pi, 101)), np.zeros(50)])
    swing[:50] = 1e-3 * np.sin(np.arange(50))
    qpos = np.stack([np.zeros_like(swing), -swing], axis=1)
    found = result("swing_transfer", trace_of(qpos, qpos), angle=30.0)
    assert found == pytest.approx([30, np.degrees(0.5), 30 - np.degrees(0.5)], abs=1e-9)
    assert np.isnan(result("swing_transfer", trace_of(qpos * 0, qpos), angle=30.0)[1])


@pytest.mark.parametrize(
    ("solref", "speed"),
    [
        # Measured for one contact elsewhere: 0.92, 3.68 and 5.0 m/s at an overlap of 50 mm.
        ((0.02, 1.0), 0.05 / 0.02 / np.e),
        ((0.005, 1.0), 0.05 / 0.005 / np.e),
        ((-1e4, 0.0), 5.0),
    ],
)
def test_speed_of_separation(solref: tuple[float, float], speed: float) -> None:
    qvel = np.zeros((11, 12))
    qvel[-1, [2, 8]] = -speed / 2, speed / 2
    values = {"solref": solref, "solimp": (0.9, 0.9, 1e-3, 0.5, 2), "overlap": 0.05}

    def expected_of(contacts: int) -> Any:
        slots = np.zeros((1, 10, 1, 23))
        slots[0, 0, 0, FOUND] = contacts
        pair = PairTrace("a-b", slots, np.ones((1, 5)))
        trace = trace_of(np.zeros((11, 14)), qvel, pairs=(pair,))
        return result("separation_speed", trace, 2, **values)

    assert expected_of(1) == pytest.approx([speed, speed, 0])
    # Four parallel contacts reach d = 3.6 / 3.7 instead of 0.9, and no contact throws anything.
    if solref[1] == 0:
        assert expected_of(4)[0] == pytest.approx(speed * (4 / 3.7) ** 0.5)
    assert expected_of(0)[0] == 0


def test_braking_angle_is_speed_times_time_constant() -> None:
    """I = 2 kg m^2 at 3 rad/s and c = 0.5 + 1 N m s/rad: 4 rad."""
    time = np.arange(20001) * 1e-3
    qvel = 3 * np.exp(-0.75 * time)[:, None]
    qpos = 4 * (1 - np.exp(-0.75 * time))[:, None]
    trace = trace_of(qpos, qvel, kinetic=(qvel[None, :-1, 0] ** 2))
    found = result("braking_angle", trace, joint_damping=0.5, servo_gain=1.0)
    assert found == pytest.approx([4, 4, 0], abs=2e-6)


def test_restitution_of_a_pair_does_not_see_its_common_motion() -> None:
    qvel = np.zeros((5, 12))
    qvel[0, [0, 6]] = 5.0, 2.0
    qvel[-1, [0, 6]] = 3.0, 4.8
    trace = trace_of(np.zeros((5, 14)), qvel)
    expected, measured, _ = result("pair_restitution", trace, 2, solref=(-160000.0, -144.7))
    assert expected == pytest.approx(0.6, abs=1e-3)
    assert measured == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("friction", "expected"),
    [(0.15, 0.15), (0.6, 2 / 7 * 3**0.5)],
    ids=["slides", "stops sliding"],
)
def test_throw_is_friction_until_it_stops_the_slip(friction: float, expected: float) -> None:
    """Damped at thousands of times its rate, the contact does not rebound: e = 0."""
    slots = np.zeros((1, 4, 1, 23))
    slots[0, 2, 0, FOUND] = 1
    slots[0, 2, 0, NORMAL] = 0.6, 0.8, 0.0
    qvel = np.zeros((5, 12))
    qvel[-1, 6:9] = 2 * (np.array([0.6, 0.8, 0]) + 0.15 * np.array([0, 0, 1]))
    trace = trace_of(np.zeros((5, 14)), qvel, pairs=(PairTrace("a-b", slots, np.ones((1, 5))),))
    values = {"friction": (friction,) * 5, "solref": (-1.0, -1e5), "cut": 60.0}
    found = result("throw", trace, 2, **values)
    assert found == pytest.approx([expected, 0.15, expected - 0.15], abs=1e-6)
