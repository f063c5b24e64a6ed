"""A model of one's own is stripped of what it does not use, and of nothing else."""

from collections.abc import Callable

import pytest

from contactlab.scene.scene import Scene
from contactlab.schema.study_reports import RecordedEffectsReport

pytestmark = pytest.mark.long

Ablate = Callable[..., RecordedEffectsReport]
FEATURES = {
    "air",
    "limit",
    "tendon",
    "torsional_friction",
    "rolling_friction",
}
# Nothing spins about the normal, and the pendulum stays within its limits.
NOT_EXERCISED = {"limit", "torsional_friction"}
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
    density=50, torsion=0.01, roll=0.001, low=-60, stiffness=0.05, spin=50, sensors=""
)


@pytest.fixture(scope="module")
def report(ablate: Ablate) -> RecordedEffectsReport:
    """Return the ablation of the model that uses nothing."""
    return ablate(UNUSED, "keyframe=start", name="unused.xml")


def test_unused_features_are_stripped_and_metrics_hold(report: RecordedEffectsReport) -> None:
    assert {*report.smallest_set.off} >= FEATURES - NOT_EXERCISED | {"sensor"}
    assert report.verification.holds
    assert report.verification.reason == "no metric changes by its tolerance"
    assert all("duration" not in name for name in report.smallest_set.settings)


def test_what_no_run_exercised_is_kept(report: RecordedEffectsReport) -> None:
    found = {each.effect: each for each in report.effects}
    assert {found[name].verdict for name in NOT_EXERCISED} == {"not exercised"}
    assert {*report.smallest_set.on} >= NOT_EXERCISED
    assert found["limit"].reason == "not every joint and tendon moved into its limit"
    assert all("limit" not in line for line in report.smallest_set.mjcf)


def test_the_stripped_model_computes_none_of_it(report: RecordedEffectsReport) -> None:
    scene = Scene.open(report.source)
    values = {**report.base, **report.smallest_set.settings}
    run = scene.resolve(values, 0, None)
    model = scene.prepare(run, scene.initial_states([run])).model
    assert (model.ntendon, model.opt.density, model.geom_condim.max()) == (0, 0.0, 4)
    assert all(model.sensor(index).name.startswith("contactlab/") for index in range(model.nsensor))
    assert scene.resolve(values, 0, None).flags["limit"]


@pytest.mark.night
def test_features_that_act_are_kept(ablate: Ablate) -> None:
    report = ablate(USED, "keyframe=start", name="used.xml")
    needed = {each.effect for each in report.effects if each.verdict == "needed"}
    assert needed >= FEATURES
    assert {*report.smallest_set.on} >= FEATURES
