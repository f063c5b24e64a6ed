"""Models with a planted need keep it; one with planted waste loses that, and moves as before."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.schema.coverage import Exercised
from contactlab.schema.study_reports import TuneReport
from contactlab.studies.session import Session
from contactlab_tune.knobs import space_of
from contactlab_tune.tune_request import TuneRequest
from contactlab_tune.tuning import run

TOP = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom type="plane" size="1 1 .1" condim="4" friction="1 .02 .001"/>
    <body pos="0 0 .05"><freejoint/><geom type="sphere" size=".05" condim="4"/></body>
  </worldbody>
  <keyframe><key qpos="0 0 .05 1 0 0 0" qvel="0 0 0 0 0 20"/></keyframe>
</mujoco>
"""
# The box would slide if the friction of 1 were not enough for a slope of 35 degrees, and creeps
# without noslip: (1 - d0) / (d0 b) of gravity along the slope, with b of 100/s, is 0.6 mm/s.
SLOPE = """
<mujoco>
  <option timestep="0.002" gravity="5.63 0 -8.04" cone="elliptic" noslip_iterations="10"/>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .05"><freejoint/><geom type="box" size=".05 .05 .05"/></body>
  </worldbody>
</mujoco>
"""
# A bottle stands on its rim: of contacts with a mesh, one is not enough to carry it upright.
RIM = [
    (0.04 * math.cos(each * math.pi / 8), 0.04 * math.sin(each * math.pi / 8)) for each in range(16)
]
BOTTLE = f"""
<mujoco>
  <option timestep="0.001"><flag multiccd="enable" nativeccd="enable"/></option>
  <asset>
    <mesh name="bottle" vertex="{" ".join(f"{x} {y} {z}" for z in (0, 0.3) for x, y in RIM)}"/>
  </asset>
  <worldbody>
    <geom type="box" size=".2 .2 .05" pos="0 0 -.05"/>
    <body><freejoint/><geom type="mesh" mesh="bottle"/></body>
  </worldbody>
</mujoco>
"""
# Contacts ask for 1 ms, and refsafe gives them two steps.
STIFF = """
<mujoco>
  <option timestep="0.004"/>
  <worldbody>
    <geom type="plane" size="1 1 .1" solref=".001 1"/>
    <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" solref=".001 1"/></body>
  </worldbody>
</mujoco>
"""
# A mug hangs between two fingers that press on it 2 cm off its centre of mass: only torsional
# friction holds it level. Each finger presses with 20 N, so that two contacts of 1 cm resist
# 0.4 N m against a weight of 0.1 kg at 2 cm, 0.02 N m.
MUG = """
<mujoco>
  <option timestep="0.002" cone="elliptic"/>
  <default><geom condim="4" friction="1 .01 .0001"/></default>
  <worldbody>
    <body pos="0 -.05 .5">
      <joint name="left" type="slide" axis="0 1 0" damping="5"/><geom type="sphere" size=".02"/>
    </body>
    <body pos="0 .05 .5">
      <joint name="right" type="slide" axis="0 -1 0" damping="5"/><geom type="sphere" size=".02"/>
    </body>
    <body name="mug" pos="0.02 0 .5">
      <freejoint/><geom type="box" size=".04 .03 .04" mass=".1"/>
    </body>
  </worldbody>
  <actuator><motor joint="left"/><motor joint="right"/></actuator>
  <keyframe><key ctrl="20 20"/></keyframe>
</mujoco>
"""
ARM = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="arm" pos="0 0 1">
      <joint name="hinge" axis="0 1 0" damping=".1"{limits}/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" contype="0" conaffinity="0"/>
      {more}
    </body>
  </worldbody>
  {end}
</mujoco>
"""
MOTOR = ARM.format(
    limits="",
    more="",
    end="""<actuator><position joint="hinge" kp="50" kv="5"/></actuator>
  <keyframe><key ctrl="-1"/></keyframe>""",
)
LIMIT = ARM.format(limits=' range="-90 5" limited="true"', more="", end="")
LOOP = ARM.format(
    limits="",
    more="""<body name="tip" pos=".3 0 0">
        <joint name="elbow" axis="0 1 0" damping=".1"/>
        <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" contype="0" conaffinity="0"/>
      </body>""",
    end='<equality><connect body1="tip" body2="world" anchor=".3 0 0"/></equality>',
)
# Boxes at rest spin and rub nowhere, and their contacts have six dimensions for nothing.
REST = """
<mujoco>
  <option timestep="0.002" cone="elliptic"/>
  <default><geom condim="3" friction="1 .005 .0001"/></default>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .05"><freejoint/><geom type="box" size=".1 .1 .05"/></body>
    <body pos="0 0 .15"><freejoint/><geom type="box" size=".1 .1 .05"/></body>
  </worldbody>
</mujoco>
"""
WASTE = """
<mujoco>
  <option timestep="0.001" integrator="RK4"/>
  <worldbody>
    <body pos="0 0 1">
      <joint name="a" axis="0 1 0" damping=".2" range="-60 60" limited="true"/>
      <geom name="a" type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>
      <geom name="dress" type="box" size=".02 .02 .02" pos=".1 0 0"/>
    </body>
    <body pos="0 1 1">
      <joint name="b" axis="0 1 0" damping=".2" range="-60 60" limited="true"/>
      <geom name="b" type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>
    </body>
  </worldbody>
</mujoco>
"""


Break = Callable[[mujoco.MjModel], None]


def with_condim(dimensions: int) -> Break:
    def without(model: mujoco.MjModel) -> None:
        model.geom_condim[:] = dimensions

    return without


def without_noslip(model: mujoco.MjModel) -> None:
    model.opt.noslip_iterations = 0


def disabled(flag: mujoco.mjtDisableBit) -> Break:
    def without(model: mujoco.MjModel) -> None:
        model.opt.disableflags |= int(flag)

    return without


OFF = mujoco.mjtDisableBit
NEEDS = {
    "torsional friction that stops a top": (TOP, 0.1, with_condim(3)),
    "friction that holds a mug": (MUG, 0.15, with_condim(3)),
    "noslip that holds a box on a slope": (SLOPE, 0.2, without_noslip),
    "multiccd that lets a bottle stand": (BOTTLE, 0.1, disabled(OFF.mjDSBL_MULTICCD)),
    "refsafe of stiff contacts": (STIFF, 0.1, disabled(OFF.mjDSBL_REFSAFE)),
    "a motor that moves": (MOTOR, 0.2, disabled(OFF.mjDSBL_ACTUATION)),
    "a limit that stops": (LIMIT, 0.2, disabled(OFF.mjDSBL_LIMIT)),
    "a loop that closes": (LOOP, 0.2, disabled(OFF.mjDSBL_EQUALITY)),
}


def tuned(
    folder: Path, text: str, seconds: float, error: float | None = None, free: Sequence[str] = ()
) -> TuneReport:
    """Tune a model for short runs, as a sweep asks."""
    (folder / "model.xml").write_text(text)
    sweep = folder / "short.yaml"
    sweep.write_text(f"{{version: 1, scene: model.xml, drive: none, duration: {seconds}}}")
    request = TuneRequest(str(sweep), error=error, budget=1e9, free=free)
    return run(request, Session(folder / ("free" if free else "out")))


def final(model: mujoco.MjModel, seconds: float) -> np.ndarray:
    """Return where points 5 cm from the origins of bodies end, by plain MuJoCo [m]."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, nstep=round(seconds / model.opt.timestep))
    mujoco.mj_kinematics(model, data)
    axes = 0.05 * data.xmat.reshape(-1, 3, 3).swapaxes(1, 2)
    return data.xpos[:, None] + axes


def rows(model: mujoco.MjModel) -> int:
    """Return how many constraint rows a model has at rest."""
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=100)
    return int(data.nefc)


def kept(report: TuneReport, *names: str) -> bool:
    return not {each.name for each in report.changes} & set(names)


@pytest.mark.slow
@pytest.mark.parametrize("need", NEEDS)
def test_what_the_motion_needs_stays(tmp_path: Path, need: str) -> None:
    """The model that is recommended ends where the model as written does; without the need, not.

    Both are within the limit of the same reference, so that they are within twice as much.
    """
    text, seconds, take_away = NEEDS[need]
    report = tuned(tmp_path, text, seconds)
    file = tmp_path / "out" / report.file if report.file else tmp_path / "model.xml"
    written = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    end, most = final(written, seconds), 2 * report.limits["error_peak"]
    found = final(mujoco.MjModel.from_xml_path(str(file)), seconds)
    assert np.abs(found - end).max() <= most
    take_away(written)
    assert not np.abs(final(written, seconds) - end).max() <= most


@pytest.mark.slow
def test_what_no_run_exercised_goes_on_request_only(tmp_path: Path) -> None:
    """Contacts at rest carry nothing in their further rows, which may matter to other runs."""
    text = REST.replace('condim="3"', 'condim="6"')
    names = ("torsional_friction", "rolling_friction")
    report = tuned(tmp_path, text, 0.2, free=names)
    assert report.file is not None
    tuned_model = mujoco.MjModel.from_xml_path(str(tmp_path / "free" / report.file))
    original, wasteful = map(mujoco.MjModel.from_xml_string, (REST, text))
    assert rows(wasteful) >= 2 * rows(original)
    assert rows(tuned_model) <= 1.2 * rows(original)
    assert np.abs(final(tuned_model, 0.2) - final(original, 0.2)).max() <= 1e-5
    asked = tuned(tmp_path, text, 0.2)
    assert kept(asked, *names)
    said = {each.name: each.reason for each in asked.kept}
    assert all(said[name].endswith(f"or --free {name}") for name in names)


def test_refsafe_is_nothing_to_search(tmp_path: Path) -> None:
    """What guards against settings, and what a model is made of, is no knob."""
    path = tmp_path / "model.xml"
    path.write_text(STIFF)
    setup = TuneRequest(str(path)).setup
    every = Exercised.of([{"coverage": None}])
    space, _ = space_of(setup, every, ())
    names = {name for knob in space.knobs for each in knob.values for name in each}
    guards = {
        "refsafe",
        "contact",
        "gravity",
        "actuation",
        "limit",
        "equality",
        "damper",
        "friction",
    }
    assert names
    assert not names & guards


@pytest.mark.slow
def test_what_never_touches_and_short_steps_go(tmp_path: Path) -> None:
    report = tuned(tmp_path, WASTE, 0.4, 1e-4)
    assert report.proof is not None
    assert report.proof.holds
    assert {"dress", "a", "b"} == set(report.masked)
    assert {each.name for each in report.changes} & {"timestep", "integrator"}
    assert report.proof.tuned.error_peak is not None
    assert report.proof.tuned.error_peak <= 1e-4
    assert report.proof.same_runs == 10
