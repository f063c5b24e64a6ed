"""The workflow examples/ci/contact-attest.yml writes a predicate of in-toto from a comparison."""

import hashlib
import json
import shutil
import subprocess
from pathlib import Path

import pytest
from ruamel.yaml import YAML

WORKFLOW = Path(__file__).parents[2] / "examples/ci/contact-attest.yml"
JOB = YAML(typ="safe").load(WORKFLOW)["jobs"]["attest"]
(PREDICATE,) = (step["run"] for step in JOB["steps"] if "jq" in step.get("run", ""))


@pytest.mark.skipif(shutil.which("jq") is None, reason="jq is not installed")
@pytest.mark.parametrize(("code", "result"), [(0, "PASSED"), (1, "FAILED"), (3, "FAILED")])
def test_the_predicate_is_that_of_test_results(tmp_path: Path, code: int, result: str) -> None:
    # https://github.com/in-toto/attestation/blob/main/spec/predicates/test-result.md
    files = {"sweeps/gripper.yaml": "version: 1", "baselines/gripper/manifest.json": "{}"}
    outcomes = {"same engine": "passed", "depth": "failed", "slip": "warned", "new runs": "noted"}
    findings = [{"name": name, "outcome": outcome} for name, outcome in outcomes.items()]
    report = {"exit_code": code, "findings": [*findings, *findings]}
    for name, text in (files | {"results/compare.json": json.dumps(report)}).items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    subprocess.run(["bash", "-euo", "pipefail", "-c", PREDICATE], cwd=tmp_path, check=True)
    assert json.loads((tmp_path / "results/predicate.json").read_text()) == {
        "result": result,
        "configuration": [
            {"uri": name, "digest": {"sha256": hashlib.sha256(text.encode()).hexdigest()}}
            for name, text in files.items()
        ],
        "passedTests": ["same engine"],
        "warnedTests": ["slip"],
        "failedTests": ["depth"],
    }


def test_the_signed_file_has_the_hash_of_every_other() -> None:
    (attest,) = (step["with"] for step in JOB["steps"] if "attest" in step.get("uses", ""))
    assert attest["subject-path"] == "results/gripper/manifest.json"
    assert attest["predicate-path"] == "results/predicate.json"
