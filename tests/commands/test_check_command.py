"""The section `checks` of `contactlab examine`: exit codes, what it prints and what it leaves."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import xmlschema
from jsonschema import Draft202012Validator

from contactlab.schema.examination import Examination
from contactlab.schema.json_schemas import json_schemas
from contactlab.store.finished_store import Store

Run = Callable[..., Any]
XSD = xmlschema.XMLSchema(Path(__file__).parent.with_name("comparison") / "junit.xsd")

BOX = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 .1"/>
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
CHECK = ("examine", "--section", "checks", "--workers", "0")
SHORT = (*CHECK, "own.xml", "--set", "duration=0.2")
# A box that nothing holds breaks that it stays where it is.
FALLS = (*SHORT, "--keyframe", "high", "--drive", "none", "--require", "still(box, 1 mm)")


@pytest.fixture(autouse=True)
def _own(tmp_path: Path) -> None:
    (tmp_path / "own.xml").write_text(BOX)


@pytest.mark.long
def test_an_error_fails(contactlab: Run) -> None:
    code, out, err = contactlab(*FALLS, "--check", "requirements")
    assert code == 1
    assert "own.xml: fails" in err
    assert "requirements: seed 0: still(box, 1 mm): moves by up to" in out
    assert re.search("^FAIL +requirements broken 1", out, re.MULTILINE)
    # A check that was not asked for fails nothing.
    assert contactlab(*FALLS, "--check", "inertia")[0] == 0


WAIVERS = """version: 1
waive:
  - {check: requirements_broken, max: 3, reason: it is meant to fall}
  - {check: impossible_bodies, max: 9, reason: it was odd once}
"""


@pytest.mark.long
def test_what_is_accepted_fails_no_job(contactlab: Run, tmp_path: Path) -> None:
    file = tmp_path / "accepted.yaml"
    file.write_text(WAIVERS)
    only = (*FALLS, "--check", "requirements", "--check", "inertia", "--waive", str(file))
    code, out, _ = contactlab(*only)
    assert code == 0
    assert "waived: it is meant to fall" in " ".join(out.split())
    stale = "'impossible_bodies' is waived (it was odd once), but does not fail: remove the waiver"
    assert stale in " ".join(out.split())
    file.write_text(WAIVERS.replace("max: 3", "max: 0"))
    assert contactlab(*only)[0] == 1
    file.write_text(WAIVERS.replace("max: 3,", "max: 3, until: 2020-01-01,"))
    assert contactlab(*only)[0] == 1
    file.write_text(WAIVERS.replace("requirements_broken", "requirement_broken"))
    code, out, err = contactlab(*only)
    assert (code, out) == (2, "")
    assert "did you mean 'requirements_broken'?" in err


@pytest.mark.long
def test_outputs_for_jobs(contactlab: Run) -> None:
    only = (*FALLS, "--check", "requirements", "--check", "inertia")
    code, out, _ = contactlab(*only, "--format", "junit")
    assert code == 1
    XSD.validate(out)
    cases = {case.get("name"): case for case in ET.fromstring(out).iter("testcase")}  # noqa: S314
    assert [child.tag for child in cases["requirements_broken"]] == ["failure"]
    assert [*cases["impossible_bodies"]] == []
    out = contactlab(*only, "--format", "github").out
    assert out.startswith("::error title=contactlab examine own.xml::requirements_broken: ")
    assert contactlab(*only, "--format", "markdown").out.startswith("### own.xml: fails")


@pytest.mark.long
def test_a_model_that_passes_as_json(contactlab: Run, tmp_path: Path) -> None:
    low = ("--keyframe", "low", "--drive", "none", "--duration", "0.5s")
    code, out, _ = contactlab(*CHECK, "own.xml", *low, "--format", "json", "-o", "out")
    assert code == 0
    data = json.loads(out)
    assert data == json.loads((tmp_path / "out/examination.json").read_text())
    Draft202012Validator(json_schemas()["examination.schema.json"]).validate(data)
    report = Examination.model_validate(data)
    assert report.passed
    assert report.sections == ("checks",)
    assert [check.name for check in report.checks] == ["task", "requirements", "inertia", "repeat"]
    assert {check.verdict for check in report.checks} <= {"pass", "not applicable"}
    reference = json.loads((tmp_path / "out/reference.json").read_text())
    Draft202012Validator(json_schemas()["reference.schema.json"]).validate(reference)
    # The evidence stands by itself.
    (tmp_path / "own.xml").unlink()
    for name in ("run", "repeat"):
        assert contactlab("verify", f"out/{name}")[0] == 0
        run = Store.open(tmp_path / "out" / name).table["run_id"][0].as_py()
        assert contactlab("verify", f"out/{name}", run)[0] == 0


@pytest.mark.long
@pytest.mark.parametrize(("keyframe", "height"), [(None, 0.5), ("low", 0.06), ("qpos0", 0.06)])
def test_runs_start_from_the_keyframe(
    contactlab: Run, keyframe: str | None, height: float, tmp_path: Path
) -> None:
    option = ("--keyframe", keyframe) if keyframe else ()
    contactlab(*SHORT, *option, "--check", "requirements", "-o", "out")
    store = Store.open(tmp_path / "out/run")
    assert store.table["seed"].to_pylist() == [0, 1, 2]
    first = store.table["run_id"][0].as_py()
    record = json.loads(contactlab("show", "out/run", first, "--format", "json")[1])
    # The first seed starts as the model is written.
    assert record["initial"]["qpos"][:3] == [0, 0, height]


@pytest.mark.parametrize(
    ("arguments", "messages"),
    [
        (["gone.xml"], ["no model file gone.xml"]),
        (["ball_drp"], ["did you mean 'ball_drop'?"]),
        (["own.xml", "--check", "repet"], ["no check 'repet'", "did you mean 'repeat'?"]),
        (["own.xml", "--keyframe", "hig"], ["--keyframe hig", "write one of high, low, qpos0"]),
        (["own.xml", "--set", "timestp=1"], ["did you mean 'timestep'?"]),
        (["own.xml", "--set", "cone=round", "--set", "impratio=-1"], ["'round'", "above 0"]),
        (["own.xml", "--set", "solref=0.02 1,0.005 1"], ["one value, not 2"]),
        (["own.xml", "--set", "seeds=3"], ["axes of the scene, duration and must only"]),
        (
            ["own.xml", "--tolerance", "penetration_stedy=1mm"],
            ["did you mean 'penetration_steady'?"],
        ),
        (["own.xml", "--tolerance", "slip"], ["'--tolerance slip' is not a tolerance"]),
        (["open.xml"], ["does not compile", "body 'rotor'", "1 + 1 < 3"]),
        (["timeless.xml"], ["its timestep is 0 s"]),
    ],
)
def test_bad_input(
    contactlab: Run, tmp_path: Path, arguments: list[str], messages: list[str]
) -> None:
    (tmp_path / "open.xml").write_text(OPEN)
    timeless = BOX.replace("<mujoco>", '<mujoco><option timestep="0"/>')
    (tmp_path / "timeless.xml").write_text(timeless)
    code, out, err = contactlab(*CHECK, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("error")
    assert all(message in err for message in messages), err
