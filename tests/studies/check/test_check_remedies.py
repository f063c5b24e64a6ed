"""Changes that help: each run on the model itself, none against another, all with their price."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import pytest

from contactlab.schema.check_report import CheckReport, CheckResult, Measure
from contactlab.store.finished_store import Store
from contactlab.studies.check import checked_model
from contactlab.studies.check.remedies import MODEL

pytestmark = pytest.mark.long

Checked = Callable[..., CheckReport]
One = Callable[..., CheckResult]
Missed = Callable[[CheckResult], list[Measure]]

CLASSES = """<mujoco>
  <option timestep="0.001"/>
  <default>
    <default class="foot"><geom {foot}/></default>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body pos="0 0 .05"><freejoint/>
      <geom class="foot" name="box" type="box" size=".05 .05 .05"/></body>
  </worldbody>
</mujoco>"""


@pytest.mark.parametrize("foot", ["", 'solref="0.02 1"', 'solref="0.02 1" priority="1"'])
def test_changes_reach_what_they_are_meant_for(checked: Checked, tmp_path: Path, foot: str) -> None:
    """No default, class or priority goes over them, and the written model has them all."""
    report = checked(CLASSES.format(foot=foot), "flat_contact", assign=("duration=0.6",))
    (remedy,) = report.remedies
    assert remedy.mends == ("penetration_steady",)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "check" / MODEL / "own.xml"))
    assert [tuple(row) for row in model.geom_solref] == [(0.005, 1.0)] * 2
    assert [edit.where.rpartition(":")[2] for edit in remedy.edits] == ["7", "9"]
    assert all('solref="0.005 1"' in line for edit in remedy.edits for line in edit.lines)


@pytest.mark.parametrize(
    "assign",
    [
        ["timestep=0.01"],
        ["cone=pyramidal", "friction.slide=3"],
    ],
)
def test_what_is_recommended_helps(checked: Checked, assign: list[str]) -> None:
    """Pasted together, the changes leave only the findings that no change mends."""
    report = checked("gripping_pad", "flat_contact", "hold", assign=tuple(assign))
    failing = {each.name for each in report.findings if each.failing}
    mended = {name for remedy in report.remedies for name in remedy.mends}
    assert "penetration_steady" in mended
    settings = {name: value for each in report.remedies for name, value in each.settings.items()}
    kept = [each for each in assign if each.partition("=")[0].partition(".")[0] not in settings]
    again = [f"{name}={value}" for name, value in settings.items()]
    cured = checked("gripping_pad", "flat_contact", "hold", assign=(*kept, *again), remedies=False)
    assert {each.name for each in cured.findings if each.failing} == failing - mended
    assert all(each.time is not None and each.time > 0 for each in report.remedies)


def test_no_setting_is_named_twice(checked: Checked) -> None:
    """Timestep, chatter, depth and slip each ask for a timestep or a solref of their own."""
    assign = ("solref=0.02 0.2", "timestep=0.005", "impratio=1")
    report = checked("gripping_pad", "timestep", "flat_contact", "hold", assign=assign)
    names = [name for remedy in report.remedies for name in remedy.settings]
    assert names
    assert len(set(names)) == len(names)


def test_underdamped_chatter_is_mended_by_the_timestep(checked: Checked) -> None:
    """H / (tc dr) = 0.5 is too long for so little damping; impedance does not change it."""
    report = checked("gripping_pad", "hold", assign=("solref=0.02 0.2",))
    chatter = next(each for each in report.remedies if "mode_switches" in each.mends)
    assert chatter.settings["timestep"] == 5e-4
    assert "solimp" not in chatter.settings


def test_creep_is_mended_by_firm_friction(checked: Checked) -> None:
    report = checked("gripping_pad", "hold", assign=("solref=0.005 1", "impratio=1"))
    (remedy,) = report.remedies
    assert remedy.mends == ("slip",)
    assert remedy.settings == {"impratio": 10.0, "cone": "elliptic"}


SOFT = """<mujoco>
  <option timestep="0.002"/>
  <default><geom solref="0.02 1" solimp="0 0.8 0.01"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body pos="0 0 .05"><freejoint/>
      <geom name="box" type="box" size=".05 .05 .05" mass="15"/></body>
  </worldbody>
</mujoco>"""


def test_a_remedy_that_takes_too_long_is_a_note(checked: Checked) -> None:
    """An impedance that starts at 0 asks for a time constant of microseconds."""
    report = checked(SOFT, "flat_contact", "shells", assign=("duration=1",))
    assert any(
        "was not tried against penetration_steady: a run of" in each for each in report.notes
    )
    assert {each.name: each.verdict for each in report.checks} == {
        "flat_contact": "warning",
        "shells": "pass",
    }


def test_evidence_of_remedies_is_kept(checked: Checked, tmp_path: Path) -> None:
    report = checked("gripping_pad", "hold", assign=("solref=0.005 1", "impratio=1"))
    assert report.remedies
    assert (tmp_path / "check/remedies/1/run/manifest.json").is_file()
    assert (tmp_path / "check/remedies/times/manifest.json").is_file()


def test_remedies_take_no_more_steps_than_they_may(
    checked: Checked, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assign = ("solref=0.02 0.2", "timestep=0.005", "impratio=1")
    free = checked("gripping_pad", "timestep", "hold", assign=assign, remedies=False)
    monkeypatch.setattr(checked_model, "_MOST_REMEDY_STEPS", most := 500)
    report = checked("gripping_pad", "timestep", "hold", assign=assign)
    assert [(each.name, each.verdict) for each in report.checks] == [
        (each.name, each.verdict) for each in free.checks
    ]
    assert any(
        "remedies would take" in note and f"{most} are made at most" in note
        for note in report.notes
    )
    stores = [Store.open(each.parent) for each in tmp_path.glob("check/remedies/*/*/manifest.json")]
    records: list[Any] = [each for store in stores for each in store.records()]
    assert records
    assert sum(round(each.duration / each.settings["timestep"]) for each in records) <= most
