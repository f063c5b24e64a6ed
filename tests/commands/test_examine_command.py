"""`contactlab examine`: the budget of a model's own task, its verdict, and what mends it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np
import pytest
from jsonschema import Draft202012Validator
from tests.noisy_clock import disturb_clock

import contactlab as package
from contactlab.budget import Motion, error_budget, judge
from contactlab.budget.motion import INTEGRATION
from contactlab.contact.trace_arrays import Floats
from contactlab.errors import EngineError, OutputError, SceneError, SweepFileError
from contactlab.rendering.text import render_text
from contactlab.reporting.examination_document import describe_examination
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.initial_states import apply_inputs
from contactlab.schema.error_budget import BudgetRow
from contactlab.schema.examination import Examination
from contactlab.schema.json_schemas import json_schemas
from contactlab.studies.examine.facts import list_facts, list_inertia_facts
from contactlab.tasks.task_motions import task_motions

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
    starts = scene.initial_states(runs)
    compiled = scene.prepare(runs[0], starts.select_run(0)).model
    begin = round(task.phases[1].begin / compiled.opt.timestep)
    spans = {"rest": (0, begin), "excitation": (begin, runs[0].steps)}
    states = np.empty((len(runs), runs[0].steps, mujoco.mj_stateSize(compiled, INTEGRATION)))
    inputs = list[Floats]()
    for run in range(len(runs)):
        data, start = mujoco.MjData(compiled), starts.select_run(run)
        data.qpos[:], data.qvel[:] = start.qpos[0], start.qvel[0]
        rows = start.input_rows(0, compiled.opt.timestep, np.arange(runs[0].steps))
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
    return {row.name: row.model_dump(exclude={"time_ratio"}) for row in rows}


@pytest.mark.long
def test_it_is_the_budget_of_the_phases_that_mj_step_makes(arm: str) -> None:
    report = package.examine(arm, section=["budget"], duration=0.3, workers=1)
    assert report.budget
    budget = error_budget(stepped(arm, 0.3), workers=1)
    verdict = judge(budget, 0.1)
    assert report.budget.verdict == verdict.word
    assert [phase.name for phase in report.budget.phases] == ["rest", "excitation"]
    for phase, measured in zip(report.budget.phases, budget.phases, strict=True):
        assert phase.numerical_error.error == measured.run.error
        assert {row.name: row.error for row in phase.rows if row.exercised} == {
            row.name: row.error for row in measured.rows if row.exercised
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
def test_a_limit_leaves_out_rows_that_judge_nothing(arm: str) -> None:
    """The others are measured as without it. The counted time of all rows is .07 s."""
    parts = ["budget", "fixes"]
    whole = package.examine(arm, section=parts, duration=0.2, workers=1)
    short = package.examine(arm, section=parts, duration=0.2, workers=1, max_cpu="100ms")
    assert whole.budget
    assert short.budget
    assert not whole.not_tried
    assert short.budget.reasons == whole.budget.reasons
    for phase, all_of in zip(short.budget.phases, whole.budget.phases, strict=True):
        kept = tuple(row for row in all_of.rows if row.kind in {"numerics", "model"})
        assert 0 < len(kept) < len(all_of.rows)
        assert shares((phase.numerical_error, *phase.rows)) == shares(
            (all_of.numerical_error, *kept)
        )
        assert {row.name for row in all_of.rows} - {row.name for row in kept} <= {*short.not_tried}
    assert "not tried within the CPU limit: " in render_text(describe_examination(short))


@pytest.mark.long
def test_the_verdict_hangs_on_no_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A limit ends a search before the same fix, whatever clocks show, unless it is far more."""
    path, found = tmp_path / "servo.xml", list[dict[str, Any]]()
    path.write_text(SERVO)
    monkeypatch.chdir(tmp_path)
    # The examination takes a second of CPU: three times the limit is not shown by either clock.
    for seed, most in enumerate((0.02, 0.4)):
        with monkeypatch.context() as patch:
            disturb_clock(patch, "process_time", seed, 0.01, most)
            disturb_clock(patch, "thread_time", seed, 1.0, 1.0 + 5 * seed)
            report = package.examine(
                path, section=["budget", "fixes"], duration=0.3, workers=1, max_cpu="300ms"
            )
        assert report.budget
        assert report.budget.fixes
        assert report.not_tried
        found.append(without_times(report.model_dump(exclude={"fix"})))
    assert found[0] == found[1]


def without_times(report: Any) -> Any:
    """Return the parts of a report that are no measured times."""
    if isinstance(report, dict):
        named = cast("dict[str, Any]", report)
        return {name: without_times(named[name]) for name in named if name != "time_ratio"}
    if isinstance(report, list | tuple):
        return [without_times(part) for part in cast("list[Any]", report)]
    # NaN, which equals nothing, is a number that a report lacks.
    return None if report != report else report  # noqa: PLR0124


@pytest.mark.long
def test_workers_change_no_bit(arm: str) -> None:
    parts = ["budget", "fixes"]
    one, two = (
        package.examine(arm, section=parts, duration=0.2, workers=count).budget for count in (1, 2)
    )
    assert one
    assert two
    assert one.reasons == two.reasons
    assert {fix.name: fix.error for fix in one.fixes} == {fix.name: fix.error for fix in two.fixes}
    for first, second in zip(one.phases, two.phases, strict=True):
        assert shares((first.numerical_error, *first.rows)) == shares(
            (second.numerical_error, *second.rows)
        )


@pytest.mark.long
def test_a_report_fits_its_schema(arm: str, contactlab: Run, tmp_path: Path) -> None:
    printed = contactlab(
        "examine", arm, "--duration", "0.1", "--format", "json", "-o", str(tmp_path / "arm.json")
    )
    data = json.loads(printed.out)
    Draft202012Validator(json_schemas()["examination.schema.json"]).validate(data)
    assert json.loads((tmp_path / "arm.json").read_text()) == data
    report = Examination.model_validate_json(printed.out)
    assert report.budget
    assert printed.code == (0 if report.passed else 1)
    assert max(map(len, render_text(describe_examination(report)).split("\n"))) <= 80
    whole = describe_examination(report, details=True, phases=True)
    lines = render_text(whole).split("\n")
    assert max(map(len, lines)) <= 80
    words = " ".join(" ".join(lines).split())
    for phase in report.budget.phases:
        idle = ", ".join(row.name for row in phase.rows if not row.exercised)
        assert idle
        assert f"not exercised by the task: {idle} energy drift" in words
    # Times count from the beginning of the run, where the table has them.
    excitement = report.budget.phases[1]
    [gravity] = [row for row in excitement.rows if row.name == "gravity"]
    assert gravity.time is not None
    began = report.task.phases[1].begin
    *_, line = [line for line in lines if line.startswith("  gravity ")]
    assert line.endswith(f"{gravity.body}, {began + gravity.time:.2f} s")


@pytest.mark.long
def test_an_unstable_servo_is_named_with_what_mends_it(tmp_path: Path, contactlab: Run) -> None:
    """The written model is the author's but for the options of the first change, and sound."""
    path = tmp_path / "servo.xml"
    path.write_text(SERVO)
    asked = "servo.xml", "--duration", "0.3", "--write", "new/sound.xml", "--format", "json"
    printed = contactlab(*asked)
    assert printed.code == 1
    # What MuJoCo says of it is data, and neither on the terminal nor in a file.
    assert "WARNING" not in printed.err
    assert not list(tmp_path.rglob("MUJOCO_LOG.TXT"))
    report = Examination.model_validate_json(printed.out)
    assert report.budget
    assert report.headline.startswith("inaccurate: ")
    assert any("left_knee" in cause for cause in report.why)
    mends = [fix.name for fix in report.budget.fixes if fix.removes]
    assert "implicitfast" in mends
    assert 1 <= len(report.fixes) <= 3
    assert [change.name for change in report.fixes] == mends[: len(report.fixes)]
    # The same model comes before others.
    kinds = [change.changes_model for change in report.fixes]
    assert kinds == sorted(kinds)
    assert not any(change.no_patch_reason for change in report.fixes)
    (line,) = report.fixes[0].lines
    assert line.startswith("servo.xml:1: <option ")
    for settings in ({"integrator": "implicitfast"}, {"timestep": 0.005 / 16}):
        mended = package.examine(path, section=["labels"], duration=0.3, set=settings).task_verdict
        assert mended
        assert mended.verdict != "inaccurate", settings
    assert "fixed model: new/sound.xml" in render_text(describe_examination(report)).split("\n")
    assert (tmp_path / "new/sound.patch").is_file()
    judged = package.examine(tmp_path / "new/sound.xml", duration=0.3, section=["labels", "budget"])
    assert judged.passed
    assert_options_alone_differ(path, tmp_path / "new/sound.xml")


def assert_options_alone_differ(one: Path, other: Path) -> None:
    """Assert that two models are the same but for timestep and integrator."""
    models = [mujoco.MjModel.from_xml_path(str(path)) for path in (one, other)]
    for model in models:
        model.opt.timestep, model.opt.integrator = 1.0, 0
    sizes = {mujoco.mj_sizeModel(model) for model in models}
    assert len(sizes) == 1
    texts = [np.empty(sizes.copy().pop(), np.uint8) for _ in models]
    for model, text in zip(models, texts, strict=True):
        mujoco.mj_saveModel(model, None, text)
    # The files' own names are in what is saved of a model.
    assert (texts[0] != texts[1]).sum() < len(one.name) + len(other.name)


@pytest.mark.long
def test_another_model_is_written_only_where_it_is_accepted(
    tmp_path: Path, contactlab: Run
) -> None:
    (tmp_path / "servo.xml").write_text(SERVO)
    asked = "servo.xml", "--duration", "0.3", "--write", "new/sound.xml"
    printed = contactlab(*asked, "--apply", "armature", "--format", "json")
    report = Examination.model_validate_json(printed.out)
    (armature,) = (change for change in report.fixes if change.apply == "armature")
    assert armature.changes_model
    assert armature.distance_to_reference is not None
    before = armature.distance_before
    assert before is None or armature.distance_to_reference < before
    (line,) = armature.lines
    assert line.startswith('servo.xml:4: <joint name="left_knee" axis="0 1 0" armature="')
    made = mujoco.MjModel.from_xml_path(str(tmp_path / "new/sound.xml"))
    assert made.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    assert made.joint("left_knee").armature[0] == armature.settings["dof_armature[left_knee]"]
    words = "servo.xml", "--duration", "0.05", "--drive", "hold", "--section", "fixes"
    printed = contactlab(*words, "--write", "new/other.xml", "--apply", "exclude")
    assert "no fix is called exclude" in printed.err
    only = ["labels", "budget"]
    assert package.examine(tmp_path / "new/sound.xml", duration=0.3, section=only).passed


def test_what_is_accepted_is_written_somewhere(arm: str) -> None:
    with pytest.raises(SweepFileError, match="--write FILE"):
        package.examine(arm, apply=["gains"])


def test_the_folder_of_the_model_is_refused_before_any_run(tmp_path: Path, contactlab: Run) -> None:
    (tmp_path / "servo.xml").write_text(SERVO)
    (tmp_path / "whole.xml").write_text('<mujoco><include file="servo.xml"/></mujoco>')
    printed = contactlab("whole.xml", "--write", "fixed.xml")
    assert "is the folder of the scene; write into another folder, such as" in printed.err
    assert {path.name for path in tmp_path.iterdir()} == {"servo.xml", "whole.xml"}


def test_a_joint_beyond_its_range_is_a_fact(tmp_path: Path) -> None:
    """The elbow's range of 1 to 2 rad begins 1 rad, its whole width, above its start at 0."""
    path = tmp_path / "bent.xml"
    elbow = '<joint name="elbow" axis="0 1 0" range="57.29577951 114.59155903" damping=".1"/>'
    path.write_text(ARM.replace('<joint name="elbow" axis="0 1 0" damping=".1"/>', elbow))
    scene = SceneLoader(Path()).open(str(path)).with_effects("all")
    motions = task_motions(scene, {}, scene.task({}, 0.02))
    (found,) = (fact for fact in list_facts(motions, [0.0] * len(motions)) if fact.kind == "limit")
    assert found.place == "joint elbow"
    # The start of a seed differs from the author's by less than a hundredth.
    assert found.value == pytest.approx(1.0, abs=1e-2)
    assert "57 deg beyond its range" in found.sentence


@pytest.mark.parametrize(("pos", "said"), [(".3 0 .2", ["300 mm apart"]), ("0 0 .2", [])])
def test_a_weld_that_begins_apart_is_a_fact(tmp_path: Path, pos: str, said: list[str]) -> None:
    """A hand 0.3 m from the mocap body that leads it is drawn there, task or no task."""
    path = tmp_path / "led.xml"
    path.write_text(
        f"""<mujoco><option gravity="0 0 0"/><worldbody><body name="hand" pos="0 0 .2">
        <joint type="slide" axis="1 0 0"/><geom size=".05" contype="0"/></body>
        <body name="lead" mocap="true" pos="{pos}"/></worldbody><equality>
        <weld name="w" body1="lead" body2="hand" relpose="0 0 0 1 0 0 0"/></equality></mujoco>"""
    )
    scene = SceneLoader(Path()).open(str(path)).with_effects("all")
    task = scene.task({}, 0.02)
    motions = task_motions(scene, {}, task.model_copy(update={"seeds": task.seeds[:1]}))
    for start in motions[0].starts:
        start[1 : 1 + motions[0].model.nq] = 0  # as its author wrote it
    found = [each for each in list_facts(motions, [0.0] * len(motions)) if each.kind == "equality"]
    assert [text in each.sentence for each, text in zip(found, said, strict=True)] == [True] * len(
        said
    )


@pytest.mark.long
def test_a_model_that_includes_others_is_said_to_be_where_it_is(
    tmp_path: Path, contactlab: Run
) -> None:
    (tmp_path / "part").mkdir()
    (tmp_path / "whole").mkdir()
    (tmp_path / "part/rest.xml").write_text("<mujoco><visual/></mujoco>")
    whole = SERVO.replace("<worldbody>", '<include file="../part/rest.xml"/><worldbody>', 1)
    (tmp_path / "whole/servo.xml").write_text(whole)
    asked = "whole/servo.xml", "--duration", "0.3", "--write", "new/sound.xml", "--format", "json"
    report = Examination.model_validate_json(contactlab(*asked).out)
    assert report.written is not None
    assert mujoco.MjModel.from_xml_path(str(tmp_path / report.written)).nu == 2


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
    found = {fact.kind: fact for fact in list_facts(motions, [0.0] * len(motions))}
    assert found["overlap"].place == "contact world - box"
    # The start of a seed differs from the author's by less than a millimetre.
    assert found["overlap"].value == pytest.approx(0.02, abs=1e-3)
    assert "of the thinner geom's half thickness" in found["overlap"].sentence
    assert found["depth"].value >= found["overlap"].value
    density = 0.005 / (4 / 3 * np.pi * 0.1**3)
    (inertia,) = list_inertia_facts(motions[0].model)
    assert inertia.place == "air"
    assert inertia.value == pytest.approx(density)


def test_a_force_before_touch_is_told(tmp_path: Path) -> None:
    """A box rests where its weight is borne, within the margin of 20 mm: it never touches."""
    path = tmp_path / "apart.xml"
    path.write_text(
        """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1" margin=".02"/>
        <body name="box" pos="0 0 .115"><freejoint/><geom type="box" size=".1 .1 .1" mass="2"/>
        </body></worldbody></mujoco>"""
    )
    scene = SceneLoader(Path()).open(str(path)).with_effects("all")
    motions = task_motions(scene, {}, scene.task({}, 0.3))
    found = {fact.kind: fact for fact in list_facts(motions, [0.0] * len(motions))}
    assert 0.015 - 1e-3 < found["margin"].value <= 0.02
    assert "before the geoms touch (margin): contact world - box" in found["margin"].sentence
    assert "depth" not in found


def test_a_depth_of_rounding_is_a_touch() -> None:
    """A ball begins 1e-12 of its radius in the floor, and nothing moves it."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option gravity="0 0 0"/><worldbody><geom type="plane" size="1 1 .1"/>
        <body pos="0 0 .0999999999999"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
    )
    start = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, mujoco.MjData(model), start, INTEGRATION)
    motion = Motion(model, start[None], np.zeros((1, 5, 0)))
    assert "depth" not in {fact.kind for fact in list_facts([motion], [0.0])}


@pytest.mark.long
def test_only_watched_bodies_count(arm: str) -> None:
    report = package.examine(arm, section=["budget"], duration=0.1, observe=["upper"])
    assert report.budget
    assert report.task.observed == ("upper",)
    for phase in report.budget.phases:
        assert phase.bodies == ("upper",)
        assert {row.body for row in (phase.numerical_error, *phase.rows) if row.exercised} == {
            "upper"
        }
    whole = package.examine(arm, section=["budget"], duration=0.1)
    assert whole.budget
    for some, every in zip(report.budget.phases, whole.budget.phases, strict=True):
        assert some.numerical_error.error is not None
        assert every.numerical_error.error is not None
        assert some.numerical_error.error <= every.numerical_error.error


def test_a_phase_that_no_seed_reaches_is_left_out(tmp_path: Path) -> None:
    # The forearm has .3 kg over .2 m, so I < .01 kg m^2, and an explicit step multiplies its speed
    # by 1 - k h / I < -300: it bursts within a few steps of the fall, which begins at once.
    path = tmp_path / "burst.xml"
    velocity = '<velocity name="brake" joint="elbow" kv="1000"/></actuator>'
    path.write_text(ARM.replace("</actuator>", velocity))
    scene = SceneLoader(Path()).open(str(path)).with_effects("all")
    burst = task_motions(scene, {}, scene.task({}, 0.6))
    assert [(motion.name, motion.seeds) for motion in burst] == [("rest", 3)]


def test_bad_input_is_named(arm: str) -> None:
    with pytest.raises(SweepFileError, match="share"):
        package.examine(arm, tolerance="1mm")
    with pytest.raises(SceneError, match="nobody"):
        package.examine(arm, observe=["nobody"])
    with pytest.raises(EngineError, match="impulse"):
        package.examine(arm, set={"engine": "impulse"})
    with pytest.raises(OutputError, match="add --section labels"):
        package.examine(arm, section=["facts"], output="page.html")


@pytest.mark.long
def test_a_model_has_one_page(arm: str, contactlab: Run, tmp_path: Path) -> None:
    """Beside its report and its evidence, or in a file of its own, which is all that is left."""
    printed = contactlab(arm, "--duration", "0.1", "--workers", "1")
    (folder,) = (tmp_path / "results/examine").iterdir()
    assert folder.name.endswith("-arm_duration=0.1")
    assert f"page: results/examine/{folder.name}/page.html" in printed.out
    assert {path.name for path in folder.iterdir()} >= {"page.html", "examination.json", "run"}
    report = Examination.model_validate_json((folder / "examination.json").read_text())
    page = (folder / "page.html").read_text()
    assert all(
        text in page for text in ("Where the error comes from", report.task.line, ">gravity</th>")
    )
    assert report.headline.split(":")[0] in page
    shown = report._repr_html_()  # pyright: ignore[reportPrivateUsage]
    assert ">gravity</th>" in shown
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    alone = ("--duration", "0.1", "--workers", "1", "-o", "own.html", "--section", "budget")
    printed = contactlab(arm, *alone, "--section", "labels")
    assert "page: own.html" in printed.out
    left = {path for path in tmp_path.rglob("*") if path not in before}
    assert left == {tmp_path / "own.html"}


def test_a_wrong_section_is_named(arm: str) -> None:
    with pytest.raises(SweepFileError, match=r"no section 'label'.*did you mean 'labels'"):
        package.examine(arm, section=["label"])


@pytest.mark.long
def test_several_models_are_one_report(contactlab: Run, tmp_path: Path) -> None:
    """Each has its findings under its name, and the exit code is that of the worst."""
    for name in ("one", "two"):
        (tmp_path / f"{name}.xml").write_text(ARM)
    words = ("one.xml", "two.xml", "--check", "inertia", "--workers", "0", "-o", "out")
    code, out, err = contactlab(*words)
    assert (code, out.splitlines()[0]) == (0, "2 of 2 models pass"), err
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"one", "two"}
    junit = contactlab(*words, "--format", "junit").out
    assert all(f".{name}" in junit for name in ("one_xml", "two_xml"))
    markdown = contactlab(*words, "--format", "markdown").out
    assert all(f"### {name}.xml: ok" in markdown for name in ("one", "two"))
    code, out, err = contactlab("one.xml", "two.xml", "--write", "new.xml")
    assert (code, out) == (2, "")
    assert "need one model" in err
