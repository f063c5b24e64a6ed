"""A change that a report tells of is written as it was found."""

from pathlib import Path

import mujoco
import pytest

from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.model_writer import write_model
from contactlab.schema.evidence import Setting
from contactlab.schema.examination import Fix
from contactlab.studies.examine.fixes import edits_of

HINGE = """<mujoco><worldbody><body><joint name="hinge" range="-10 10" solreflimit=".04 1"/>
<geom size=".1" pos=".2 0 0"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("settings", "solref", "step"),
    [({"jnt_solref[hinge]": "0.02 1"}, [0.02, 1], 0.002), ({"timestep": 0.001}, [0.04, 1], 0.001)],
)
def test_numbers_that_a_report_has_as_text_are_numbers_again(
    settings: dict[str, Setting], solref: list[float], step: float, tmp_path: Path
) -> None:
    file = tmp_path / "hinge.xml"
    file.write_text(HINGE)
    change = Fix(
        name="", changes_model=True, apply="", settings=settings, error=None,
        distance_to_reference=None, distance_before=None,
        time_ratio=None, lines=(),
    )  # fmt: skip
    scene = SceneLoader(tmp_path).open(str(file)).with_effects("all")
    written = write_model(scene, edits_of(change, scene), tmp_path / "changed")
    model = mujoco.MjModel.from_xml_path(str(written.path))
    assert model.jnt_solref[0].tolist() == solref
    assert model.opt.timestep == step
