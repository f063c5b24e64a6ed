"""A policy acts in the loop of all runs of a verification; its controls are not replayed."""

from pathlib import Path

import pytest

from contactlab.plan.task_options import TaskOptions
from contactlab.schema.drive import PolicyDrive, parse_drive
from contactlab.schema.verification import VerifiedChange
from contactlab.studies.verification import VerificationRequest, has_policy, verify_change
from contactlab.tasks.checked_model import CheckedModel, open_model
from contactlab.tasks.session import Session

WHEEL = """
<mujoco>
  <option timestep="{timestep}" gravity="{gravity}" integrator="{integrator}"/>
  <worldbody>
    <body name="wheel">
      <joint name="wheel" axis="0 1 0" armature="{armature}"/>
      <geom type="capsule" fromto="0 0 0 .1 0 0" size=".01" mass=".01"/>
    </body>
  </worldbody>
  <actuator><motor name="wheel" joint="wheel" ctrlrange="-5 5"/></actuator>
</mujoco>
"""
POLE = WHEEL.replace('fromto="0 0 0 .1 0 0"', 'fromto="0 0 0 0 0 .5"')
INERTIA = 0.01 * 0.1**2 / 3
"""Of the wheel, roughly [kg m2]."""
POLICY = """
class Damp:
    def __init__(self, model):
        pass

    def __call__(self, time, qpos, qvel, sensordata):
        return {gain} * (0.1 - qpos) - {damping} * qvel
"""
LOOP_MEASURES = ("tracking error", "end position")


def _verify(
    folder: Path,
    damping: float,
    must_improve: tuple[str, ...],
    model: str = WHEEL,
    gravity: str = "0 0 0",
    **change: object,
) -> VerifiedChange:
    policy = folder / "policy.py"
    policy.write_text(POLICY.format(gain=damping, damping=damping))
    drive = parse_drive({"policy": f"{policy}:Damp", "rate": 500})
    assert isinstance(drive, PolicyDrive)

    def open_wheel(name: str, **values: object) -> CheckedModel:
        (folder / name).mkdir()
        own = {"integrator": "Euler", "armature": 0, "timestep": 0.002, "gravity": gravity}
        text = model.format(**{**own, **values})
        (folder / name / "wheel.xml").write_text(text)
        session = Session(folder / name / "results", allow_code=True)
        options = TaskOptions(drive=drive, duration=1.0)
        return open_model(str(folder / name / "wheel.xml"), session, options)

    original, changed = open_wheel("original"), open_wheel("changed", **change)
    assert has_policy(original)
    return verify_change(
        VerificationRequest(
            original, changed, same_model=not change.get("armature"),
            keeps_motion=not change.get("armature"), must_improve=must_improve, with_labels=False,
        )
    )  # fmt: skip


def test_a_balanced_pole_is_compared_in_its_loop(tmp_path: Path) -> None:
    """A replay of its controls at another step would let an upright pole fall by radians."""
    found = _verify(tmp_path, 0.05, (), gravity="0 0 -9.81", timestep=0.001, model=POLE)
    tracking = [measure for measure in found.measures if measure.name == "tracking error"]
    assert found.passed, found.sentence
    assert "numerical error" in {skipped.run for skipped in found.skipped}
    assert 0 < max(measure.before or 0.0 for measure in tracking) < 1e-2


@pytest.mark.long
def test_armature_may_end_an_oscillation(tmp_path: Path) -> None:
    """Damping c, held for a step h, multiplies a speed by 1 - c h / I: below -1 it grows."""
    found = _verify(tmp_path, 3 * INERTIA / 0.002, (), armature=9 * INERTIA)
    assert found.passed, found.sentence


@pytest.mark.long
def test_an_equal_loop_improves_nothing(tmp_path: Path) -> None:
    """Without joint damping, implicitfast computes what Euler does, to the bit."""
    found = _verify(tmp_path, 0.5 * INERTIA / 0.002, LOOP_MEASURES, integrator="implicitfast")
    assert found.identical
    assert not found.passed
    assert found.sentence.startswith("no better")
