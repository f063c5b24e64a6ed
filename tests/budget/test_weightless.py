"""Where nothing weighs, a phase at rest is measured by what is usual in the others."""

from dataclasses import replace

import numpy as np
import pytest
from tests.budget_motions import motion_of

from contactlab.budget import Motion, Settings, error_budget
from contactlab.budget.motion import GRAVITY_AS_REAL
from contactlab.budget.windows import usual_changes

FAST = Settings(check=False, energy=False, places=False)
# The limit, a hair too narrow for the start, lets go of the arm, which then drifts.
ARM = """<mujoco><option gravity="0 0 0" timestep=".002"/><worldbody>
  <body name="arm"><joint name="shoulder" axis="0 1 0" limited="true" range="-1 {limit}"
    {damping}/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="1"/></body></worldbody>
  <actuator><motor joint="shoulder"/></actuator></mujoco>"""


def phases(limit: float, damping: str = "") -> tuple[Motion, Motion]:
    """Return an arm at rest beyond a limit by `limit` deg, and driven."""
    xml = ARM.format(limit=-limit, damping=damping)
    rest = motion_of(xml, 0.2, controls=np.zeros((1, 100, 1)), name="rest")
    push = np.sin(np.linspace(0, 12, 250)).reshape(1, -1, 1)
    return rest, motion_of(xml, 0.5, controls=push, qpos=[-0.5], name="driven")


def error_of(motion: Motion, row: str) -> float:
    found = error_budget([motion], rows=[row], settings=FAST, workers=1).worst(row)
    assert found is not None
    return found[1].error


def test_a_hair_beyond_a_limit_is_nothing_beside_what_a_body_does_else() -> None:
    """Alone, the arm's drift hangs on the limit; it is next to none."""
    rest, driven = phases(limit=1e-8)
    usual = usual_changes([rest, driven])
    assert error_of(rest, "limit softness") > 0.1
    assert error_of(replace(rest, usual=usual), "limit softness") < 1e-4


def test_what_moves_as_usual_reads_as_it_did() -> None:
    """It changes its velocity by more than a tenth of the usual, which is the mean of both."""
    rest, driven = phases(limit=1e-8, damping='damping=".02"')
    usual = usual_changes([rest, driven])
    assert error_of(driven, "damping") == error_of(replace(driven, usual=usual), "damping") > 0


def test_what_is_usual_is_the_mean_acceleration() -> None:
    """The arm's, whose inertia about its joint and gyration are known, under a steady torque."""
    xml = ARM.format(limit=170, damping="")
    motion = motion_of(xml, 0.2, controls=np.full((1, 100, 1), 0.1))
    model, body = motion.model, 1
    arm, gyration = model.body_ipos[body, 0], np.sqrt(model.body_inertia[body].max())
    about = arm**2 + gyration**2  # of 1 kg [m^2]
    turn = 0.1 / about  # angular acceleration
    # On a circle, a velocity also turns: by w^2 r.
    speeds = turn * np.linspace(0, 0.2, 10_000)
    along = np.hypot(arm * turn, arm * speeds**2)
    expected = np.hypot(along, gyration * turn).mean()
    assert usual_changes([motion])[body] == pytest.approx(expected, rel=1e-3)
    assert 0 < GRAVITY_AS_REAL < 1


def test_where_something_weighs_nothing_is_usual() -> None:
    """Weight is the measure of what stands, with what is usual or without."""
    rest, driven = phases(limit=1e-3)
    heavy = [replace(motion, model=motion.model) for motion in (rest, driven)]
    for motion in heavy:
        motion.model.opt.gravity[2] = -9.81
    usual = usual_changes(heavy)
    assert error_of(heavy[0], "limit softness") == error_of(
        replace(heavy[0], usual=usual), "limit softness"
    )
