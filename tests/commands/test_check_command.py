"""`contactlab check`: exit codes, what it prints and what it leaves."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from contactlab.schema.check_report import CheckReport
from contactlab.schema.json_schemas import json_schemas

Run = Callable[..., Any]

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


def test_a_model_that_fails(contactlab: Run, tmp_path: Path) -> None:
    code, out, err = contactlab(*SHORT, "--only", "shells", "--only", "timestep")
    assert code == 1
    assert err == "error: own.xml fails shells\n"
    assert "own, from keyframe high, for manipulation" in out
    assert "a margin of 20 mm" in out
    assert '<geom margin="0"/>' in out
    page = (tmp_path / "results/check/own/check.md").read_text()
    assert page.startswith("# own: fails\n")
    assert '```xml\n<default>\n  <geom margin="0"/>\n</default>\n```' in page
    assert "## flat_contact" not in page


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
    assert report.overrides == ("duration=0.3", "margin=0", "solref=0.005 1")
    verdicts = {each.name: each.verdict for each in report.checks}
    assert list(verdicts) == ["timestep", "free_motion", "flat_contact", "hold", "repeat", "shells"]
    assert set(verdicts.values()) <= {"pass", "not applicable"}
    reference = json.loads((tmp_path / "out/reference.json").read_text())
    Draft202012Validator(json_schemas()["reference.schema.json"]).validate(reference)


def test_the_evidence_stands_by_itself(contactlab: Run, tmp_path: Path) -> None:
    only = ("--only", "shells", "--only", "flat_contact")
    assert contactlab(*SHORT, "--set", "margin=0", *only, "-o", "out")[0] == 1
    (tmp_path / "own.xml").unlink()
    for store in ("run", "flat_contact", "flat_contact_stiffer"):
        assert contactlab("verify", f"out/{store}")[0] == 0
        code, out, _ = contactlab("show", f"out/{store}", "", "--format", "json")
        assert code == 0
        run = json.loads(out)["run_id"]
        assert contactlab("replay", f"out/{store}", run)[0] == 0


@pytest.mark.parametrize(("keyframe", "height"), [(None, 0.5), ("low", 0.06), ("qpos0", 0.06)])
def test_runs_start_from_the_keyframe(contactlab: Run, keyframe: str | None, height: float) -> None:
    option = ("--keyframe", keyframe) if keyframe else ()
    contactlab(*SHORT, *option, "--only", "shells", "-o", "out")
    record = json.loads(contactlab("show", "out/run", "", "--format", "json")[1])
    x, y, z, *_ = record["initial"]["qpos"]
    assert z == height
    # As a bare model's: off by up to 0.1 mm, so that no symmetry hides a fault.
    assert 0 < abs(x) <= 1e-4
    assert 0 < abs(y) <= 1e-4


def test_it_is_run_again_in_the_same_folder(contactlab: Run) -> None:
    first = contactlab(*SHORT, "--only", "shells")
    assert contactlab(*SHORT, "--only", "shells") == first
    again = contactlab(*SHORT, "--only", "shells", "--set", "margin=0", "--keyframe", "low")
    assert again.code == 0


@pytest.mark.parametrize(
    ("arguments", "messages"),
    [
        (["gone.xml"], ["no model file gone.xml"]),
        (["ball_drp"], ["did you mean 'ball_drop'?"]),
        (["own.xml", "--only", "shels"], ["no check 'shels'; did you mean 'shells'?"]),
        (["own.xml", "--keyframe", "hig"], ["keyframe=hig", "write one of high, low, qpos0"]),
        (["own.xml", "--set", "timestp=1"], ["did you mean 'timestep'?"]),
        (["own.xml", "--set", "cone=round", "--set", "impratio=-1"], ["'round'", "above 0"]),
        (["own.xml", "--set", "solref=0.02 1,0.005 1"], ["one value, not 2"]),
        (["own.xml", "--set", "seeds=3"], ["axes of the scene and duration only"]),
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


def test_a_model_without_a_timestep(contactlab: Run, tmp_path: Path) -> None:
    timeless = SHELL.replace("<mujoco>", '<mujoco><option timestep="0"/>')
    (tmp_path / "own.xml").write_text(timeless)
    code, out, err = contactlab(*CHECK, "own.xml")
    assert (code, out) == (2, "")
    assert "its timestep is 0 s" in err
    assert contactlab(*SHORT, "--set", "timestep=2e-3", "--only", "shells")[0] == 1


def test_a_folder_that_cannot_be_written(contactlab: Run, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    code, out, err = contactlab(*SHORT, "-o", "file/here")
    assert (code, out) == (2, "")
    assert err.startswith("error: cannot write")
    assert "Traceback" not in err
