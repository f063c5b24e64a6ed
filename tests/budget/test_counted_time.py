"""Counted time repeats: it follows the simulated steps, and neither load nor the clock."""

import time

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.budget.counted_time import WorkLimit, count_pace
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.windows import replay_motion

STEPS, SEEDS = 50, 3


def _make_motion(integrator: str = "Euler") -> Motion:
    text = f'<mujoco><option integrator="{integrator}"/><worldbody><body><freejoint/>'
    model = mujoco.MjModel.from_xml_string(f'{text}<geom size=".1"/></body></worldbody></mujoco>')
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, mujoco.MjData(model), start[0], INTEGRATION)
    return Motion(model, start.repeat(SEEDS, axis=0), np.empty((SEEDS, STEPS, 0)))


def test_a_pace_is_the_same_for_each_copy_of_a_motion() -> None:
    """Load changes times by far more than rounding changes a count."""
    assert count_pace([_make_motion()]) == count_pace([_make_motion()]) > 0


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_a_limit_falls_by_the_simulated_steps(integrator: str) -> None:
    motion = _make_motion(integrator)
    limit = WorkLimit(100.0)
    count_pace([motion])
    before = limit.find_remainder(1.0, [motion])
    replay_motion(motion, 0.04, 1)
    done = (before - limit.find_remainder(1.0, [motion])) / count_pace([motion])
    # One more step of each seed shows the forces at its end.
    assert done == pytest.approx(SEEDS * (STEPS + 1))


def test_cpu_time_ends_a_limit_only_far_beyond_it(monkeypatch: pytest.MonkeyPatch) -> None:
    motion, begun = _make_motion(), time.process_time()
    limit = WorkLimit(100.0)
    for cpu, ended in ((290.0, False), (310.0, True)):
        monkeypatch.setattr(time, "process_time", lambda cpu=cpu: begun + cpu)
        assert (limit.find_remainder(1.0, [motion]) < 0) is ended
