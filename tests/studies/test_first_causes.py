"""The headline names the first cause, and the rest is judged from the repaired model."""

from pathlib import Path

import mujoco
import pytest

from contactlab.advisories.advisory_files import list_advisories
from contactlab.plan.task_options import read_task_options
from contactlab.schema.examination import Examination
from contactlab.studies.examine.examination import ExamineRequest, run
from contactlab.tasks.session import Session

CHUTE = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="3 3 .1" contype="1" conaffinity="0"/>
  <body name="part" pos="0 0 .3"><freejoint/>
    <geom type="box" size=".05 .05 .05" mass=".5" contype="2" conaffinity="2"/></body>
  </worldbody></mujoco>"""


def examine(text: str, folder: Path, seconds: float = 1.0) -> Examination:
    file = folder / "model.xml"
    file.write_text(text, encoding="utf-8")
    options = read_task_options(drive="none", duration=f"{seconds}s")
    return run(ExamineRequest(str(file), task=options), Session(folder / "out", 0))


@pytest.mark.long
def test_a_fault_of_the_engine_comes_first_and_its_workaround_is_verified(tmp_path: Path) -> None:
    """The released witness: plain MuJoCo runs it with another jacobian as earlier releases did."""
    advisory = next(each for each in list_advisories() if each.id == "CL-2026-0001")
    if not advisory.affects_release(mujoco.__version__):
        pytest.skip("this release is not affected")
    report = examine(advisory.witness.model, tmp_path)
    first, fix = report.causes[0], report.fixes[0]
    assert first.stage == "engine"
    assert advisory.id in report.headline
    assert fix.settings == {"jacobian": "dense"}
    assert fix.verification is not None
    assert fix.verification.passed


@pytest.mark.long
def test_contacts_that_masks_forbid_come_before_all_others(tmp_path: Path) -> None:
    report = examine(CHUTE, tmp_path)
    assert report.verdict == "fails"
    assert report.headline == "fails: part falls through floor"
    assert report.fixes[0].opened_geoms == (("floor", "conaffinity", 2),)
    model = mujoco.MjModel.from_xml_string(
        CHUTE.replace('contype="1" conaffinity="0"', 'contype="1" conaffinity="2"')
    )
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 500)
    assert data.qpos[2] == pytest.approx(0.05, abs=1e-3)
