"""The impulse law: the worked numbers of the practice, and what must hold for any impact."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from contactlab.contact.contact_laws import resolve_impact, sticking_speed
from contactlab.contact.trace_arrays import Floats

VELOCITY = arrays(np.float64, 3, elements=st.floats(-10, 10))
SHARE = st.floats(0, 1)


@pytest.mark.parametrize(
    ("restitution", "friction", "impulse", "velocity", "sticks"),
    [
        (0.8, 0.05, (-0.09, 1.8), (2.82, 1.6), False),
        (0.0, 2.0, (-1.5, 1.0), (0.0, 0.0), True),
        (0.8, 0.5, (-0.9, 1.8), (1.2, 1.6), False),
    ],
)
def test_the_worked_numbers(
    restitution: float,
    friction: float,
    impulse: tuple[float, float],
    velocity: tuple[float, float],
    sticks: bool,
) -> None:
    """Mass 0.5 kg at (3, -2) m/s on a floor; a dozen roundings of numbers of order 1."""
    found = resolve_impact(0.5, [(3.0, -2.0)], (0.0, 1.0), restitution, friction)
    assert found.impulse[0] == pytest.approx(impulse, abs=1e-14)
    assert found.velocity[0] == pytest.approx(velocity, abs=1e-14)
    assert bool(found.sticks[0]) is sticks


@given(VELOCITY, VELOCITY, st.floats(0.1, 10), SHARE, st.floats(0, 2))
def test_what_holds_for_any_impact(
    velocity: Floats, normal: Floats, mass: float, restitution: float, friction: float
) -> None:
    length = np.linalg.norm(normal)
    if length < 1e-3:
        return
    away = normal / length
    found = resolve_impact(mass, velocity[None], normal, restitution, friction)
    before, after = float(velocity @ away), float(found.velocity[0] @ away)
    # Momentum: the impulse is the change of momentum.
    assert mass * (found.velocity[0] - velocity) == pytest.approx(found.impulse[0], abs=1e-11)
    # Newton's restitution, or nothing at all.
    assert after == pytest.approx(-restitution * before if before < 0 else before, abs=1e-11)
    # Coulomb's cone, and friction never speeds up.
    assert found.tangential_impulse[0] <= friction * found.normal_impulse[0] + 1e-12
    energy = [float(each @ each) for each in (velocity, found.velocity[0])]
    assert energy[1] <= energy[0] * (1 + 1e-12) + 1e-12


@given(st.floats(0.1, 5), SHARE, st.floats(0.01, 2))
def test_the_boundary_between_stick_and_slide(
    speed: float, restitution: float, friction: float
) -> None:
    limit = float(sticking_speed(speed, restitution, friction))
    inside, outside = [(0.999 * limit, -speed)], [(1.001 * limit, -speed)]
    assert resolve_impact(1.0, inside, (0, 1), restitution, friction).sticks[0]
    assert not resolve_impact(1.0, outside, (0, 1), restitution, friction).sticks[0]
