"""A model of one's own is stripped of what it does not use, and of nothing else."""

from pathlib import Path

import pytest

from contactlab.plan.task_options import read_task_options
from contactlab.schema.effects_report import EffectsReport
from contactlab.studies.effects.effects_request import EffectsRequest
from contactlab.studies.effects.effects_study import study_effects
from contactlab.tasks.session import Session

pytestmark = pytest.mark.long

_SENSORS = "".join(f"<jointpos name='s{index}' joint='swing'/>" for index in range(12))
# A box slides to rest; a pendulum swings beside it, and a ball rolls and spins.
MODEL = """
<mujoco>
  <option cone="elliptic" density="{density}"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1" condim="6" friction="1 {torsion} {roll}"/>
    <body name="ball" pos="0 0 .05"><freejoint name="ball"/>
      <geom name="ball" size=".05" mass=".5" condim="6" friction="1 {torsion} {roll}"/></body>
    <body name="arm" pos="0 2 1">
      <joint name="swing" axis="1 0 0" range="{low} 230" limited="true"/>
      <geom name="arm" type="capsule" fromto="0 0 0 0 .3 0" size=".02" mass=".2" contype="0"
        conaffinity="0"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="cord" stiffness="{stiffness}"><joint joint="swing" coef="1"/></fixed>
  </tendon>
  <sensor>{sensors}</sensor>
  <keyframe><key name="start" qvel="1 0 0 0 20 {spin} 0"/></keyframe>
</mujoco>
"""
UNUSED = MODEL.format(
    density=1e-3, torsion=0, roll=0, low=-230, stiffness=0, spin=0, sensors=_SENSORS
)
USED = MODEL.format(
    density=120, torsion=0.01, roll=0.01, low=-60, stiffness=0.15, spin=50, sensors=""
)


def study_text(folder: Path, text: str, name: str) -> EffectsReport:
    """Return the effects of a model, which begins in its keyframe."""
    (folder / name).write_text(text)
    task = read_task_options(duration="0.6s", keyframe="start")
    return study_effects(EffectsRequest(str(folder / name), task=task), Session(folder / "out"))


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> EffectsReport:
    return study_text(tmp_path_factory.mktemp("unused"), UNUSED, "unused.xml")


def test_unused_parts_are_left_out(report: EffectsReport) -> None:
    found = {each.name: each for each in report.effects}
    assert found["cord"].verdict == found["sensors"].verdict == "unused"
    assert found["air"].verdict == "below the tolerance"
    assert report.smaller
    assert {"cord", "sensors"} <= {*report.smaller.left_out}


def test_a_safeguard_stays(report: EffectsReport) -> None:
    limit = next(each for each in report.effects if (each.kind, each.name) == ("limit", "swing"))
    assert limit.verdict == "not exercised"
    assert not limit.can_go


def test_features_that_act_are_needed(tmp_path: Path) -> None:
    report = study_text(tmp_path, USED, "used.xml")
    found = {each.name: each.verdict for each in report.effects}
    needed = {name for name, verdict in found.items() if verdict == "needed"}
    assert needed >= {"air", "cord", "torsional_friction", "rolling_friction", "swing"}
