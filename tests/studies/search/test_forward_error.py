"""Forward errors against closed forms, and motions that are known to be chaotic or not."""

import mujoco
import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.errors import SceneError
from contactlab.studies.search.configuration import Configuration
from contactlab.studies.search.forward_error import ForwardError, ObservedOutput, measure_divergence

# m x'' = - k x with x(0) = .1 m: .1 cos(10 t).
SPRING = """<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody><body name="mass">
<joint type="slide" axis="1 0 0" stiffness="100"/><geom size=".05" mass="1"/></body></worldbody>
<keyframe><key qpos=".1"/></keyframe></mujoco>"""
DOUBLE = """<mujoco><option timestep="0.002" integrator="RK4"/><worldbody><body name="upper"
pos="0 0 3"><joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 1 0 0"/>
<body name="lower" pos="1 0 0"><joint axis="0 1 0"/><geom type="capsule" size=".02"
fromto="0 0 0 1 0 0"/></body></body></worldbody>
<keyframe><key qpos="-1.5 .2"/></keyframe></mujoco>"""


def motion(text: str, seconds: float) -> Motion:
    model = mujoco.MjModel.from_xml_string(text)
    model.geom_contype[:] = 0
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, data, start[0], INTEGRATION)
    return Motion(model, start, np.empty((1, round(seconds / model.opt.timestep), 0)))


def test_the_error_at_the_end_is_that_of_the_closed_form() -> None:
    """Euler's steps, v' = v - h k x, x' = x + h v', turn by w = acos(1 - h^2 k / 2).

    From rest, the half step by which velocities are ahead adds tan(w / 2) sin(w n).
    """
    swinging = motion(SPRING, 1.0)
    measure = ForwardError([swinging], 4, [ObservedOutput.find(swinging.model, "mass")], "end", 1)
    apart = measure.estimate_error(swinging.model, 4)
    angle, steps = np.arccos(1 - 0.01**2 * 100 / 2), 100
    own = 0.1 * (np.cos(angle * steps) - np.tan(angle / 2) * np.sin(angle * steps))
    assert apart.error == pytest.approx(abs(own - 0.1 * np.cos(10)), rel=1e-3)
    assert (apart.body, apart.time) == ("mass", pytest.approx(1.0))
    smooth = Configuration({"integrator": "RK4"}).apply_to(swinging.model)
    assert measure.estimate_error(smooth, 4).error < 1e-3 * apart.error


def test_the_peak_is_at_least_the_end() -> None:
    swinging = motion(SPRING, 1.0)
    watched = [ObservedOutput.find(swinging.model, "mass")]
    end, peak = (
        ForwardError([swinging], 2, watched, at, 1).estimate_error(swinging.model, 2).error
        for at in ("end", "peak")
    )
    assert peak >= end > 0


def test_a_spring_is_regular_and_a_double_pendulum_that_goes_round_is_chaotic() -> None:
    regular, chaotic = (
        measure_divergence(motion(SPRING, 5.0), 1),
        measure_divergence(motion(DOUBLE, 12.0), 1),
    )
    assert not regular.chaotic
    assert regular.sentence.startswith("regular: a nudge grows")
    assert chaotic.chaotic
    assert chaotic.sentence.startswith("chaotic: a nudge grows")


def test_what_is_not_there_cannot_be_watched() -> None:
    with pytest.raises(SceneError, match="nothing is called 'hand'"):
        ObservedOutput.find(motion(SPRING, 0.1).model, "hand")
