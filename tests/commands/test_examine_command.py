"""`contactlab examine`: the budget of a model's own task, its verdict, and what mends it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from jsonschema import Draft202012Validator

import contactlab as package
from contactlab.budget import Motion, error_budget, judge
from contactlab.budget.motion import INTEGRATION
from contactlab.contact.trace_arrays import Floats
from contactlab.errors import EngineError, SceneError, SweepFileError
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.initial_states import apply_inputs
from contactlab.schema.error_budget import BudgetRow
from contactlab.schema.examination import Examination
from contactlab.schema.json_schemas import json_schemas
from contactlab.studies.examine.examination_lines import examination_lines
from contactlab.studies.examine.facts import facts
from contactlab.studies.examine.task_motions import task_motions

Run = Callable[..., Any]
ARM = """<mujoco><option timestep="0.004"/><worldbody>
  <geom name="floor" type="plane" size="1 1 .1"/>
  <body name="upper" pos="0 0 .4"><joint name="shoulder" axis="0 1 0" damping=".1"/>
    <geom type="capsule" size=".03" fromto="0 0 0 .25 0 0"/>
    <body name="fore" pos=".25 0 0"><joint name="elbow" axis="0 1 0" damping=".1"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .2 0 0"/></body></body></worldbody>
  <actuator><motor joint="shoulder" gear="3" ctrlrange="-1 1"/>
    <motor joint="elbow" ctrlrange="-1 1"/></actuator></mujoco>
"""
# A velocity servo of gain k on a joint of inertia I is unstable under explicit steps h > 2 I / k.
# The knee's I is .3 kg (.2 m)^2 / 3 = 4e-3 kg m^2 about its joint, and less where the thigh gives
# way, which it does little: 2 I / k = 3.6 ms.
SERVO = """<mujoco><option timestep="0.005" integrator="Euler"/><worldbody>
  <body name="thigh" pos="0 0 1"><joint name="left_hip" axis="0 1 0" damping="1"/>
    <geom type="capsule" size=".03" fromto="0 0 0 0 0 -.3" mass="2"/>
    <body name="shin" pos="0 0 -.3"><joint name="left_knee" axis="0 1 0"/>
      <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass=".3"/></body></body></worldbody>
  <actuator><position joint="left_hip" kp="50" kv="5" ctrlrange="-1 1"/>
    <position joint="left_knee" kp="100" kv="2.2" ctrlrange="-1 1"/></actuator></mujoco>
"""


@pytest.fixture
def arm(tmp_path: Path) -> str:
    """A model that the exercise drives through two phases."""
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    return str(path)


def stepped(model: str, seconds: float) -> list[Motion]:
    """Make the motions of both phases by one obvious loop over `mj_step`."""
    scene = SceneLoader(Path()).open(model).with_effects("all")
    task = scene.task({}, seconds)
    runs = [scene.resolve({}, seed, seconds) for seed in task.seeds]
    starts = scene.starts(runs)
    compiled = scene.prepare(runs[0], starts.pick(0)).model
    begin = round(task.phases[1].begin / compiled.opt.timestep)
    spans = {"neutral": (0, begin), "excitement": (begin, runs[0].steps)}
    states = np.empty((len(runs), runs[0].steps, mujoco.mj_stateSize(compiled, INTEGRATION)))
    inputs = list[Floats]()
    for run in range(len(runs)):
        data, start = mujoco.MjData(compiled), starts.pick(run)
        data.qpos[:], data.qvel[:] = start.qpos[0], start.qvel[0]
        rows = start.inputs(0, compiled.opt.timestep, np.arange(runs[0].steps))
        inputs.append(rows[:, : compiled.nu + 6 * compiled.nbody])
        for step, row in enumerate(rows):
            apply_inputs(compiled, data, row)
            mujoco.mj_getState(compiled, data, states[run, step], INTEGRATION)
            mujoco.mj_step(compiled, data)
    spec = int(mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_XFRC_APPLIED)
    return [
        Motion(compiled, states[:, first], np.stack(inputs)[:, first:last], spec, name)
        for name, (first, last) in spans.items()
    ]


def shares(rows: tuple[BudgetRow, ...]) -> dict[str, object]:
    """Return all of rows that hangs on no clock."""
    return {row.name: row.model_dump(exclude={"price"}) for row in rows}


@pytest.mark.long
def test_it_is_the_budget_of_the_phases_that_mj_step_makes(arm: str) -> None:
    report = package.examine(arm, duration=0.3, workers=1)
    budget = error_budget(stepped(arm, 0.3), workers=1)
    verdict = judge(budget, 0.1)
    assert report.budget.verdict == verdict.word
    assert [phase.name for phase in report.budget.phases] == ["neutral", "excitement"]
    for phase, measured in zip(report.budget.phases, budget.phases, strict=True):
        assert phase.run.share == measured.run.share
        assert {row.name: row.share for row in phase.rows if row.exercised} == {
            row.name: row.share for row in measured.rows if row.exercised
        }


def test_motions_are_those_that_mj_step_makes(arm: str) -> None:
    scene = SceneLoader(Path()).open(arm).with_effects("all")
    made, obvious = task_motions(scene, {}, scene.task({}, 0.3)), stepped(arm, 0.3)
    assert [motion.name for motion in made] == [motion.name for motion in obvious]
    for one, other in zip(made, obvious, strict=True):
        width = one.inputs.shape[2]
        np.testing.assert_array_equal(one.inputs, other.inputs[:, :, :width])
        assert not other.inputs[:, :, width:].any()
        before = mujoco.mj_stateSize(one.model, INTEGRATION & ~(INPUTS))
        np.testing.assert_array_equal(one.starts[:, :before], other.starts[:, :before])


# What a state has of inputs comes after what steps make, and is set anew before each step.
INPUTS = sum(
    int(getattr(mujoco.mjtState, f"mjSTATE_{name}"))
    for name in ("CTRL", "QFRC_APPLIED", "XFRC_APPLIED", "EQ_ACTIVE", "MOCAP_POS", "MOCAP_QUAT")
)


@pytest.mark.long
def test_workers_change_no_bit(arm: str) -> None:
    one, two = (package.examine(arm, duration=0.2, workers=count) for count in (1, 2))
    assert one.budget.reasons == two.budget.reasons
    assert {remedy.name: remedy.share for remedy in one.budget.remedies} == {
        remedy.name: remedy.share for remedy in two.budget.remedies
    }
    for first, second in zip(one.budget.phases, two.budget.phases, strict=True):
        assert shares((first.run, *first.rows)) == shares((second.run, *second.rows))


@pytest.mark.long
def test_a_report_fits_its_schema(arm: str, contactlab: Run, tmp_path: Path) -> None:
    printed = contactlab(
        "examine", arm, "--duration", "0.1", "--format", "json", "-o", tmp_path / "arm.json"
    )
    data = json.loads(printed.out)
    Draft202012Validator(json_schemas()["examination.schema.json"]).validate(data)
    assert json.loads((tmp_path / "arm.json").read_text()) == data
    report = Examination.model_validate_json(printed.out)
    assert printed.code == (0 if report.sound else 1)
    assert max(map(len, examination_lines(report))) <= 80
    lines = examination_lines(report, full=True)
    assert max(map(len, lines)) <= 80
    words = " ".join(" ".join(lines).split())
    for phase in report.budget.phases:
        idle = ", ".join(row.name for row in phase.rows if not row.exercised)
        assert idle
        assert f"never exercised: {idle} energy drift" in words
    # Times count from the beginning of the run, where the table has them.
    excitement = report.budget.phases[1]
    [gravity] = [row for row in excitement.rows if row.name == "gravity"]
    assert gravity.time is not None
    began = report.task.phases[1].begin
    *_, line = [line for line in lines if line.startswith("  gravity ")]
    assert line.endswith(f"{gravity.body}, {began + gravity.time:.2f} s")


@pytest.mark.long
def test_an_unstable_servo_is_named_with_what_mends_it(tmp_path: Path, contactlab: Run) -> None:
    path = tmp_path / "servo.xml"
    path.write_text(SERVO)
    printed = contactlab("examine", str(path), "--duration", "0.3", "--format", "json")
    assert printed.code == 1
    # What MuJoCo says of it is data, and neither on the terminal nor in a file.
    assert "WARNING" not in printed.err
    assert not list(tmp_path.rglob("MUJOCO_LOG.TXT"))
    report = Examination.model_validate_json(printed.out)
    assert report.sentence.startswith("unresolved: ")
    assert "left_knee" in report.sentence
    mends = [remedy.name for remedy in report.budget.remedies if remedy.removes]
    assert "implicitfast" in mends
    assert 1 <= len(report.changes) <= 3
    assert [change.name for change in report.changes] == mends[: len(report.changes)]
    assert not any(change.physics or change.unwritten for change in report.changes)
    (line,) = report.changes[0].lines
    assert line.startswith("servo.xml:1: <option ")
    for settings in ({"integrator": "implicitfast"}, {"timestep": 0.005 / 16}):
        mended = package.examine(path, duration=0.3, set=settings)
        assert mended.budget.verdict != "unresolved", settings


@pytest.mark.long
def test_the_written_model_is_sound(tmp_path: Path, contactlab: Run) -> None:
    """It is the author's model but for the options of the first change, and judged by others."""
    (tmp_path / "servo.xml").write_text(SERVO)
    printed = contactlab("servo.xml", "--duration", "0.3", "--write", "new/sound.xml")
    assert printed.code == 1
    assert "the model with the first change: new/sound.xml" in printed.out
    assert (tmp_path / "new/sound.patch").is_file()
    assert package.examine(tmp_path / "new/sound.xml", duration=0.3).sound
    before, after = (
        mujoco.MjModel.from_xml_path(str(tmp_path / name))
        for name in ("servo.xml", "new/sound.xml")
    )
    for model in (before, after):
        model.opt.timestep, model.opt.integrator = 1.0, 0
    sizes = mujoco.mj_sizeModel(before)
    texts = [np.empty(sizes, np.uint8) for _ in range(2)]
    for model, text in zip((before, after), texts, strict=True):
        mujoco.mj_saveModel(model, None, text)
    # The files' own names are in what is saved of a model.
    assert mujoco.mj_sizeModel(after) == sizes
    assert (texts[0] != texts[1]).sum() < len("servo.xml") + len("sound.xml")


def test_facts_are_those_of_the_model(tmp_path: Path) -> None:
    """A box of 2 kg in 8 l, 20 mm in the floor: a fifth of its half; a ball of air beside it."""
    path = tmp_path / "sunk.xml"
    path.write_text(
        """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
        <body name="box" pos="0 0 .08"><freejoint/>
          <geom type="box" size=".1 .1 .1" mass="2"/></body>
        <body name="air" pos=".5 0 .1"><freejoint/><geom size=".1" mass=".005"/></body>
        </worldbody></mujoco>"""
    )
    scene = SceneLoader(Path()).open(str(path)).with_effects("all")
    motions = task_motions(scene, {}, scene.task({}, 0.02))
    found = {fact.kind: fact for fact in facts(motions, [0.0] * len(motions))}
    assert found["overlap"].place == "contact world - box"
    # The start of a seed differs from the author's by less than a millimetre.
    assert found["overlap"].value == pytest.approx(0.02, abs=1e-3)
    assert "of half the thinner geom" in found["overlap"].sentence
    assert found["depth"].value >= found["overlap"].value
    density = 0.005 / (4 / 3 * np.pi * 0.1**3)
    assert found["inertia"].place == "air"
    assert found["inertia"].value == pytest.approx(density)


@pytest.mark.long
def test_only_watched_bodies_count(arm: str) -> None:
    report = package.examine(arm, duration=0.1, watch=["upper"])
    assert report.task.watched == ("upper",)
    for phase in report.budget.phases:
        assert phase.bodies == ("upper",)
        assert {row.body for row in (phase.run, *phase.rows) if row.exercised} == {"upper"}
    whole = package.examine(arm, duration=0.1)
    for some, every in zip(report.budget.phases, whole.budget.phases, strict=True):
        assert some.run.share is not None
        assert every.run.share is not None
        assert some.run.share <= every.run.share


def test_a_phase_that_no_seed_reaches_is_left_out(tmp_path: Path) -> None:
    # The forearm has .3 kg over .2 m, so I < .01 kg m^2, and an explicit step multiplies its speed
    # by 1 - k h / I < -300: it bursts within a few steps of the fall, which begins at once.
    path = tmp_path / "burst.xml"
    velocity = '<velocity name="brake" joint="elbow" kv="1000"/></actuator>'
    path.write_text(ARM.replace("</actuator>", velocity))
    scene = SceneLoader(Path()).open(str(path)).with_effects("all")
    burst = task_motions(scene, {}, scene.task({}, 0.6))
    assert [(motion.name, motion.seeds) for motion in burst] == [("neutral", 3)]


def test_bad_input_is_named(arm: str) -> None:
    with pytest.raises(SweepFileError, match="share"):
        package.examine(arm, within="1mm")
    with pytest.raises(SceneError, match="nobody"):
        package.examine(arm, watch=["nobody"])
    with pytest.raises(EngineError, match="impulse"):
        package.examine(arm, set={"engine": "impulse"})
