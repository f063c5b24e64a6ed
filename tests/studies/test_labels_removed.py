"""Changes against labels of a run that is numerically sound: which are told, and written."""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import mujoco
import pytest

from contactlab.budget import Motion, Settings, Trial, Verdict, error_budget, judge
from contactlab.budget.measuring import count_evaluations, steps_of
from contactlab.run.sweep_request import SceneLoader
from contactlab.schema.examination import RunLabel
from contactlab.studies.examine.fixes import FixSearch, TaskRepeats
from contactlab.tasks.task_motions import task_motions

BOX = """<mujoco><option timestep=".002"/><worldbody>
  <geom name="floor" type="plane" size="3 3 .1"/>
  <body name="box" pos="0 0 .05"><freejoint/>
    <geom name="box" type="box" size=".05 .05 .05" solref=".04 1"/></body>
  <body name="ball" pos="1 0 .05"><freejoint/><geom name="ball" size=".05"/></body>
</worldbody></mujoco>"""
DEEP = RunLabel(
    label="deep_penetration", phase="rest", runs=3, reason="", seed=0, time=None, bodies=("box",)
)


def changes_of(
    folder: Path,
    keeps: Sequence[str],
    requested: Sequence[str] = (),
    word: str = "ok",
    label: RunLabel = DEEP,
    text: str = BOX,
    *,
    left: Callable[[Sequence[Motion]], float] = lambda _: math.inf,
) -> FixSearch:
    """Return what is told where runs keep their label without a setting that begins so."""
    file = folder / "box.xml"
    file.write_text(text)
    scene = SceneLoader(Path()).open(str(file)).with_effects("all")
    task = scene.task({}, 0.02)
    motions = task_motions(scene, {}, task)

    def moved(values: Any, change: Any, _other: Path | None) -> Iterator[list[Motion]]:
        yield task_motions(scene, values, task, change=change)

    def labelled(values: Any, _file: Path | None = None) -> Iterator[Sequence[RunLabel]]:
        yield () if any(name.startswith(tuple(keeps)) for name in values) else (label,)

    trial = Trial(requested=requested, workers=1, find_time_left=lambda: left(motions))
    verdict: Any = Verdict(word, 100.0, ())  # pyright: ignore[reportArgumentType]
    return FixSearch(scene, {}, motions, verdict, trial, TaskRepeats(moved, labelled, (label,)))


def test_a_finer_step_comes_before_another_model(tmp_path: Path) -> None:
    told = changes_of(tmp_path, ["timestep", "geom_solref"]).reported_fixes()
    assert [(one.name, one.changes_model, one.removes) for one in told] == [
        ("half the step", False, "labels"),
        ("solref / 2 of contact world - box", True, "labels"),
    ]
    assert told[0].settings == {"timestep": 0.001}
    assert set(told[1].settings) == {"geom_solref[floor]", "geom_solref[box]"}


def test_a_finer_step_takes_more_of_the_time_that_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There is time for a budget of the run's own steps on both groups of seeds, and a half more.

    Half the step takes twice as many, so that it is not tried; what is stiffer takes as many.
    """

    def half_more(motions: Sequence[Motion]) -> float:
        return 1.5 * count_evaluations(motions[0].model, Settings()) * 2 * steps_of(motions)

    monkeypatch.setattr("contactlab.studies.examine.fixes.count_pace", lambda _: 1.0)
    changes = changes_of(tmp_path, ["timestep", "geom_solref"], left=half_more)
    assert changes.not_tried == [
        "half the step",
        "a quarter of the step",
        "an eighth of the step",
    ]
    assert [one.name for one in changes.reported_fixes()] == ["solref / 2 of contact world - box"]


def test_a_solver_that_was_not_done_goes_on(tmp_path: Path) -> None:
    stuck = DEEP.model_copy(update={"label": "solver_nonconvergence", "bodies": ()})
    coarse = BOX.replace("<option ", '<option iterations="2" ')
    (told,) = changes_of(
        tmp_path, ["iterations", "timestep"], label=stuck, text=coarse
    ).reported_fixes()
    assert told.name == "Newton with 100 iterations"
    assert told.settings["iterations"] == 100


def test_what_keeps_the_label_is_not_told(tmp_path: Path) -> None:
    assert changes_of(tmp_path, ["impratio"]).reported_fixes() == ()


def test_numerics_that_are_at_fault_come_first(tmp_path: Path) -> None:
    assert changes_of(tmp_path, ["timestep"], word="inaccurate").without_labels == []


@pytest.mark.parametrize(("wanted", "half"), [([], 0.5), (["solref"], 1.0)])
def test_what_leaves_no_label_is_written(tmp_path: Path, wanted: list[str], half: float) -> None:
    changes = changes_of(tmp_path, ["timestep", "geom_solref"], wanted)
    _, edits, reason = changes.choose_edits()
    assert not reason
    file = changes.write_edits(edits, tmp_path / "new", "box.xml").path
    model = mujoco.MjModel.from_xml_path(str(file))
    assert model.opt.timestep == pytest.approx(0.002 * half)
    stiff = 0.02 if wanted else 0.04
    assert math.isclose(model.geom("box").solref[0], stiff)


@pytest.mark.parametrize("name", ["contact_at_distance", "energy_injection"])
def test_contacts_that_bear_at_a_distance_lose_their_margins(tmp_path: Path, name: str) -> None:
    margined = BOX.replace('size=".05"/>', 'size=".05" margin=".01" gap=".002"/>')
    afar = DEEP.model_copy(update={"label": name, "bodies": ("ball",)})
    (told,) = changes_of(tmp_path, ["geom_margin"], label=afar, text=margined).reported_fixes()
    assert (told.apply, told.removes) == ("margin", "labels")
    assert told.settings == {"geom_margin[ball]": 0.0, "geom_gap[ball]": 0.0}


def test_energy_that_changes_is_kept_by_runge_kutta(tmp_path: Path) -> None:
    gained = DEEP.model_copy(update={"label": "energy_injection", "bodies": ()})
    (told,) = changes_of(tmp_path, ["integrator"], label=gained).reported_fixes()
    assert (told.name, told.settings) == ("RK4", {"integrator": "RK4"})


SERVO = """<mujoco><option timestep=".01"/><worldbody><body name="arm"><joint name="elbow"/>
  <geom size=".05" pos=".2 0 0" mass=".1"/></body></worldbody>
  <actuator><position joint="elbow" kp="100" kv="1"/></actuator>
  <keyframe><key qpos=".3"/></keyframe></mujoco>"""
CHATTER = DEEP.model_copy(update={"label": "chatter", "bodies": ("arm",)})


def test_a_joint_that_chatters_gets_gains_that_the_step_holds(tmp_path: Path) -> None:
    (told,) = changes_of(tmp_path, ["actuator_gainprm"], label=CHATTER, text=SERVO).reported_fixes()
    assert told.apply == "gains"


def test_what_leaves_no_label_leads(tmp_path: Path) -> None:
    """RK4 and implicitfast hold the servo, but here its runs lose their label at a finer step."""
    file = tmp_path / "arm.xml"
    file.write_text(SERVO)
    scene = SceneLoader(Path()).open(str(file)).with_effects("all")
    task, settings = scene.task({}, 0.1), Settings(energy=False)
    task = task.model_copy(update={"seeds": (0,)})
    motions = task_motions(scene, {}, task)
    verdict = judge(error_budget(motions, rows=[], settings=settings))

    def moved(values: Any, change: Any, _other: Path | None) -> Iterator[list[Motion]]:
        yield task_motions(scene, values, task, change=change)

    def labelled(values: Any, _file: Path | None = None) -> Iterator[Sequence[RunLabel]]:
        yield () if {"timestep", "integrator"} <= {*values} else (CHATTER,)

    trial = Trial(settings, most=1, workers=1)
    changes = FixSearch(
        scene, {}, motions, verdict, trial, TaskRepeats(moved, labelled, (CHATTER,))
    )
    first, second = [change.name for change in changes.reported_fixes()][:2]
    assert first == f"{second} at half the step"
    name, edits, _ = changes.choose_edits()
    assert name == first
    assert changes.write_edits(edits, tmp_path / "new", "arm.xml").path.is_file()


@pytest.mark.long
@pytest.mark.parametrize("removable", [True, False])
def test_no_fix_of_a_modeling_choice_leaves_the_label_of_a_run_that_fails(
    tmp_path: Path, removable: bool
) -> None:
    """A box lands on soft ground: its softness decides. Its energy rises for another reason."""
    file = tmp_path / "box.xml"
    file.write_text(BOX.replace('pos="0 0 .05"', 'pos="0 0 .06"'))
    scene = SceneLoader(Path()).open(str(file)).with_effects("all")
    task, settings = scene.task({}, 0.1), Settings(energy=False)
    task = task.model_copy(update={"seeds": (0,)})
    motions = task_motions(scene, {}, task)
    verdict = judge(error_budget(motions, settings=settings))
    assert verdict.word == "depends"
    gained = DEEP.model_copy(update={"label": "energy_injection", "bodies": ()})

    def moved(values: Any, change: Any, _other: Path | None) -> Iterator[list[Motion]]:
        yield task_motions(scene, values, task, change=change)

    def labelled(values: Any, _file: Path | None = None) -> Iterator[Sequence[RunLabel]]:
        yield () if removable and any("solref" in name for name in values) else (gained,)

    trial = Trial(settings, workers=1)
    repeats = TaskRepeats(moved, labelled, (gained,))
    fixes = FixSearch(scene, {}, motions, verdict, trial, repeats).reported_fixes()
    assert bool(fixes) == removable
