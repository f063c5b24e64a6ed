"""What would have gone on is told of what sleeps, by closed forms of its way."""

from collections.abc import Callable

import numpy as np
import pytest

from contactlab.contact.trace_arrays import Floats
from contactlab.engines import Buffers, PreparedRuns
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.scene.scene import Scene

STEP, END = 0.002, 1.0
# MuJoCo lets nothing sleep before it was slow for ten steps.
SLOW = 10 * STEP
MODEL = """<mujoco><option timestep="{step}" sleep_tolerance="{tolerance}">
<flag sleep="enable"/></option><worldbody><geom type="box" size="1 1 .1" euler="0 {tilt} 0"/>
{body}</worldbody>{start}</mujoco>"""
SLIDE = """<body pos="0 0 1"><joint type="slide" axis="{axis}" damping="{damping}"/>
<geom size=".05" mass="1" contype="0" conaffinity="0"/></body>"""
BOX = """<body pos="0 0 {height}" euler="0 {tilt} 0"><freejoint/>
<geom type="box" size=".05 .05 .05" mass="1"/></body>"""


@pytest.fixture(name="slept", scope="module")
def slept_fixture(make_scene: Callable[..., Scene]) -> Callable[..., Floats]:
    """Return how far (n, 4) a model's worst sleeper would have gone, as `Trace` says."""

    def slept(body: str, tolerance: float, *, tilt: float = 0, start: str = "") -> Floats:
        text = MODEL.format(step=STEP, tolerance=tolerance, tilt=tilt, body=body, start=start)
        scene = make_scene(text)
        runs = PreparedRuns.of(scene, scene.resolve({}, 0, END))
        sleeper = MujocoEngine().roll_out(runs, Buffers()).sleeper
        assert sleeper is not None
        return sleeper[0]

    return slept


def test_a_glide_goes_on_as_its_damper_lets_it(slept: Callable[..., Floats]) -> None:
    """Damped by c = 1 N s/m it goes v m / c (1 - exp(-c t / m)) until t."""
    start = '<keyframe><key name="start" qvel=".02"/></keyframe>'
    far, share, joint, step = slept(SLIDE.format(axis="1 0 0", damping=1), 0.05, start=start)
    before, whole = (0.02 * (1 - np.exp(-time)) for time in (SLOW, END))
    # The step before it sleeps counts on both sides; implicit damping is off by half a step.
    assert far == pytest.approx(whole - before, rel=3 * STEP)
    assert share == pytest.approx(1 - before / whole, abs=2 * STEP)
    assert (joint, step) == (0, 10)


def test_a_part_in_mid_air_falls(slept: Callable[..., Floats]) -> None:
    """At first slower than the tolerance, it sleeps with v = g t, and would fall for the rest."""
    far, share, *_ = slept(SLIDE.format(axis="0 0 1", damping=0), 0.5)
    assert far == pytest.approx(9.81 / 2 * (END**2 - SLOW**2), rel=3 * STEP)
    assert share == pytest.approx(1, abs=2 * STEP)


@pytest.mark.parametrize("tilt", [0, 20])
def test_what_friction_holds_stays(slept: Callable[..., Floats], tilt: float) -> None:
    """On a slope it creeps by regularised friction, awake: noslip takes that away."""
    height = (0.1 + 0.05) / np.cos(np.radians(tilt))
    far, *_ = slept(BOX.format(height=height, tilt=tilt), 1e-2, tilt=tilt)
    assert 0 <= far < 1e-2 * 0.05
