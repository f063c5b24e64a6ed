"""Examinations of loops name the border, and offer what holds in the loop."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import pytest

from contactlab.plan.task_options import TaskOptions
from contactlab.schema.drive import read_drive
from contactlab.schema.examination import Examination, SectionName
from contactlab.studies.examine import repaired_causes
from contactlab.studies.examine.examination import ExamineRequest, examine_model
from contactlab.studies.examine.policy_loop import LoopRepair, list_loop_repairs
from contactlab.tasks.session import Session

INERTIA = 1e-3
WHEEL = f"""<mujoco><option timestep=".002" gravity="0 0 0"/><worldbody><body name="wheel">
<joint name="wheel" axis="0 1 0"/><geom size=".05" contype="0" conaffinity="0"/>
<inertial pos="0 0 0" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/></body></worldbody>
<actuator><motor name="motor" joint="wheel" ctrlrange="-5 5"/></actuator></mujoco>"""
KD = 1.25 * 2 * INERTIA / 0.002
"""Beyond 2 I / T, below which a damping holds that is kept for a period T."""


def examined(
    folder: Path, *sections: SectionName, kd: float = KD, rate: float = 500.0
) -> Examination:
    (folder / "wheel.xml").write_text(WHEEL)
    task = TaskOptions(drive=read_drive(f"kp=1e-3,kd={kd},rate={rate}"), duration=1.0)
    request = ExamineRequest(str(folder / "wheel.xml"), task=task)
    if sections:
        request = ExamineRequest(str(folder / "wheel.xml"), task=task, sections=sections)
    return examine_model(request, Session(folder / "results"))


@pytest.mark.long
def test_the_border_of_a_damping_is_that_of_its_pole(tmp_path: Path) -> None:
    report = examined(tmp_path, "loop")
    assert report.loop is not None
    borders = {margin.name: margin.border for margin in report.loop.margins}
    assert report.verdict == "fails"
    assert borders["rate"] == pytest.approx(1.25 * 500, rel=0.01)
    assert borders["gain"] == pytest.approx(1 / 1.25, rel=0.01)
    assert borders["armature"] == pytest.approx(0.25 * INERTIA, rel=0.01)
    assert report.loop.inside


@pytest.mark.long
def test_a_loop_with_half_the_damping_has_a_margin_of_two(tmp_path: Path) -> None:
    report = examined(tmp_path, "loop", kd=KD / 2.5)
    assert report.loop is not None
    assert report.verdict is None
    assert report.loop.holds
    borders = {margin.name: margin.border for margin in report.loop.margins}
    assert borders["gain"] == pytest.approx(2, rel=0.01)


@pytest.mark.long
def test_armature_is_the_fix_of_a_loop_that_does_not_hold(tmp_path: Path) -> None:
    report = examined(tmp_path)
    assert report.verdict not in ("ok", "depends")
    assert "does not hold joint wheel" in report.headline
    first = report.fixes[0]
    assert "armature" in first.name or "damping" in first.name
    assert first.verification is not None
    assert first.verification.passed
    offered = {fix.name for fix in (*report.fixes, *report.rejected_fixes)}
    assert not any("RK4" in name for name in offered)


@pytest.mark.long
@pytest.mark.parametrize(("kd", "step"), [(KD, 1 / 1300), (KD / 50, None)])
def test_a_faster_loop_is_verified_as_other_fixes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kd: float, step: float | None
) -> None:
    """It holds twice the gains: a pole of 1 - 2 kd / (I f) is inside of the circle from kd / I.

    A rate above that of the steps needs a smaller step.
    """
    rate = 500.0 if step else 10.0

    def list_rates(*args: Any) -> Iterator[LoopRepair]:
        return (each for each in list_loop_repairs(*args) if each.drive)

    monkeypatch.setattr(repaired_causes, "list_loop_repairs", list_rates)
    report = examined(tmp_path, kd=kd, rate=rate)
    first = report.fixes[0]
    assert first.verification is not None
    assert first.verification.passed
    assert first.settings["drive.rate"] == pytest.approx(kd / INERTIA, rel=0.07)
    assert first.settings.get("timestep") == (step and pytest.approx(step))
    assert f"rate={first.settings['drive.rate']:g}" in first.name


@pytest.mark.long
def test_a_pd_moves_into_the_model(tmp_path: Path) -> None:
    """The written servos hold with the controller that sends targets, and keep the force range."""
    (tmp_path / "wheel.xml").write_text(WHEEL)
    task = TaskOptions(drive=read_drive(f"kp=1e-3,kd={KD}"), duration=1.0)
    request = ExamineRequest(str(tmp_path / "wheel.xml"), task=task, apply=("loop-servos",))
    request = replace(request, write=tmp_path / "out" / "servos.xml")
    report = examine_model(request, Session(tmp_path / "results"))
    first = report.fixes[0]
    assert first.apply == "loop-servos"
    assert first.verification is not None
    assert first.verification.passed
    assert first.settings == {"integrator": "implicitfast", "drive.send": "targets"}
    assert first.controller.startswith("In your own controller, send")
    made = mujoco.MjModel.from_xml_path(str(report.written))
    assert made.actuator_forcerange[0].tolist() == [-5, 5]
    assert made.actuator_biasprm[0, 1:3].tolist() == [-1e-3, -KD]
    drive = read_drive(f"kp=1e-3,kd={KD},send=targets")
    task = TaskOptions(drive=drive, duration=1.0)
    again = ExamineRequest(str(report.written), task=task, sections=("loop",))
    held = examine_model(again, Session(tmp_path / "again")).loop
    assert held is not None
    assert held.holds
    assert held.inside is None
