"""The study of hard cases as a function: one report, a line for each case, and names that exist."""

from pathlib import Path

import pytest

from contactlab.commands.examine import examine
from contactlab.commands.stability import stability
from contactlab.errors import SweepFileError
from contactlab.schema.check_report import StabilityReport
from contactlab.store.finished_store import Store
from contactlab.studies.stability_cases import find_cases, run_cases
from contactlab.tasks.session import Session


@pytest.mark.long
def test_every_case_is_reported_as_data(tmp_path: Path) -> None:
    lines: list[str] = []
    report = run_cases(find_cases(["free_fall"]), Session(tmp_path, notify=lines.append))
    assert lines == ["1/1 free_fall: ok"]
    assert report.passed
    (case,) = report.cases
    assert case.store == str(tmp_path / "free_fall")
    assert sum(case.labels.values()) == case.runs >= case.expected == case.as_expected > 0
    assert StabilityReport.model_validate_json(report.model_dump_json()) == report


def test_an_unknown_case_is_refused_with_a_hint() -> None:
    with pytest.raises(SweepFileError, match="did you mean 'free_fall'"):
        find_cases(["fre_fall"])


ARM = """<mujoco>
  <worldbody><body><joint name="hinge" axis="0 1 0" damping="1"/>
    <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" contype="0" conaffinity="0"/>
  </body></worldbody>
  <actuator><position joint="hinge" kp="50" kv="5" ctrlrange="-1 1"/></actuator>
  <keyframe><key qpos="0.25" ctrl="0.25"/></keyframe>
</mujoco>"""


def test_a_model_starts_where_it_says_and_slightly_off(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(ARM)
    report = examine(
        tmp_path / "arm.xml",
        section=["labels"],
        set={"timestep": 1e-3},
        drive="hold",
        duration=0.1,
        tolerance="penetration_steady=1mm",
        output=tmp_path / "out",
    )
    assert report.sections == ("labels",)
    store = Store.open(tmp_path / "out/run")
    records = [store.record(run) for run in store.table["run_id"].to_pylist()]
    places = {record.seed: float(store.trace(record).qpos[0, 0]) for record in records}
    assert places.keys() == {0, 1, 2}
    assert places.pop(0) == 0.25
    others = list(places.values())
    # What other seeds move without a manifest: each joint by up to 0.1 mrad.
    assert all(0 < abs(other - 0.25) <= 1e-4 for other in others)
    assert others
    assert all(record.drive == "hold" for record in records)
    assert {(record.duration, record.settings["timestep"]) for record in records} == {(0.1, 1e-3)}
    assert store.manifest.sweep.resolved["thresholds"] == {"penetration_steady": 1e-3}


def test_a_model_is_no_case(tmp_path: Path) -> None:
    with pytest.raises(SweepFileError, match="contactlab examine ball_drop --section labels"):
        stability(["free_fall", "ball_drop"], output=tmp_path)
