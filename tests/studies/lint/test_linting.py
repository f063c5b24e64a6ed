"""What is linted, ignored and skipped; and what is written of it."""

import json
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest
from jsonschema.validators import validator_for
from tests.studies.lint.conftest import Linted, only, rules_of
from tests.studies.lint.test_rules import ROBOT

import contactlab
from contactlab.errors import SceneError
from contactlab.studies.lint.linting import findings_of_lint, lint
from contactlab.studies.lint.rules import RULES
from contactlab.writers import WRITERS

ROOT = Path(__file__).parents[3]
MARGIN = ROBOT.replace('<geom name="lower"', '<geom name="lower" margin=".01"')
BROKEN = ROBOT.replace('qpos="0 0"', 'qpos="0 1.5"')
_IGNORE = "<!-- contactlab: ignore {} -->"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('size=".02"/>\n        </body>', 'size=".02"/> {}\n        </body>'),
        ('<geom name="lower"', '{}\n          <geom name="lower"'),
        ('<mujoco model="arm">', '<mujoco model="arm"> {}'),
        ('<mujoco model="arm">', '{}\n<mujoco model="arm">'),
    ],
    ids=["beside", "above", "beside the root", "above the root"],
)
def test_a_comment_ignores_a_rule_where_it_stands(linted: Linted, old: str, new: str) -> None:
    other = _IGNORE.format("keyframe-range")
    assert only(linted(MARGIN.replace(old, new.format(other))), "contact-margin").waived is None
    ignored = _IGNORE.format("memory, contact-margin")
    report = linted(MARGIN.replace(old, new.format(ignored)))
    assert "ignored in robot.xml:" in str(only(report, "contact-margin").waived)
    assert "1 ignored" in report.headline


def test_a_comment_beside_another_element_ignores_nothing(linted: Linted) -> None:
    text = MARGIN.replace("<worldbody>", f"<worldbody> {_IGNORE.format('contact-margin')}")
    assert only(linted(text), "contact-margin").waived is None


def test_an_ignored_error_passes(linted: Linted) -> None:
    assert not linted(BROKEN).passed
    ignored = _IGNORE.format("keyframe-range")
    assert linted(BROKEN.replace('ctrl="0"/>', f'ctrl="0"/> {ignored}')).passed


def test_a_comment_that_names_no_rule_is_told(linted: Linted) -> None:
    report = linted(ROBOT.replace("<worldbody>", f"<worldbody> {_IGNORE.format('margins')}"))
    assert "margins" in only(report, "unknown-rule").message


def test_a_manifest_ignores_for_the_whole_scene(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(BROKEN)
    (tmp_path / "scene.yaml").write_text(
        "version: 1\ntitle: An arm\ndescription: An arm\nduration: 1.0\n"
        "model: robot.xml  # contactlab: ignore keyframe-range\n"
    )
    assert lint([f"{tmp_path}/"]).passed


def test_a_part_is_linted_in_the_models_that_include_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    start, keys = BROKEN.split("  <keyframe>")
    keys = "  <keyframe>" + keys.removesuffix("</mujoco>\n")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/keys.xml").write_text(f"<mujocoinclude>\n{keys}</mujocoinclude>")
    (tmp_path / "arm.xml").write_text(f'{start}<include file="parts/keys.xml"/></mujoco>')
    for files in (["parts/keys.xml"], ["arm.xml"], ["arm.xml", "parts/keys.xml"]):
        report = lint(files)
        assert report.models == ("arm.xml",)
        found = only(report, "keyframe-range")
        assert (found.file, found.line) == ("parts/keys.xml", 3)


def test_a_keyframe_after_an_include_has_its_own_line(linted: Linted, tmp_path: Path) -> None:
    """What is included moves the elements behind it, and not the lines of the file."""
    (tmp_path / "lights.xml").write_text("<mujocoinclude><light/><light/></mujocoinclude>")
    text = BROKEN.replace("<worldbody>", '<worldbody><include file="lights.xml"/>')
    found = only(linted(text), "keyframe-range")
    assert "<key" in text.splitlines()[found.line - 1]


def test_assets_that_an_include_names_from_its_folder_are_found(tmp_path: Path) -> None:
    """MuJoCo looks beside the included file for what is not beside the model."""
    (tmp_path / "parts").mkdir()
    mesh = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "parts/x.obj").write_text(mesh)
    (tmp_path / "parts/a.xml").write_text(
        '<mujocoinclude><asset><mesh name="x" file="x.obj"/></asset></mujocoinclude>'
    )
    robot = tmp_path / "robot.xml"
    robot.write_text(
        '<mujoco><compiler meshdir="none"/><include file="parts/a.xml"/><worldbody><body>'
        '<freejoint/><geom type="mesh" mesh="x"/></body></worldbody></mujoco>'
    )
    mujoco.MjModel.from_xml_path(str(robot))
    assert lint([str(robot)]).passed


def test_a_part_without_bodies_is_no_model(tmp_path: Path) -> None:
    """Actuators of joints that other files have are for these: no error is told of them."""
    part = tmp_path / "motors.xml"
    part.write_text('<mujoco><actuator><motor joint="elbow"/></actuator></mujoco>')
    assert lint([str(part)]).skipped == (str(part),)


def test_what_is_no_model_is_skipped_and_what_is_not_there_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "package.xml").write_text("<package/>")
    (tmp_path / "part.xml").write_text("<mujocoinclude/>")
    report = lint(["package.xml", "part.xml"])
    assert report.skipped == ("package.xml", "part.xml")
    assert not report.findings
    with pytest.raises(SceneError, match=r"no model file arm\.xml"):
        lint(["arm.xml"])


def test_one_broken_file_does_not_hide_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.xml").write_text("<mujoco>\n<worldbody>\n</mujoco>")
    (tmp_path / "b.xml").write_text(BROKEN)
    report = lint(["a.xml", "b.xml"])
    assert rules_of(report) == {"unread", "keyframe-range"}
    assert (only(report, "unread").file, only(report, "unread").line) == ("a.xml", 3)


def test_a_name_that_is_used_twice_is_told_at_its_line(linted: Linted) -> None:
    text = ROBOT.replace('<geom name="lower"', '<geom name="upper"')
    found = only(linted(text), "unread")
    assert "called 'upper'; give it another name" in found.message
    assert '<geom name="upper"' in text.splitlines()[found.line - 1]


def test_a_number_that_no_run_can_use_is_named(linted: Linted) -> None:
    heavy = '<body name="ball"><freejoint/><geom size=".1" mass="1e308"/></body>'
    found = only(linted(f"<mujoco><worldbody>{heavy}</worldbody></mujoco>"), "unread")
    assert found.message.startswith("inertia of body 'ball' is inf")
    assert "write finite numbers" in found.message


def test_annotations_have_file_and_line(linted: Linted) -> None:
    text = WRITERS["github"](findings_of_lint(linted(BROKEN)))
    line = BROKEN.splitlines().index('    <key name="home" qpos="0 1.5" ctrl="0"/>') + 1
    assert text.startswith(f"::error file=robot.xml,line={line},title=contactlab lint::")


def test_sarif_has_each_finding_with_its_rule_and_place(linted: Linted) -> None:
    text = BROKEN.replace('<geom name="lower"', '<geom name="lower" margin=".01"')
    report = linted(text.replace("<worldbody>", f"<worldbody> {_IGNORE.format('nothing')}"))
    (run,) = json.loads(WRITERS["sarif"](findings_of_lint(report)))["runs"]
    rules = run["tool"]["driver"]["rules"]
    places = {
        (
            result["ruleId"],
            result["level"],
            result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"],
            result["locations"][0]["physicalLocation"]["region"]["startLine"],
        )
        for result in run["results"]
    }
    assert places == {(each.name, each.severity, each.file, each.line) for each in report.findings}
    for result in run["results"]:
        rule = rules[result["ruleIndex"]]
        assert rule["id"] == result["ruleId"]
        if rule["id"] in RULES:
            assert rule["shortDescription"]["text"] == RULES[rule["id"]].about


def test_sarif_suppresses_what_is_ignored(linted: Linted) -> None:
    ignored = _IGNORE.format("keyframe-range")
    report = linted(BROKEN.replace('ctrl="0"/>', f'ctrl="0"/> {ignored}'))
    (run,) = json.loads(WRITERS["sarif"](findings_of_lint(report)))["runs"]
    assert run["results"][0]["suppressions"][0]["kind"] == "inSource"


@pytest.mark.long
def test_sarif_is_valid_by_its_published_schema(linted: Linted, tmp_path: Path) -> None:
    # Microsoft's package for tests of SARIF carries the standard's schema.
    package = ["npm", "pack", "@microsoft/jest-sarif@1.0.0-beta.0", "--silent"]
    try:
        done = subprocess.run(
            package, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        pytest.skip("npm is not there, or reaches no registry")
    if done.returncode:
        pytest.skip("npm reaches no registry")
    archive = tmp_path / done.stdout.split()[-1]
    subprocess.run(["tar", "xf", archive], cwd=tmp_path, check=True)
    schema = json.loads((tmp_path / "package/lib/schemas/sarif-2.1.0-rtm.5.json").read_text())
    reports = [
        linted(ROBOT),
        linted(MARGIN),
        linted(BROKEN.replace('ctrl="0"/>', f'ctrl="0"/> {_IGNORE.format("keyframe-range")}')),
        linted(BROKEN),
    ]
    validator = validator_for(schema)(schema)
    for report in reports:
        assert not list(
            validator.iter_errors(json.loads(WRITERS["sarif"](findings_of_lint(report))))
        )
    broken = json.loads(WRITERS["sarif"](findings_of_lint(reports[-1])))
    del broken["runs"][0]["tool"]
    assert list(validator.iter_errors(broken))


def test_lint_is_a_function(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(BROKEN)
    assert not contactlab.lint(tmp_path / "robot.xml").passed
    assert contactlab.lint([tmp_path / "robot.xml"]).open("error")


@pytest.mark.long
def test_the_hook_runs_in_a_fresh_repository(tmp_path: Path) -> None:
    """A commit of a broken model is refused, and one of the mended model is made."""
    hooks = (ROOT / ".pre-commit-hooks.yaml").read_text(encoding="utf-8")
    scripts = Path(sys.executable).parent
    # As published, but by this environment in place of one that pre-commit would build.
    local = hooks.replace("language: python", "language: system").replace(
        "entry: contactlab", f"entry: {scripts / 'contactlab'}"
    )
    lines = "\n".join(f"      {line}" for line in local.splitlines())
    (tmp_path / ".pre-commit-config.yaml").write_text(
        f"repos:\n  - repo: local\n    hooks:\n{lines}\n"
    )

    def git(*words: str) -> int:
        own = ["-c", "user.name=a", "-c", "user.email=a@example.com"]
        return subprocess.run(
            ["git", *own, *words], cwd=tmp_path, capture_output=True, check=False
        ).returncode

    assert git("init") == 0
    subprocess.run([scripts / "pre-commit", "install"], cwd=tmp_path, check=True)
    for text, code in ((BROKEN, 1), (ROBOT, 0)):
        (tmp_path / "arm.xml").write_text(text)
        (tmp_path / "package.xml").write_text("<package/>")
        assert git("add", "-A") == 0
        assert git("commit", "-m", "An arm") == code
