"""Changes against labels of a run that is numerically sound: which are told, and written."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import mujoco
import pytest

from contactlab.budget import Motion, Trial, Verdict
from contactlab.run.sweep_request import SceneLoader
from contactlab.schema.examination import RunLabel
from contactlab.studies.examine.changes import Again, Changes
from contactlab.studies.examine.task_motions import task_motions

BOX = """<mujoco><option timestep=".002"/><worldbody>
  <geom name="floor" type="plane" size="3 3 .1"/>
  <body name="box" pos="0 0 .05"><freejoint/>
    <geom name="box" type="box" size=".05 .05 .05" solref=".04 1"/></body>
  <body name="ball" pos="1 0 .05"><freejoint/><geom name="ball" size=".05"/></body>
</worldbody></mujoco>"""
DEEP = RunLabel(
    label="deep_penetration", phase="neutral", runs=3, reason="", seed=0, time=None, bodies=("box",)
)


def changes_of(
    folder: Path, keeps: Sequence[str], wanted: Sequence[str] = (), word: str = "sound"
) -> Changes:
    """Return what is told where runs keep their label without a setting that begins so."""
    file = folder / "box.xml"
    file.write_text(BOX)
    scene = SceneLoader(Path()).open(str(file)).with_effects("all")
    task = scene.task({}, 0.02)
    motions = task_motions(scene, {}, task)

    def moved(values: Any, change: Any, _other: Path | None) -> Iterator[list[Motion]]:
        yield task_motions(scene, values, task, change=change)

    def labelled(values: Any) -> Sequence[RunLabel]:
        return () if any(name.startswith(tuple(keeps)) for name in values) else (DEEP,)

    trial = Trial(wanted=wanted, workers=1)
    verdict: Any = Verdict(word, 100.0, ())  # pyright: ignore[reportArgumentType]
    return Changes(scene, {}, motions, verdict, trial, Again(moved, labelled, (DEEP,)))


def test_a_finer_step_comes_before_another_model(tmp_path: Path) -> None:
    told = changes_of(tmp_path, ["timestep", "geom_solref"]).told()
    assert [(one.name, one.physics, one.removes) for one in told] == [
        ("half the step", False, "labels"),
        ("solref / 2 of contact world - box", True, "labels"),
    ]
    assert told[0].settings == {"timestep": 0.001}
    assert set(told[1].settings) == {"geom_solref[floor]", "geom_solref[box]"}


def test_what_keeps_the_label_is_not_told(tmp_path: Path) -> None:
    assert changes_of(tmp_path, ["impratio"]).told() == ()


def test_numerics_that_are_at_fault_come_first(tmp_path: Path) -> None:
    assert changes_of(tmp_path, ["timestep"], word="unresolved").unlabelling == []


@pytest.mark.parametrize(("wanted", "half"), [([], 0.5), (["solref"], 1.0)])
def test_what_leaves_no_label_is_written(tmp_path: Path, wanted: list[str], half: float) -> None:
    changes = changes_of(tmp_path, ["timestep", "geom_solref"], wanted)
    file, reason = changes.write(tmp_path / "new" / "box.xml")
    assert not reason
    model = mujoco.MjModel.from_xml_path(str(file))
    assert model.opt.timestep == pytest.approx(0.002 * half)
    stiff = 0.02 if wanted else 0.04
    assert math.isclose(model.geom("box").solref[0], stiff)
