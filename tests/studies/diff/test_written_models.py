"""What examine can write differs from the model that it was given in the named options alone."""

import copy
from pathlib import Path

import pytest
from tests.studies.diff.test_differences import ROBOT

from contactlab.mjcf import OPTIONS
from contactlab.modifications.catalogue import list_candidates
from contactlab.modifications.modification import Candidate
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_edits import read_option
from contactlab.scene.model_writer import write_model
from contactlab.scene.scene import Scene
from contactlab.studies.diff.compare_models import find_differences


@pytest.mark.parametrize(
    "candidate",
    [each for each in list_candidates() if not each.changes_model],
    ids=lambda each: each.name,
)
def test_a_change_that_examine_tries_is_written_as_its_options_and_nothing_else(
    candidate: Candidate, tmp_path: Path
) -> None:
    (tmp_path / "robot.xml").write_text(ROBOT)
    scene = Scene.open(str(tmp_path / "robot.xml"))
    model = scene.base({}).model
    changed = copy.copy(model)
    candidate.change(changed)
    changed.opt.timestep = model.opt.timestep / candidate.rate
    values = {name: read_option(changed, name) for name in OPTIONS}
    options = {name: value for name, value in values.items() if value != read_option(model, name)}
    made = write_model(scene, ModelEdits(options), tmp_path / "out", "sound.xml")
    found = list(find_differences(model, Scene.open(str(made.path)).base({}).model))
    assert {each.kind for each in found} <= {"option"}
    assert {each.quantity for each in found} == set(options)
