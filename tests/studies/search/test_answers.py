"""How long verdicts take, by what is judged."""

import copy

import mujoco
import pytest

from contactlab.studies.search.answers import part_within, work_of

EULER = mujoco.MjModel.from_xml_string("<mujoco/>")


def test_a_verdict_of_rk4_evaluates_forces_four_times_a_step() -> None:
    """A run and references at h/4 and h/8, 13 in all; others are held to RK4 at h/2, too."""
    rk4 = copy.copy(EULER)
    rk4.opt.integrator = int(mujoco.mjtIntegrator.mjINT_RK4)
    assert work_of(rk4) == pytest.approx(4 * (1 + 4 + 8))
    assert work_of(EULER) == pytest.approx(1 + 4 + 8 + 4 * 2)


@pytest.mark.parametrize("ladder", [0.25, 0.02, 5.0])
def test_what_failed_is_followed_by_steps_that_hold_in_first_order(ladder: float) -> None:
    """An error of `ladder` a step keeps a limit of 0.1 after one more verdict, not after many."""
    step, limit, verdicts = 10.0, 0.1, 0
    while ladder * step > limit:
        step *= part_within(ladder * step, limit)
        verdicts += 1
    assert verdicts <= 1 + (0.6 < limit / (ladder * 10.0) < 1)
    # Nothing that the judge told no share of, or that failed within its limit, is tried unchanged.
    assert part_within(None, limit) == part_within(0.05, limit) < 1
