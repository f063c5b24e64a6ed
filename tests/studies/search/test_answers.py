"""How long verdicts take, by what is judged."""

import copy

import mujoco
import pytest

from contactlab.studies.search.answers import work_of

EULER = mujoco.MjModel.from_xml_string("<mujoco/>")


def test_a_verdict_of_rk4_evaluates_forces_four_times_a_step() -> None:
    """A run and references at h/4 and h/8, 13 in all; others are held to RK4 at h/2, too."""
    rk4 = copy.copy(EULER)
    rk4.opt.integrator = int(mujoco.mjtIntegrator.mjINT_RK4)
    assert work_of(rk4) == pytest.approx(4 * (1 + 4 + 8))
    assert work_of(EULER) == pytest.approx(1 + 4 + 8 + 4 * 2)
