"""A step and a sine are compared apart, so that drift after one hides no delay of the other.

Without constraints, no change of a constraint shows.
"""

from pathlib import Path

from contactlab.budget import Motion
from contactlab.schema.verification import VerifiedMeasure
from contactlab.studies.verification.run_measures import compare_run, tabulate_run
from contactlab.studies.verification.runs import build_tracking_runs, build_unconstrained_runs
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
    folder.mkdir(parents=True)
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


def test_a_shorter_step_follows_a_sine_more_closely(tmp_path: Path) -> None:
    """Each step holds its control, for half of it too long: half the step has half the delay."""
    original = _first_phase(tmp_path / "original", PENDULUM)
    text = PENDULUM.replace('timestep="0.005"', 'timestep="0.0025"')
    changed = _first_phase(tmp_path / "changed", text)
    _, sine = build_tracking_runs(original, changed, [0])
    (found,) = (
        measure
        for measure in compare_run(sine, tabulate_run(sine, 1, {}), 0.0)
        if measure.name == "tracking error"
    )
    assert found.before is not None
    assert found.after is not None
    assert found.after < 0.6 * found.before


STOPPED = PENDULUM.replace('damping="0.1"', 'damping="0.1" range="-60 60" solreflimit="0.02 1"')
"""It falls against its stop within a second."""


def _compare_step(folder: Path, text: str, *, keeps_motion: bool) -> VerifiedMeasure:
    original = _first_phase(folder / "original", STOPPED)
    changed = _first_phase(folder / "changed", text)
    step, _ = build_tracking_runs(original, changed, [0])
    tables = tabulate_run(step, 1, {})
    (found,) = (
        measure
        for measure in compare_run(step, tables, 0.0, keeps_motion=keeps_motion)
        if measure.name == "tracking error"
    )
    return found


def test_a_bounce_from_a_stop_says_nothing_about_an_actuator(tmp_path: Path) -> None:
    """A stop that bounces is meant to change the motion, and changes nothing before it."""
    bouncing = STOPPED.replace("0.02 1", "0.04 0.3")
    assert _compare_step(tmp_path / "whole", bouncing, keeps_motion=True).worse
    until_stop = _compare_step(tmp_path / "until stop", bouncing, keeps_motion=False)
    assert not until_stop.worse
    assert until_stop.before == until_stop.after


def test_a_weaker_actuator_shows_before_the_stop(tmp_path: Path) -> None:
    weaker = STOPPED.replace('joint="hinge" ctrl', 'joint="hinge" gear="0.5" ctrl')
    assert _compare_step(tmp_path, weaker, keeps_motion=False).worse


def test_another_stop_keeps_the_motion_without_constraints(tmp_path: Path) -> None:
    original = _first_phase(tmp_path / "original", STOPPED)
    changed = _first_phase(tmp_path / "changed", STOPPED.replace("0.02 1", "0.04 0.3"))
    for run in build_unconstrained_runs(original, changed, [0]):
        tables = tabulate_run(run, 1, {})
        assert tables.changed.bits == tables.original.bits, run.name
    (step, _) = build_tracking_runs(original, changed, [0])
    tables = tabulate_run(step, 1, {})
    assert tables.changed.bits != tables.original.bits


def test_a_step_finer_than_the_usual_reference_is_its_own_reference(tmp_path: Path) -> None:
    """A coarser reference would have an error of its own, and the finer step would differ by it."""
    original = _first_phase(tmp_path / "original", PENDULUM)
    changed = _first_phase(tmp_path / "changed", PENDULUM.replace("0.005", "0.0005"))
    still, *steps = build_unconstrained_runs(original, changed, [0])
    tables = tabulate_run(still, 1, {})
    assert tables.changed.bits == tables.reference.bits != tables.original.bits
    for run in (*steps, *build_tracking_runs(original, changed, [0])):
        assert run.reference.model.opt.timestep == changed.model.opt.timestep
