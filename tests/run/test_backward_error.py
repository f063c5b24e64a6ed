"""A servo too stiff for its step has a large numerical error; its twin and chaos do not."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import contactlab
from contactlab.budget import Settings, backward_error, error_budget, motion_of_run
from contactlab.contact.trace_arrays import BackwardError
from contactlab.engines import PreparedRuns, contact_kernel, mujoco_batch
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
    step = kernel.step_run

    def counting_of_kernel(self: Any, *args: Any) -> Any:
        made.append(self._steps)
        return step(self, *args)

    monkeypatch.setattr(mujoco_batch.Batch, "rollout", counting)
    monkeypatch.setattr(kernel, "step_run", counting_of_kernel)
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


def runs_of(text: str, seconds: float, folder: Path) -> PreparedRuns:
    model = folder / "model.xml"
    model.write_text(text)
    scene = Scene.open(str(model))
    return PreparedRuns.of(scene, scene.resolve({}, 0, seconds))


def test_a_servo_too_stiff_for_its_step_is_found(checked: Checked) -> None:
    """It shakes at its step; its reference, of a quarter of it, comes to rest."""
    record = checked(SERVO.format(gain=10_000), 1.0, "flagged")
    reasons = {entry.label: entry.reason for entry in record.labels}
    assert reasons["step_dependent"].startswith("numerical error ")
    assert record.backward_error_body == "body[1]"
    assert "; cause: the numerics (numerical error " in reasons["chatter"]


def test_a_looser_tolerance_lets_it_pass(checked: Checked) -> None:
    loose = {"thresholds": {"backward_error": 10}}
    record = checked(SERVO.format(gain=10_000), 1.0, "all", **loose)
    assert "step_dependent" not in {entry.label for entry in record.labels}
    assert (record.metrics["backward_error"] or 0) > 0.1


def test_its_twin_needs_no_second_look(checked: Checked, steps_made: list[int]) -> None:
    assert checked(SERVO.format(gain=5), 1.0, "flagged").label == "stable"
    assert sum(steps_made) == 500


def test_its_twin_is_sound_also_on_a_second_look(checked: Checked) -> None:
    assert checked(SERVO.format(gain=5), 1.0, "all").label == "stable"


@pytest.mark.long
def test_chaos_is_no_step_dependence(checked: Checked) -> None:
    """RK4 resolves the double pendulum, whose copies part nevertheless."""
    assert checked(CHAOS, 15.0, "all").label == "stable"


def test_it_is_the_number_of_the_runs_own_budget(tmp_path: Path) -> None:
    """With references at h/4 alone, whatever else is asked beside it."""
    runs = runs_of(SERVO.format(gain=10_000), 0.4, tmp_path)
    motion = motion_of_run(runs.models[0], runs.starts, 0, runs.steps)
    settings = Settings(check=False, energy=False)
    (phase,) = error_budget([motion], rows=["solver"], settings=settings, workers=2).phases
    found = backward_error(runs, 0)
    run, energy = phase.run, phase.energy_origin
    assert found == BackwardError(
        share=run.error,
        body="body[1]",
        time=run.time,
        energy=phase.energy_drift,
        energy_body="body[1]",
        energy_time=energy.time,
        errors=(("body[1]", run.error),),
    )


@pytest.mark.parametrize("text", [SERVO.format(gain=10_000), SHOVED])
def test_states_of_a_plain_loop_are_those_of_a_repeat(text: str, tmp_path: Path) -> None:
    """Bit for bit, also where the last of 22 windows overlaps the one before it."""
    runs = runs_of(text, 0.43, tmp_path)
    model, motion = runs.models[0], motion_of_run(runs.models[0], runs.starts, 0, runs.steps)
    data, whole = mujoco.MjData(model), mujoco.mjtState.mjSTATE_INTEGRATION
    mujoco.mj_setState(model, data, motion.starts[0], whole)
    states = np.empty((runs.steps + 1, motion.starts.shape[1]))
    inputs = motion.rows(0, np.arange(runs.steps + 1))
    for step, row in enumerate(states):
        mujoco.mj_getState(model, data, row, whole)
        if inputs is not None:
            mujoco.mj_setState(model, data, inputs[step], motion.spec)
        mujoco.mj_step(model, data)
    found = backward_error(runs, 0, states)
    assert found == backward_error(runs, 0)
    assert found.share > 0


@pytest.mark.long
def test_workers_change_no_bit(tmp_path: Path) -> None:
    sweep = {"version": 1, "scene": "gripping_pad", "duration": 0.4, "checks": "all"}
    sweep |= {"axes": {"timestep": [0.002, 0.004]}, "trace": "none", "seeds": 2}
    found = [
        [(record.metrics["backward_error"], record.backward_error_body) for record in store]
        for workers in (1, 2)
        for store in [
            contactlab.sweep(sweep, output=tmp_path / str(workers), workers=workers).records()
        ]
    ]
    assert found[0] == found[1]
    assert all(share for share, _ in found[0])


@pytest.mark.parametrize(("checks", "passes"), [("none", 1), ("flagged", 2), ("all", 2)])
def test_a_second_pass_is_made_where_it_is_asked_for(
    checked: Checked, steps_made: list[int], checks: str, passes: int
) -> None:
    """The run is repeated once, whole, and gone through in windows at a quarter of its step."""
    checked(SERVO.format(gain=10_000), 1.0, checks)
    rollouts = [made for made in steps_made if made == 500]
    assert len(rollouts) == passes


@pytest.mark.long
@pytest.mark.parametrize("checks", ["none", "flagged"])
def test_switches_that_the_control_causes_are_no_chatter(checked: Checked, checks: str) -> None:
    drive = {"noise": 1.0, "rate": 20}
    assert checked(SHOVED, 2.0, checks, drive=drive).label == "stable"
