"""Parts that a model needs, and does not, where physics tells; and the smaller model."""

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.noisy_clock import disturb_clock

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.errors import SceneError
from contactlab.plan.task_options import read_task_options
from contactlab.schema.effects_report import EffectsReport, PartEffect
from contactlab.schema.time_ratio import TimeRatio
from contactlab.studies.effects.effects_request import EffectsRequest
from contactlab.studies.effects.effects_study import study_effects
from contactlab.tasks.session import Session
from contactlab.tasks.stress_motions import TILT_DEGREES, tilt_gravity

# A block stands and a door leans on its stop; the lamp hangs where nothing reaches it, and the
# other arm comes nowhere near its limit.
SHED = """<mujoco><compiler angle="radian"/><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="5 5 .1"/>
  <body name="block" pos="0 0 .05"><freejoint/><geom name="block" type="box" size=".05 .05 .05"/>
  </body>
  <body name="door" pos="3 0 1"><joint name="stop" axis="0 1 0" range="-1 0"/>
    <geom name="door" type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body>
  <body name="arm" pos="0 3 1"><joint name="free" axis="0 1 0" range="-3 3" damping=".01"/>
    <geom name="arm" type="capsule" size=".02" fromto="0 0 0 0 0 -.3"/></body>
</worldbody><actuator><motor name="idle" joint="free" ctrlrange="-1 1"/></actuator></mujoco>"""


def test_gravity_is_tilted_and_as_strong() -> None:
    model = mujoco.MjModel.from_xml_string(SHED)
    start = np.empty((1, mujoco.mj_stateSize(model, INTEGRATION)))
    mujoco.mj_getState(model, mujoco.MjData(model), start[0], INTEGRATION)
    gravity = tilt_gravity(Motion(model, start, np.empty((1, 5, 0)))).model.opt.gravity
    assert np.linalg.norm(gravity) == pytest.approx(9.81)
    assert -gravity[2] / 9.81 == pytest.approx(math.cos(math.radians(TILT_DEGREES)))
    assert model.opt.gravity[2] == -9.81


@pytest.fixture(scope="module")
def shed(tmp_path_factory: pytest.TempPathFactory) -> EffectsReport:
    folder: Path = tmp_path_factory.mktemp("shed")
    (folder / "shed.xml").write_text(SHED)
    task = read_task_options(drive="none", duration="0.2s")
    return study_effects(
        EffectsRequest(str(folder / "shed.xml"), task=task), Session(folder / "out")
    )


@pytest.mark.long
def test_verdicts_are_the_same_on_a_machine_that_is_busy(
    shed: EffectsReport, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("monotonic", "thread_time", "process_time"):
        disturb_clock(monkeypatch, name, 1, 1.0, 20.0)
    (tmp_path / "shed.xml").write_text(SHED)
    task = read_task_options(drive="none", duration="0.2s")
    request = EffectsRequest(str(tmp_path / "shed.xml"), task=task, max_cpu=3600.0)
    busy = study_effects(request, Session(tmp_path / "out", workers=0))
    rows = [
        {(one.name, one.verdict, one.error, one.can_go) for one in report.effects}
        for report in (shed, busy)
    ]
    assert rows[0] == rows[1]
    ratios = [{one.name: one.time_ratio for one in report.effects} for report in (shed, busy)]
    assert ratios[0] != ratios[1]


@pytest.mark.long
def test_what_carries_is_needed_and_friction_by_what_tilts(shed: EffectsReport) -> None:
    """On a slope of 20 degrees the block slides without friction, and stays with it."""
    friction = part(shed, "tangential_friction")
    assert (friction.verdict, friction.body) == ("needed", "block")
    assert friction.phase.endswith("tilted")
    for name in ("floor", "block", "gravity"):
        assert part(shed, name).verdict == "needed"


@pytest.mark.long
def test_what_cannot_touch_is_unused_by_proof(shed: EffectsReport) -> None:
    for name in ("door", "arm"):
        geom = next(each for each in shed.effects if (each.kind, each.name) == ("geom", name))
        # A block may be anywhere, so that no proof covers what it might reach.
        assert geom.verdict in ("unused", "not exercised")
        assert not geom.can_go


@pytest.mark.long
def test_a_limit_that_holds_is_needed_and_one_out_of_reach_is_kept(shed: EffectsReport) -> None:
    assert part(shed, "stop").verdict == "needed"
    free = part(shed, "free")
    assert free.verdict == "not exercised"
    # Nothing drives it in the task, and a step of its control turns the arm.
    assert part(shed, "idle").verdict == "needed"
    assert shed.noise_floor


@pytest.mark.parametrize(
    ("own", "holds"),
    [
        ('frictionloss="20"', True),
        pytest.param('stiffness="400" springlength=".5"', True, marks=pytest.mark.long),
        pytest.param("", False, marks=pytest.mark.long),
    ],
)
def test_a_tendon_is_needed_where_the_row_of_all_tendons_is(
    tmp_path: Path, own: str, holds: bool
) -> None:
    """A weight of 9.81 N on a slide falls, unless the one tendon there is holds it."""
    (tmp_path / "weight.xml").write_text(f"""<mujoco><option timestep="0.002"/><worldbody>
      <body name="weight"><joint name="up" type="slide" axis="0 0 1"/><geom size=".1" mass="1"/>
      </body></worldbody><tendon><fixed name="rope" {own}><joint joint="up" coef="1"/></fixed>
      </tendon></mujoco>""")
    task = read_task_options(drive="none", duration="0.1s")
    found = study_effects(
        EffectsRequest(str(tmp_path / "weight.xml"), task=task), Session(tmp_path / "out")
    )
    assert part(found, "rope").verdict == ("needed" if holds else "unused")


def part(report: EffectsReport, name: str) -> PartEffect:
    """Return the one part of a name."""
    return next(each for each in report.effects if each.name == name)


# Nothing twists the ball, and the feather leans on its stop by a billionth of the ball's weight.
BALL = """<mujoco><option timestep="0.002"/><worldbody>
  <geom type="plane" size="5 5 .1"/>
  <body name="ball" pos="0 0 .1"><joint type="slide" axis="0 0 1"/>
    <geom size=".1" mass="100" condim="4"/></body>
  <body name="feather" pos="3 0 1"><joint name="stop" axis="0 1 0" range="-1 0" limited="true"/>
    <geom type="capsule" size=".002" fromto="0 0 0 .01 0 0" mass="1e-5"/></body>
</worldbody></mujoco>"""


@pytest.mark.long
def test_what_no_force_shows_in_use_is_unused_only_if_no_bit_is_other(tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(BALL)
    request = EffectsRequest(
        str(tmp_path / "ball.xml"), task=read_task_options(drive="none", duration="0.02s")
    )
    report = study_effects(request, Session(tmp_path / "out"))
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "ball.xml"))

    def without_torsion(changed: mujoco.MjModel) -> None:
        changed.geom_condim[:] = np.minimum(changed.geom_condim, 3)

    def without_limits(changed: mujoco.MjModel) -> None:
        changed.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT

    for name, change in (
        ("torsional_friction", without_torsion),
        ("stop", without_limits),
    ):
        assert rolled(model, change) != rolled(model, lambda _: None)
        assert part(report, name).verdict not in ("unused", "not exercised")


def rolled(model: mujoco.MjModel, change: Callable[[mujoco.MjModel], None]) -> bytes:
    """Return the bits of where a changed model is after ten steps."""
    changed = copy.copy(model)
    change(changed)
    data = mujoco.MjData(changed)
    mujoco.mj_step(changed, data, 10)
    return data.qpos.tobytes()


# A crank that a motor of a millionth of its weight turns slowly, and a ball on an explicit pair.
CRANK = """<mujoco><option timestep="0.002" noslip_iterations="{noslip}"/><worldbody>
  <geom name="floor" type="plane" size="5 5 .1" contype="0" conaffinity="0"/>
  <body name="crank" pos="0 0 1"><joint name="turn" axis="0 0 1"/>
    <geom name="crank" type="capsule" size=".02" fromto="0 0 0 .3 0 0" contype="0" conaffinity="0"/>
  </body>
  <body name="ball" pos="1 0 .1"><freejoint/><geom name="ball" size=".1" condim="1"/></body>
</worldbody>
<contact><pair name="rest" geom1="ball" geom2="floor" condim="1"/></contact>
<tendon>{tendons}</tendon>
<actuator><motor name="weak" joint="turn" gear="0.001" ctrlrange="-1 1"/>
  <motor name="dead" joint="turn" gear="0" ctrlrange="-1 1"/></actuator>
</mujoco>"""
TENDONS = "".join(
    f"<fixed name='cord{number}'><joint joint='turn' coef='1'/></fixed>" for number in range(40)
)


@pytest.fixture(scope="module")
def crank(tmp_path_factory: pytest.TempPathFactory) -> EffectsReport:
    folder: Path = tmp_path_factory.mktemp("crank")
    (folder / "crank.xml").write_text(CRANK.format(noslip=10, tendons=TENDONS))
    task = read_task_options(drive="none", duration="0.1s")
    request = EffectsRequest(str(folder / "crank.xml"), task=task, write=folder / "new/small.xml")
    return study_effects(request, Session(folder / "out"))


@pytest.mark.long
def test_an_actuator_that_moves_its_joint_is_needed_however_weak(crank: EffectsReport) -> None:
    assert part(crank, "weak").verdict == "needed"
    assert part(crank, "dead").verdict == "not exercised"


@pytest.mark.long
def test_a_geom_goes_with_its_explicit_pairs(crank: EffectsReport) -> None:
    """Masks do not concern pairs. Without its pair the ball falls."""
    for name in ("ball", "floor", "rest"):
        assert part(crank, name).verdict == "needed"
        assert not part(crank, name).can_go


@pytest.mark.long
def test_the_smaller_model_lacks_what_is_unused_and_moves_alike(crank: EffectsReport) -> None:
    assert crank.smaller
    assert "noslip" in crank.smaller.left_out
    small = mujoco.MjModel.from_xml_path(crank.smaller.file)
    assert (small.ntendon, small.opt.noslip_iterations, small.npair) == (0, 0, 1)
    whole = mujoco.MjModel.from_xml_string(CRANK.format(noslip=10, tendons=TENDONS))
    assert rolled(small, lambda _: None) == rolled(whole, lambda _: None)
    assert [each.name for each in crank.effects if each.can_go][:1] != []


@pytest.mark.long
def test_a_kept_part_stays(tmp_path: Path) -> None:
    (tmp_path / "crank.xml").write_text(CRANK.format(noslip=10, tendons=TENDONS))
    task = read_task_options(drive="none", duration="0.05s")
    request = EffectsRequest(str(tmp_path / "crank.xml"), task=task, keep=("cord3", "noslip"))
    report = study_effects(request, Session(tmp_path / "out"))
    assert "cord3" not in part(report, "39 tendons").members
    assert report.smaller
    assert {"cord3", "noslip"}.isdisjoint(report.smaller.left_out)
    with pytest.raises(SceneError, match="no feature or part 'cord99'"):
        study_effects(replace(request, keep=("cord99",)), Session(tmp_path / "other"))


@pytest.mark.long
@pytest.mark.parametrize(
    ("low", "high", "end"),
    [
        (0.79, 1.01, "x0.90 (0.79 to 1.01) of the time, which is within noise"),
        (0.88, 0.92, "x0.90 (0.88 to 0.92) of the time"),
        (0.98, 1.01, "No smaller model: no set of parts saves more than 3 %"),
    ],
)
def test_only_a_time_that_disproves_the_saving_keeps_the_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, low: float, high: float, end: str
) -> None:
    """Counted work is the same on a busy machine, whose intervals are wide."""
    (tmp_path / "crank.xml").write_text(CRANK.format(noslip=10, tendons=TENDONS))
    measured = TimeRatio.of(0.9 if low < 0.9 else 0.99, low, high)
    timed = "contactlab.studies.effects.smaller_model.SmallerSearch._time_whole_runs"
    monkeypatch.setattr(timed, lambda *_: measured)
    task = read_task_options(drive="none", duration="0.05s")
    report = study_effects(
        EffectsRequest(str(tmp_path / "crank.xml"), task=task), Session(tmp_path / "out")
    )
    assert report.sentence.endswith(end)
    assert (report.smaller is None) == (not list((tmp_path / "out").rglob("*.xml")))
