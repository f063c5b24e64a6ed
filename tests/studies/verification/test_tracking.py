"""A step and a sine are compared apart, so that drift after one hides no delay of the other."""

from pathlib import Path

from contactlab.budget import Motion
from contactlab.schema.verification import VerifiedMeasure
from contactlab.studies.verification.run_measures import compare_run, tabulate_run
from contactlab.studies.verification.runs import build_tracking_runs
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session

PENDULUM = """
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <body name="pole" pos="0 0 1">
      <joint name="hinge" axis="0 1 0" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 0 .5" size=".045" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="hinge" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
"""It begins upright, and falls after a step. Euler's error grows with it."""


def _first_phase(folder: Path, text: str) -> Motion:
    folder.mkdir()
    (folder / "pendulum.xml").write_text(text)
    return open_model(str(folder / "pendulum.xml"), Session(folder / "results")).motions[0]


def test_the_delay_of_a_long_step_shows_in_its_sine(tmp_path: Path) -> None:
    """RK4 at four times the step follows a step better, and a sine 7.5 ms later."""
    original = _first_phase(tmp_path / "original", PENDULUM)
    text = PENDULUM.replace('timestep="0.005"', 'timestep="0.02" integrator="RK4"')
    changed = _first_phase(tmp_path / "changed", text)
    found = dict[str, VerifiedMeasure]()
    for run in build_tracking_runs(original, changed, [0]):
        for measure in compare_run(run, tabulate_run(run, 1, {}), 0.0):
            if measure.name == "tracking error":
                found[run.name] = measure
    step, sine = found["step"], found["sine of 1 Hz"]
    assert step.before is not None
    assert step.after is not None
    assert step.after < step.before
    assert not step.worse
    assert sine.worse
