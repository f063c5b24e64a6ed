"""Models with a planted need keep it; one with planted waste loses that, and moves as before."""

import math
from pathlib import Path

import pytest

from contactlab.schema.coverage import Exercised
from contactlab.schema.study_reports import TuneReport
from contactlab.studies.session import Session
from contactlab.studies.tune.knobs import space_of
from contactlab.studies.tune.tune_request import TuneRequest
from contactlab.studies.tune.tuning import run

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
  <option timestep="0.004"><flag multiccd="enable" nativeccd="enable"/></option>
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


def tuned(folder: Path, text: str, seconds: float, error: float | None = None) -> TuneReport:
    """Tune a model for short runs, as a sweep asks."""
    (folder / "model.xml").write_text(text)
    sweep = folder / "short.yaml"
    sweep.write_text(f"{{version: 1, scene: model.xml, drive: none, duration: {seconds}}}")
    return run(TuneRequest(str(sweep), error=error, budget=1e9), Session(folder / "out"))


def kept(report: TuneReport, *names: str) -> bool:
    return not {each.name for each in report.changes} & set(names)


@pytest.mark.slow
def test_torsional_friction_that_stops_a_top_stays(tmp_path: Path) -> None:
    report = tuned(tmp_path, TOP, 0.2)
    assert kept(report, "torsional_friction")
    assert all(not each.name.startswith("torsional") for each in report.kept), "it was exercised"


@pytest.mark.slow
def test_noslip_that_holds_a_box_on_a_slope_stays(tmp_path: Path) -> None:
    assert kept(tuned(tmp_path, SLOPE, 0.3), "noslip")


@pytest.mark.slow
def test_multiccd_that_lets_a_bottle_stand_stays(tmp_path: Path) -> None:
    assert kept(tuned(tmp_path, BOTTLE, 0.2), "multiccd")


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
