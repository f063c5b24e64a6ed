"""A recommended solref rests less deep than asked, for any load; and is the softest that does."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from contactlab.contact.contact_laws import rest_penetration
from contactlab.studies.check.contact_checks import (
    STIFF_SOLREF,
    load_at_depth,
    rounded_down,
    stiff_solref,
)

LOADS = st.floats(1e-3, 1e4)
INVERSE = st.floats(1e-3, 1e3)
SHARES = st.floats(0.05, 0.999)
DEPTHS = st.floats(1e-6, 1e-2)
TIMESTEPS = st.floats(1e-4, 2e-2)


@st.composite
def impedances(draw: st.DrawFn) -> np.ndarray:
    """Draw impedances that do not fall with depth, as the closed form takes them."""
    start, end = sorted((draw(SHARES), draw(SHARES)))
    return np.array([start, end, draw(st.floats(1e-5, 1e-2)), 0.5, draw(st.floats(1, 4))])


@given(LOADS, INVERSE, impedances(), TIMESTEPS, DEPTHS)
def test_it_rests_less_deep(
    load: float, inverse: float, solimp: np.ndarray, timestep: float, depth: float
) -> None:
    solref = stiff_solref(load, inverse, solimp, timestep, depth)
    assert float(rest_penetration(load, inverse, solref, solimp)) < depth


@given(LOADS, INVERSE, impedances(), TIMESTEPS, DEPTHS)
def test_the_next_softer_one_does_not(
    load: float, inverse: float, solimp: np.ndarray, timestep: float, depth: float
) -> None:
    timeconst, ratio = stiff_solref(load, inverse, solimp, timestep, depth)
    assume((timeconst, ratio) != STIFF_SOLREF)
    digit = 10.0 ** (math.floor(math.log10(timeconst)) - 1)
    softer = timeconst + 2 * digit
    assert float(rest_penetration(load, inverse, (softer, ratio), solimp)) >= depth


@given(LOADS, INVERSE, impedances(), DEPTHS)
def test_practice_comes_first_where_the_engine_keeps_it(
    load: float, inverse: float, solimp: np.ndarray, depth: float
) -> None:
    enough = float(rest_penetration(load, inverse, STIFF_SOLREF, solimp)) < depth
    kept = STIFF_SOLREF[0] / 2
    assert (stiff_solref(load, inverse, solimp, kept, depth) == STIFF_SOLREF) >= enough
    # Half as long again, and the engine would raise the time constant.
    timeconst, _ = stiff_solref(load, inverse, solimp, 1.5 * kept, depth)
    assert timeconst != STIFF_SOLREF[0] or not enough or timeconst <= 2 * kept


@given(LOADS, INVERSE, impedances(), st.floats(1e-3, 0.1))
def test_the_load_of_a_depth_is_that_which_gives_it(
    load: float, inverse: float, solimp: np.ndarray, timeconst: float
) -> None:
    solref = (timeconst, 1.0)
    depth = float(rest_penetration(load, inverse, solref, solimp))
    # Where impedance is steep in depth, a depth to rounding is a load to some roundings more.
    found = load_at_depth(depth, inverse, 1 / timeconst**2, solimp)
    assert found == pytest.approx(load, rel=1e-6)


@pytest.mark.parametrize("weight", [9.81, 9.81 / 4])
def test_the_default_box_needs_more_than_the_default(weight: float) -> None:
    """On four corners the default rests 0.1078 mm deep, on one contact 0.3672 mm."""
    solimp = np.array([0.9, 0.95, 0.001, 0.5, 2])
    default = float(rest_penetration(weight, 1.0, (0.02, 1), solimp))
    assert default == pytest.approx({9.81: 3.672e-4, 9.81 / 4: 1.078e-4}[weight], rel=5e-4)
    assert stiff_solref(weight, 1.0, solimp, 2e-3, 1e-4) == STIFF_SOLREF
    assert STIFF_SOLREF[0] < stiff_solref(weight, 1.0, solimp, 4e-3, 1e-4)[0] < 0.02


@given(st.floats(1e-8, 1e8))
def test_two_digits_are_kept(value: float) -> None:
    rounded = rounded_down(value)
    # One more in the second digit would be above.
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    assert value - step * (1 + 1e-6) < rounded <= value * (1 + 1e-9)
    assert float(f"{rounded:.1e}") == rounded


@pytest.mark.parametrize("value", [0.02, 0.005, 1.2e-3, 7.0, 1.0])
def test_numbers_of_two_digits_stay(value: float) -> None:
    assert rounded_down(value) == value
