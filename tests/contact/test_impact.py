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
UP = np.array([0.0, 1.0])


@pytest.mark.parametrize(
    ("restitution", "friction", "impulse"),
    [(0.8, 0.05, (-0.09, 1.8)), (0.0, 2.0, (-1.5, 1.0)), (0.8, 0.5, (-0.9, 1.8))],
)
def test_the_worked_numbers(
    restitution: float, friction: float, impulse: tuple[float, float]
) -> None:
    """Mass 0.5 kg at (3, -2) m/s on a floor; a dozen roundings of numbers of order 1."""
    found = resolve_impact(0.5, np.array([3.0, -2.0]), UP, restitution, friction)
    assert found == pytest.approx(impulse, abs=1e-14)


@given(VELOCITY, VELOCITY, st.floats(0.1, 10), SHARE, st.floats(0, 2))
def test_what_holds_for_any_impact(
    velocity: Floats, normal: Floats, mass: float, restitution: float, friction: float
) -> None:
    length = np.linalg.norm(normal)
    if length < 1e-3:
        return
    away = normal / length
    impulse = resolve_impact(mass, velocity, normal, restitution, friction)
    left = velocity + impulse / mass
    before, after = float(velocity @ away), float(left @ away)
    # Newton's restitution, or nothing at all.
    assert after == pytest.approx(-restitution * before if before < 0 else before, abs=1e-11)
    # Coulomb's cone, and friction never speeds up.
    pressing = float(impulse @ away)
    assert np.linalg.norm(impulse - pressing * away) <= friction * pressing + 1e-12
    energy = [float(each @ each) for each in (velocity, left)]
    assert energy[1] <= energy[0] * (1 + 1e-12) + 1e-12


@given(st.floats(0.1, 5), SHARE, st.floats(0.01, 2))
def test_the_boundary_between_stick_and_slide(
    speed: float, restitution: float, friction: float
) -> None:
    limit = float(sticking_speed(speed, restitution, friction))
    for share, sticks in ((0.999, True), (1.001, False)):
        velocity = np.array([share * limit, -speed])
        left = velocity + resolve_impact(1.0, velocity, UP, restitution, friction)
        assert bool(abs(left[0]) < 1e-12 * limit) is sticks
