"""`contactlab check`: exit codes, what it prints and what it leaves."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import xmlschema
from jsonschema import Draft202012Validator

from contactlab.schema.check_report import CheckReport
from contactlab.schema.json_schemas import json_schemas
from contactlab.store.finished_store import Store

Run = Callable[..., Any]
XSD = xmlschema.XMLSchema(Path(__file__).parent.with_name("comparison") / "junit.xsd")

SHELL = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 .1" margin="0.02"/>
  <body name="box" pos="0 0 .06"><freejoint/><geom name="box" type="box" size=".05 .05 .05"/></body>
</worldbody>
<keyframe>
  <key name="high" qpos="0 0 .5 1 0 0 0"/>
  <key name="low" qpos="0 0 .06 1 0 0 0"/>
</keyframe>
</mujoco>"""
OPEN = """<mujoco><worldbody>
  <body name="rotor"><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 3"/></body>
</worldbody></mujoco>"""
CHECK = ("check", "--workers", "0")
SHORT = (*CHECK, "own.xml", "--set", "duration=0.3")


@pytest.fixture(autouse=True)
def _own(tmp_path: Path) -> None:
    (tmp_path / "own.xml").write_text(SHELL)


@pytest.mark.long
def test_a_model_that_misses_a_rule_of_thumb(contactlab: Run, tmp_path: Path) -> None:
    code, out, err = contactlab(*SHORT, "--only", "shells", "--only", "timestep")
    assert (code, err) == (0, "")
    assert "own, from keyframe high, driven by exercise, for manipulation" in out
    assert re.search("WARN +shell", out)
    assert "margin lets contact force start 20 mm before touch (floor-box, limit 0.1 mm)" in out
    assert "contactlab stability own.xml" in out
    page = (tmp_path / "results/check/own/check.md").read_text()
    assert page.startswith("### ✅ own.xml passes\n")
    assert "#### flat_contact" not in page
    assert "#### shells: warning" in page
    # A margin of the geom's own is reached by no default; it is changed where it stands.
    assert "1. margin 0 mends shell" in out
    change = 'own.xml:2: <geom name="floor" type="plane" size="1 1 .1" margin="0"/>'
    assert f"\n   {change}\n" in out
    assert change in page


def test_an_error_fails(contactlab: Run) -> None:
    code, out, err = contactlab(*CHECK, "thin_plate", "--only", "timestep", "--no-remedies")
    assert code == 1
    assert err == "error: thin_plate fails travel\n"
    assert re.search("FAIL +travel +travel 20 mm", out)
    assert contactlab(*CHECK, "thin_plate", "--only", "shells", "--no-remedies")[0] == 0


ACCEPTED = """version: 1
accept:
  - {check: travel, max: 1, reason: the plate is meant to be passed}
  - {check: step_ratio, max: 9, reason: it was soft once}
"""


@pytest.mark.long
def test_what_is_accepted_fails_no_job(contactlab: Run, tmp_path: Path) -> None:
    file = tmp_path / "accepted.yaml"
    file.write_text(ACCEPTED)
    only = (*CHECK, "thin_plate", "--only", "timestep", "--no-remedies", "--accept", str(file))
    code, out, err = contactlab(*only)
    assert (code, err) == (0, "")
    assert "; accepted: the plate is meant to be passed" in out
    assert "'step_ratio' is accepted (it was soft once), but does not fail: remove it" in out
    file.write_text(ACCEPTED.replace("max: 1", "max: 0"))
    code, out, _ = contactlab(*only)
    assert code == 1
    assert "accepted for 0, but 1 fall short" in out
    file.write_text(ACCEPTED.replace("max: 1,", "max: 1, until: 2020-01-01,"))
    assert contactlab(*only)[0] == 1
    file.write_text(ACCEPTED.replace("travel", "travels"))
    code, out, err = contactlab(*only)
    assert (code, out) == (2, "")
    assert "did you mean 'travel'?" in err


@pytest.mark.long
def test_limits_of_ones_own(contactlab: Run) -> None:
    only = (*SHORT, "--only", "shells", "--no-remedies", "--set", "margin=1e-3")
    assert "force start 1 mm before touch (floor-box, limit 0.1 mm)" in contactlab(*only).out
    assert "WARN" not in contactlab(*only, "--within", "shell=2e-3").out
    code, out, err = contactlab(*only, "--within", "shel=1")
    assert (code, out) == (2, "")
    assert "no limit 'shel'; did you mean 'shell'?; there are penetration_steady, " in err
    wrong = contactlab(*only, "--within", "shell").err
    assert "'--within shell' is no tolerance; write a share or a length" in wrong


@pytest.mark.long
def test_outputs_for_jobs(contactlab: Run) -> None:
    only = (*CHECK, "thin_plate", "--only", "timestep", "--only", "hold", "--no-remedies")
    code, out, _ = contactlab(*only, "--format", "junit")
    assert code == 1
    XSD.validate(out)
    cases = {case.get("name"): case for case in ET.fromstring(out).iter("testcase")}  # noqa: S314
    assert cases["travel"].get("classname") == "contactlab.thin_plate.timestep"
    assert [child.tag for child in cases["travel"]] == ["failure"]
    assert [child.tag for child in cases["hold"]] == ["skipped"]
    assert [*cases["step_ratio"]] == []
    out = contactlab(*only, "--format", "github").out
    assert out.startswith("::error title=contactlab check thin_plate::travel: travel 20 mm")


@pytest.mark.long
def test_a_model_that_passes_as_json(contactlab: Run, tmp_path: Path) -> None:
    code, out, err = contactlab(
        *SHORT, "--set", "margin=0", "--set", "solref=0.005 1", "--format", "json", "-o", "out"
    )
    assert (code, err) == (0, "")
    data = json.loads(out)
    assert data == json.loads((tmp_path / "out/check.json").read_text())
    Draft202012Validator(json_schemas()["check.schema.json"]).validate(data)
    report = CheckReport.model_validate(data)
    assert report.passed
    assert report.remedies == ()
    assert report.overrides == ("duration=0.3", "margin=0", "solref=0.005 1")
    verdicts = {each.name: each.verdict for each in report.checks}
    assert list(verdicts) == [
        "task",
        "timestep",
        "free_motion",
        "flat_contact",
        "hold",
        "must",
        "repeat",
        "shells",
    ]
    assert set(verdicts.values()) <= {"pass", "warning", "not applicable"}
    reference = json.loads((tmp_path / "out/reference.json").read_text())
    Draft202012Validator(json_schemas()["reference.schema.json"]).validate(reference)


@pytest.mark.long
def test_the_evidence_stands_by_itself(contactlab: Run, tmp_path: Path) -> None:
    only = ("--only", "shells", "--only", "flat_contact")
    # It rests for the first third, in which the box has to come to rest.
    low = ("--start", "low", "--duration", "1.5s")
    assert contactlab(*CHECK, "own.xml", "--set", "margin=0", *only, *low, "-o", "out")[0] == 0
    (tmp_path / "own.xml").unlink()
    for store in ("run", "flat_contact", "remedies/1/run"):
        assert contactlab("verify", f"out/{store}")[0] == 0
        run = Store.open(tmp_path / "out" / store).table["run_id"][0].as_py()
        assert contactlab("replay", f"out/{store}", run)[0] == 0


@pytest.mark.long
@pytest.mark.parametrize(("keyframe", "height"), [(None, 0.5), ("low", 0.06), ("qpos0", 0.06)])
def test_runs_start_from_the_keyframe(
    contactlab: Run, keyframe: str | None, height: float, tmp_path: Path
) -> None:
    option = ("--start", keyframe) if keyframe else ()
    contactlab(*SHORT, *option, "--only", "shells", "-o", "out")
    store = Store.open(tmp_path / "out/run")
    assert store.table["seed"].to_pylist() == [0, 1, 2]
    first = store.table["run_id"][0].as_py()
    record = json.loads(contactlab("show", "out/run", first, "--format", "json")[1])
    # The first seed starts as the model is written.
    assert record["initial"]["qpos"][:3] == [0, 0, height]


@pytest.mark.long
def test_it_is_run_again_in_the_same_folder(contactlab: Run) -> None:
    once = (*SHORT, "--only", "shells", "--no-remedies")
    assert contactlab(*once) == contactlab(*once)
    again = contactlab(*SHORT, "--only", "shells", "--set", "margin=0", "--start", "low")
    assert again.code == 0


@pytest.mark.parametrize(
    ("arguments", "messages"),
    [
        (["gone.xml"], ["no model file gone.xml"]),
        (["ball_drp"], ["did you mean 'ball_drop'?"]),
        (["own.xml", "--only", "shels"], ["no check 'shels'; did you mean 'shells'?"]),
        (["own.xml", "--start", "hig"], ["keyframe=hig", "write one of high, low, qpos0"]),
        (["own.xml", "--set", "timestp=1"], ["did you mean 'timestep'?"]),
        (["own.xml", "--set", "cone=round", "--set", "impratio=-1"], ["'round'", "above 0"]),
        (["own.xml", "--set", "solref=0.02 1,0.005 1"], ["one value, not 2"]),
        (["own.xml", "--set", "seeds=3"], ["axes of the scene, duration and must only"]),
        (["own.xml", "--set", "engine=impulse"], ["engine"]),
        (["open.xml"], ["does not compile", "body 'rotor'", "1 + 1 < 3"]),
    ],
)
def test_bad_input(
    contactlab: Run, tmp_path: Path, arguments: list[str], messages: list[str]
) -> None:
    (tmp_path / "open.xml").write_text(OPEN)
    code, out, err = contactlab(*CHECK, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("error")
    assert all(message in err for message in messages), err
    assert not (tmp_path / "results").exists()


@pytest.mark.long
def test_a_model_without_a_timestep(contactlab: Run, tmp_path: Path) -> None:
    timeless = SHELL.replace("<mujoco>", '<mujoco><option timestep="0"/>')
    (tmp_path / "own.xml").write_text(timeless)
    code, out, err = contactlab(*CHECK, "own.xml")
    assert (code, out) == (2, "")
    assert "its timestep is 0 s" in err
    assert contactlab(*SHORT, "--set", "timestep=2e-3", "--only", "shells")[0] == 0


def test_a_folder_that_cannot_be_written(contactlab: Run, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    code, out, err = contactlab(*SHORT, "-o", "file/here")
    assert (code, out) == (2, "")
    assert err.startswith("error: cannot write")
    assert "Traceback" not in err
