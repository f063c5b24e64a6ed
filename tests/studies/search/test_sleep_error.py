"""Sleep is told by whole runs: at rest it costs nothing, and what moves must not be frozen."""

import copy
import math

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.modifications.model_predicates import may_sleep
from contactlab.scene.mujoco_versions import has_batch
from contactlab.studies.search.sleep_error import SleepAwareError
from contactlab.tasks.reference_error import TaskReference
from contactlab.tasks.task_clock import Clock

SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))
pytestmark = pytest.mark.skipif(not SLEEP, reason="this MuJoCo has no sleep")
BOX = """<mujoco>
  <option timestep="0.004" sleep_tolerance="{tolerance}"/>
  <worldbody>
    <geom type="plane" size="5 5 .1" friction=".1"/>
    <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" friction=".1"/></body>
  </worldbody>
</mujoco>"""
STEPS, FINER = 100, 4
SLIDER = '<body><joint name="{}" type="slide"/><geom size=".1"/></body>'
COUPLED = f"""<mujoco>
  <worldbody>{SLIDER.format("one")}{SLIDER.format("two")}</worldbody>
  <tendon>
    <fixed name="first"><joint joint="one" coef="1"/></fixed>
    <fixed name="second"><joint joint="two" coef="1"/></fixed>
  </tendon>
  <equality><tendon tendon1="first" tendon2="second"/></equality>
</mujoco>"""


def motion_of(tolerance: float, speed: float, text: str = BOX) -> Motion:
    """Return a box on the floor that slides so fast at first; or the first of other bodies."""
    model = mujoco.MjModel.from_xml_string(text.format(tolerance=tolerance))
    data = mujoco.MjData(model)
    data.qvel[0] = speed
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, data, start[0], INTEGRATION)
    return Motion(model, start, np.empty((1, STEPS, 0)), name="slide")


@pytest.mark.parametrize(
    ("tolerance", "speed", "frozen"), [(1e-4, 0.0, False), (1e-4, 0.5, False), (1.0, 0.5, True)]
)
def test_what_moves_must_not_be_frozen(tolerance: float, speed: float, *, frozen: bool) -> None:
    """A tolerance of 1 m/s puts a box to sleep after ten steps that slides .5 m/s.

    Friction of .1 has taken .04 m/s by then, and sleep takes the other .46 at once: of real
    impulses of .5 at the start, at most .5 of friction, and a tenth of weight in .4 s: a third.
    """
    motion = motion_of(tolerance, speed)
    reference = TaskReference.run_references([motion], FINER, 1)
    measure = SleepAwareError(reference, [motion], FINER, 1)
    asleep = copy.copy(motion.model)
    asleep.opt.enableflags |= SLEEP
    awake, found = (
        measure.estimate_error(motion.model, FINER),
        measure.estimate_error(asleep, FINER),
    )
    assert awake == reference.estimate_error(motion.model, FINER)
    if frozen:
        assert found.error > awake.error + 0.2
    else:
        assert found.error <= max(1.5 * awake.error, 1e-3)


def test_driven_trees_stay_awake_and_what_sleeps_already_is_not_tried() -> None:
    model = motion_of(1e-3, 0.0).model
    assert may_sleep(model)
    model.opt.enableflags |= SLEEP
    assert not may_sleep(model)
    driven = BOX.format(tolerance=1e-3).replace("<freejoint/>", '<joint name="x" type="slide"/>')
    driven = driven.replace("</mujoco>", '<actuator><motor joint="x"/></actuator></mujoco>')
    assert not may_sleep(mujoco.MjModel.from_xml_string(driven))


@pytest.mark.skipif(not has_batch(), reason="this MuJoCo ends the process instead")
def test_where_mujoco_refuses_sleep_it_has_no_price() -> None:
    """Tendon equalities do not support sleep, which MuJoCo says as bodies wake."""
    motion = motion_of(1e-3, 0.0, COUPLED)
    asleep = copy.copy(motion.model)
    asleep.opt.enableflags |= SLEEP
    clock = Clock(TaskReference.run_references([motion], FINER, 1), motion.model)
    (price,) = clock.time_ratios([(asleep, FINER)])
    assert math.isinf(price.high)
