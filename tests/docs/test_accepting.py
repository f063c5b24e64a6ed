"""The workflow examples/ci/contact-accept.yml accepts only the commit that its comment names."""

import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

WORKFLOW = Path(__file__).parents[2] / "examples/ci/contact-accept.yml"
JOB = YAML(typ="safe").load(WORKFLOW)["jobs"]["accept"]
(CHECKOUT,) = (step for step in JOB["steps"] if "gh pr checkout" in step.get("run", ""))
# Checks out the pull request's branch as it is by now.
GH = '#!/bin/sh\n[ "$1 $2 $3" = "pr checkout 7" ] && exec git checkout --quiet change\n'


@pytest.fixture
def repository(tmp_path: Path) -> Any:
    """Return what runs git in a repository whose branch `change` is one commit ahead."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/gh").write_text(GH)
    (tmp_path / "bin/gh").chmod(0o755)

    def git(*words: str) -> str:
        who = ["-c", "user.name=us", "-c", "user.email=us@example.org"]
        command = ["git", "-C", str(tmp_path), *who, *words]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    git("init", "--quiet", "--initial-branch=main")
    git("commit", "--quiet", "--allow-empty", "-m", "begin")
    git("checkout", "--quiet", "-b", "change")
    git("commit", "--quiet", "--allow-empty", "-m", "reviewed")
    return git


@pytest.mark.parametrize("named", ["reviewed", "before", "short"])
def test_what_was_pushed_after_the_review_is_not_accepted(
    repository: Any, tmp_path: Path, named: str
) -> None:
    reviewed = repository("rev-parse", "change")
    if named == "before":
        repository("commit", "--quiet", "--allow-empty", "-m", "pushed since")
    repository("checkout", "--quiet", "main")
    digits = reviewed[:7] if named == "short" else reviewed
    given = {"COMMENT": f"/contactlab accept {digits}", "NUMBER": "7", "GH_TOKEN": "none"}
    assert given.keys() == CHECKOUT["env"].keys()
    path = f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}"
    # As GitHub runs a step.
    done = subprocess.run(
        ["bash", "-e", "-c", CHECKOUT["run"]],
        cwd=tmp_path, env=os.environ | given | {"PATH": path}, capture_output=True, check=False,
    )  # fmt: skip
    assert (done.returncode == 0) == (named == "reviewed")


def test_only_who_may_write_accepts_and_no_text_of_a_comment_is_a_script() -> None:
    allowed = re.findall(r"fromJSON\('\[(.*?)]'\)", JOB["if"])
    assert allowed == ['"OWNER", "MEMBER", "COLLABORATOR"']
    names = [step.get("name") for step in JOB["steps"]]
    installs = next(at for at, step in enumerate(JOB["steps"]) if "pip" in step.get("run", ""))
    assert names.index(CHECKOUT["name"]) < installs
    assert not any("${{" in step.get("run", "") for step in JOB["steps"])
