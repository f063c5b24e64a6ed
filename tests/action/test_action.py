"""The steps of action.yml, run one after the other as GitHub runs them, with a `gh` of our own."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[2]
ACTION = YAML(typ="safe").load((ROOT / "action.yml").read_text(encoding="utf-8"))
SWEEP = """\
version: 1
scene: ball_drop
duration: 0.3
axes: {timestep: [2.0e-3, 4.0e-3], drop_height: [0.02, 0.1, 0.3]}
expect:
  - {where: {timestep: 2.0e-3, drop_height: 0.02}, label: stable}
"""
# Keeps comments in a file, one a line, as GitHub keeps those of a pull request.
GH = """\
#!{python}
import json, sys
from pathlib import Path

kept = Path({kept!r})
comments = json.loads(kept.read_text()) if kept.exists() else {{}}
if "--method" not in sys.argv:
    marker = sys.argv[-1].split('startswith("')[1].split('")')[0]
    assert ".viewerDidAuthor and" in sys.argv[-1]
    own = {{key: body for key, body in comments.items() if not key.startswith("other")}}
    print("\\n".join(key for key, body in own.items() if body.startswith(marker)))
else:
    body = Path(sys.argv[-1].removeprefix("body=@")).read_text()
    key = sys.argv[4].rpartition("/")[2]
    comments[str(len(comments) + 7) if key == "comments" else key] = body
    kept.write_text(json.dumps(comments))
"""


class Job:
    """A job whose only step is the action, in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.outputs = folder, dict[str, str]()
        binaries = folder / "temp/contactlab/bin"
        binaries.mkdir(parents=True)
        for name in ("contactlab", "python"):
            # In place of the step that installs, whose commands packaging tests run.
            script = binaries / name
            script.write_text(f'#!/bin/sh\nexec {Path(sys.executable).parent / name} "$@"\n')
            script.chmod(0o755)
        self.comments = folder / "comments.json"
        gh = folder / "gh/gh"
        gh.parent.mkdir()
        gh.write_text(GH.format(python=sys.executable, kept=str(self.comments)))
        gh.chmod(0o755)

    def run(self, **inputs: str) -> int:
        """Run the action's own steps with these inputs; return the exit code of its last."""
        values = {name: each.get("default", "") for name, each in ACTION["inputs"].items()}
        context = {f"inputs.{name}": value for name, value in (values | inputs).items()}
        context |= {"github.event.pull_request.number": "3"}
        context |= {"steps.upload.outputs.artifact-url": "https://example.org/page"}
        code, self.outputs = -1, {}
        for step in ACTION["runs"]["steps"]:
            if "run" not in step or step["name"].startswith("Install"):
                continue
            context |= {f"steps.judge.outputs.{key}": text for key, text in self.outputs.items()}
            code = self._step(step, context)
            if step.get("id") == "judge" and "verdict" not in self.outputs:
                return code
        return code

    def _step(self, step: dict[str, Any], context: dict[str, str]) -> int:
        def filled(text: str) -> str:
            return re.sub(r"\$\{\{ ([\w.-]+) }}", lambda found: context.get(found[1], ""), text)

        written = self.folder / "outputs"
        written.write_text("")
        environment = os.environ | {
            "GITHUB_ACTION_PATH": str(ROOT),
            "GITHUB_ACTIONS": "true",
            "GITHUB_OUTPUT": str(written),
            "GITHUB_REPOSITORY": "us/robot",
            "GITHUB_STEP_SUMMARY": str(self.folder / "summary.md"),
            "PATH": f"{self.folder / 'gh'}:{os.environ['PATH']}",
            "RUNNER_TEMP": str(self.folder / "temp"),
        }
        environment |= {name: filled(value) for name, value in step.get("env", {}).items()}
        done = subprocess.run(
            ["/bin/bash", "-e", "-o", "pipefail", "-c", filled(step["run"])],
            check=False,
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
        )
        self.out = getattr(self, "out", "") + done.stdout
        self.err = done.stderr
        self.outputs |= dict(line.split("=", 1) for line in written.read_text().splitlines())
        return done.returncode

    def posted(self) -> dict[str, str]:
        """Return the comments of the pull request, by number."""
        return json.loads(self.comments.read_text())


@pytest.fixture
def job(tmp_path: Path) -> Job:
    (tmp_path / "drop.yaml").write_text(SWEEP)
    return Job(tmp_path)


@pytest.mark.night
def test_the_first_run_needs_no_baseline(job: Job) -> None:
    assert job.run(sweep="drop.yaml") == 0, job.err
    assert job.outputs["verdict"] == "passed"
    [comment] = job.posted().values()
    assert "1 of 1 stated runs are as expected" in comment
    assert r"| drop\_height | timestep=0.002 | timestep=0.004 |" in comment
    assert "| 0.02 | 🟩 |" in comment
    assert "https://example.org/page" in comment
    assert (job.folder / "results/contactlab/page.html").stat().st_size > 10_000


@pytest.mark.night
def test_a_change_is_told_at_its_line_and_in_the_same_comment(job: Job) -> None:
    assert job.run(sweep="drop.yaml") == 0, job.err
    (job.folder / "results/contactlab/store").rename(job.folder / "kept")
    assert job.run(sweep="drop.yaml", baseline="kept") == 0, job.err
    assert job.outputs["verdict"] == "passed"
    # A sweep that expects what does not happen, of the same runs.
    (job.folder / "drop.yaml").write_text(SWEEP.replace("label: stable", "label: tunneling"))
    assert job.run(sweep="drop.yaml") == 1
    assert "::error file=drop.yaml,line=5,title=contactlab::run " in job.out
    # Another solref, with the same axes: worse, at the scene's line.
    (job.folder / "drop.yaml").write_text(SWEEP + "seeds: 1\n")
    (job.folder / "policy.yaml").write_text("version: 1\nmatch: axes\n")
    changed = {"options": "--set 'solref=0.05 1'", "policy": "policy.yaml"}
    assert job.run(sweep="drop.yaml", baseline="kept", **changed) == 1
    assert job.outputs["verdict"] == "failed"
    assert "::error file=drop.yaml,line=2,title=contactlab::penetration_max no worse" in job.out
    [comment] = job.posted().values()
    assert "penetration" in comment
    assert "❌" in comment
    assert "❌" in (job.folder / "summary.md").read_text()


@pytest.mark.night
def test_a_lock_takes_the_place_of_a_baseline(job: Job) -> None:
    program = job.folder / "temp/contactlab/bin/contactlab"
    subprocess.run([program, "lock", "drop.yaml"], cwd=job.folder, check=True)
    assert job.run(sweep="drop.yaml", lock="drop.lock.yaml") == 0, job.err
    assert job.outputs["verdict"] == "passed"
    assert job.run(sweep="drop.yaml", lock="drop.lock.yaml", options="--set 'solref=0.05 1'") == 1
    assert job.outputs["verdict"] == "failed"
    assert "::error file=drop.yaml,line=2,title=contactlab::penetration_max as locked" in job.out
    [comment] = job.posted().values()
    assert "as locked" in comment


def test_a_lock_and_a_baseline_are_one_too_many(job: Job) -> None:
    assert job.run(sweep="drop.yaml", lock="drop.lock.yaml", baseline="kept") == 2
    assert "a lock or a baseline, not both" in job.err


@pytest.mark.long
def test_a_wrong_sweep_ends_the_job_without_a_comment(job: Job) -> None:
    (job.folder / "drop.yaml").write_text("version: 1\nscene: nowhere\n")
    assert job.run(sweep="drop.yaml") == 2
    assert "nowhere" in job.err
    assert not job.comments.exists()


def test_only_its_own_comment_is_replaced(job: Job) -> None:
    """Anyone can begin a comment with the marker, and may edit it later."""
    (job.folder / "comment.md").write_text("verdict")
    foreign = "<!-- contactlab gate -->\nmine"
    job.comments.write_text(json.dumps({"other1": foreign}))
    values = {"NAME": "gate", "OUTPUT": str(job.folder), "PAGE": "", "NUMBER": "3"}
    values |= {"GITHUB_REPOSITORY": "o/r", "PATH": f"{job.folder / 'gh'}:{os.environ['PATH']}"}
    for _ in range(2):
        script = ROOT / ".github/action/comment"
        subprocess.run([script], env={**os.environ, **values}, check=True)
        posted = job.posted()
        assert posted.pop("other1") == foreign
        assert [*posted.values()] == ["<!-- contactlab gate -->\nverdict"]


def test_no_input_is_pasted_into_a_script() -> None:
    # What a pull request names would be run as code; as environment variables it is text.
    scripts = [step["run"] for step in ACTION["runs"]["steps"] if "run" in step]
    assert all("${{" not in script for script in scripts)


def test_what_is_installed_can_draw_the_page() -> None:
    (install,) = (step for step in ACTION["runs"]["steps"] if "Install" in step.get("name", ""))
    assert '"${install[@]}" "$PACKAGE"' in install["run"]
    assert "$GITHUB_ACTION_PATH" in install["run"]
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    assert {"altair", "jinja2", "vl-convert-python"} <= {name.partition(">")[0] for name in needed}


@pytest.mark.long
@pytest.mark.parametrize("package", ["", "/nowhere/contactlab.whl"])
def test_modules_of_the_checkout_do_not_run_while_installing(tmp_path: Path, package: str) -> None:
    """The step works in the folder that was checked out, which a pull request has filled."""
    (step,) = (step for step in ACTION["runs"]["steps"] if step.get("name") == "Install contactlab")
    for name in ("venv", "ensurepip", "pip", "random", "sitecustomize"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n")
    python = tmp_path / "bin" / "python"
    python.parent.mkdir()
    python.symlink_to(sys.executable)
    environment = os.environ | {
        "GITHUB_ACTION_PATH": str(tmp_path),
        "PACKAGE": package,
        "PATH": f"{python.parent}:{os.environ['PATH']}",
        "RUNNER_TEMP": str(tmp_path / "temp"),
    }
    command = ["/bin/bash", "-e", "-o", "pipefail", "-c", step["run"]]
    done = subprocess.run(
        command, check=False, cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    # Neither is there to install, but an environment was made, and its pip was called.
    assert done.returncode
    assert "contactlab.whl" in done.stderr if package else ".ci/constraints/run.txt" in done.stderr
    assert not (tmp_path / "ran").exists()
