"""A planted servo that is too stiff for its step is found by its copies, its twin and chaos not."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import contactlab
from contactlab.contact.trace_arrays import REFINEMENT, SelfChecks
from contactlab.engines import Buffers, PreparedRuns, contact_kernel, mujoco_batch
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.engines.rollout_trace import make_trace
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import EvidenceRecord

# I = 2/5 2 kg (.05 m)^2 = .002 kg m^2. Euler steps of h resolve a servo of k and c on it where
# k h^2 / I + 2 c h / I < 4: at .002 s these are 20 and 2 for the stiff one, at a quarter of that
# 1.25 and .5.
SERVO = """<mujoco><option timestep=".002"/><worldbody><body>
<joint name="axle" axis="0 0 1"/><geom size=".05" mass="2"/></body></worldbody>
<actuator><position joint="axle" kp="{gain}" kv="1" forcerange="-20 20"/></actuator>
<keyframe><key qpos=".001" ctrl="0"/></keyframe></mujoco>"""
CHAOS = """<mujoco><option timestep=".0005" integrator="RK4"/><worldbody><body>
<joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .5 0 0" mass="1"/>
<body pos=".5 0 0"><joint axis="0 1 0"/>
<geom type="capsule" size=".02" fromto="0 0 0 .5 0 0" mass="1"/></body></body></worldbody>
<keyframe><key qpos="-2 .5"/></keyframe></mujoco>"""

Checked = Callable[..., EvidenceRecord]


@pytest.fixture
def steps_made(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return how many steps each rollout makes."""
    made: list[int] = []
    roll_out = mujoco_batch.Batch.rollout

    def counting(self: Any, nstep: int, *args: Any, **kwargs: Any) -> Any:
        made.append(nstep * len(kwargs.get("ids") or [0]))
        return roll_out(self, nstep, *args, **kwargs)

    kernel: Any = contact_kernel.KernelStepper
    step = kernel.step

    def counting_of_kernel(self: Any, *args: Any) -> Any:
        made.append(self._steps)
        return step(self, *args)

    monkeypatch.setattr(mujoco_batch.Batch, "rollout", counting)
    monkeypatch.setattr(kernel, "step", counting_of_kernel)
    return made


@pytest.fixture
def checked(tmp_path: Path) -> Checked:
    def run(text: str, seconds: float, checks: str, **more: Any) -> EvidenceRecord:
        model = tmp_path / "model.xml"
        model.write_text(text)
        sweep = {"version": 1, "scene": str(model), "duration": seconds, "checks": checks}
        sweep |= {"axes": {}, "drive": "none", "trace": "none", **more}
        store = contactlab.sweep(sweep, output=tmp_path / checks, workers=0)
        return next(iter(store.records()))

    return run


def checks_of(text: str, seconds: float, folder: Path) -> tuple[PreparedRuns, SelfChecks]:
    model = folder / "model.xml"
    model.write_text(text)
    scene, engine = Scene.open(str(model)), MujocoEngine()
    runs = PreparedRuns.of(scene, scene.resolve({}, 0, seconds))
    trace = make_trace(runs.base, runs.prepared, engine.roll_out(runs, Buffers()))
    return runs, engine.check_runs(runs, trace)


def test_a_servo_too_stiff_for_its_step_is_found(checked: Checked) -> None:
    """It shakes at its step, and comes to rest at a quarter of it."""
    record = checked(SERVO.format(gain=10_000), 1.0, "flagged")
    reasons = {entry.label: entry.reason for entry in record.labels}
    assert "at a quarter of the step" in reasons["step_dependent"]


def test_its_twin_needs_no_second_look(checked: Checked, steps_made: list[int]) -> None:
    assert checked(SERVO.format(gain=5), 1.0, "flagged").label == "stable"
    assert sum(steps_made) == 500


def test_its_twin_is_sound_also_on_a_second_look(checked: Checked) -> None:
    assert checked(SERVO.format(gain=5), 1.0, "all").label == "stable"


@pytest.mark.long
def test_chaos_is_no_step_dependence(checked: Checked, tmp_path: Path) -> None:
    """RK4 resolves the double pendulum; 1e-9 becomes a million times as much all the same."""
    _, checks = checks_of(CHAOS, 15.0, tmp_path)
    own, *copies = checks.travel[0]
    assert all(np.abs(each - own).max() > 1e-3 for each in copies)
    assert checked(CHAOS, 15.0, "all").label == "stable"


@pytest.mark.parametrize(("checks", "times"), [("none", 1), ("flagged", 7), ("all", 7)])
def test_a_second_pass_makes_six_times_the_steps(
    checked: Checked, steps_made: list[int], checks: str, times: int
) -> None:
    """One to repeat the run, four to refine it, one to perturb it; none if nobody asks."""
    checked(SERVO.format(gain=10_000), 1.0, checks)
    assert sum(steps_made) == times * 500


def test_the_refined_copy_is_the_run_at_a_quarter_of_its_step(tmp_path: Path) -> None:
    """Bit for bit that of a plain loop."""
    runs, checks = checks_of(SERVO.format(gain=5), 0.6, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    model.opt.timestep /= REFINEMENT
    model.opt.tolerance = 1e-10
    data = mujoco.MjData(model)
    data.qpos[:] = runs.starts.qpos[0]
    places, speeds = [data.qpos.copy()], [data.qvel.copy()]
    for step in range(300 * REFINEMENT):
        mujoco.mj_step(model, data)
        speeds.append(data.qvel.copy())
        if step % REFINEMENT == REFINEMENT - 1:
            places.append(data.qpos.copy())
    assert np.array_equal(checks.refined[0].qpos[0], places)
    late = np.array(speeds[3 * len(speeds) // 4 :])
    assert np.allclose(checks.rest[0, 1, 0], np.sqrt((late**2).mean(axis=0)), rtol=1e-12)


# A box that a motor shoves to and fro: it sticks and slides as often as the control turns.
SHOVED = """
<mujoco>
  <option timestep="0.002" cone="elliptic"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="box" pos="0 0 .05"><joint name="x" type="slide" axis="1 0 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <geom name="box" type="box" size=".1 .1 .05" mass="1" friction=".2" priority="1"/></body>
  </worldbody>
  <actuator><motor joint="x" ctrlrange="-8 8"/></actuator>
</mujoco>
"""


@pytest.mark.long
@pytest.mark.parametrize("checks", ["none", "flagged"])
def test_switches_that_the_control_causes_are_no_chatter(checked: Checked, checks: str) -> None:
    drive = {"noise": 1.0, "rate": 20}
    assert checked(SHOVED, 2.0, checks, drive=drive).label == "stable"


@pytest.mark.parametrize(("step", "label"), [(0.02, "step_dependent"), (0.0005, "stable")])
def test_what_one_step_brakes_ends_elsewhere(checked: Checked, step: float, label: str) -> None:
    """Drag c v at the start takes c h = 1.4 of the speed in a step of .02 s, which turns it about.

    For a ball of 5 g, 5 cm in radius, at 90 m/s in air: c = rho pi r^2 Cd v / 2 / m, about 70 1/s.
    """
    record = checked(
        f"""<mujoco><option timestep="{step}" density="1.2"/><worldbody><body pos="0 0 3">
        <freejoint/><geom size=".05" mass=".005" fluidshape="ellipsoid"/></body></worldbody>
        <keyframe><key qvel="90 0 10 0 0 0"/></keyframe></mujoco>""",
        1,
        "flagged",
    )
    assert record.label == label
