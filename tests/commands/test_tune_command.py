"""`contactlab tune`: from a model to a written one that moves the same; mistakes in one line."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest
from tests.commands.conftest import Run

from contactlab.schema.study_reports import TuneReport
from contactlab.store.verify_store import verify

PENDULUM = """
<mujoco>\r
  <!-- a comment stays -->
  <option timestep="0.004" integrator="RK4"/>
  <worldbody>
    <body pos="0 0 1">
      <joint name="hinge" axis="0 1 0" damping="0.05"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>
    </body>
  </worldbody>
</mujoco>
"""
AT_LEISURE = ("--workers", "0", "--budget", "100h")


@pytest.fixture
def pendulum(tmp_path: Path) -> Path:
    """A pendulum whose steps are several times as short as they have to be."""
    path = tmp_path / "pendulum.xml"
    path.write_bytes(PENDULUM.encode())
    return path


def read(folder: Path) -> TuneReport:
    return TuneReport.model_validate_json((folder / "tune.json").read_text())


@pytest.mark.night
def test_a_model_becomes_one_that_moves_the_same_in_fewer_steps(
    contactlab: Run, pendulum: Path, tmp_path: Path
) -> None:
    asked = ("tune", pendulum.name, "--error", "1e-5", "-o", "out", *AT_LEISURE)
    code, out, err = contactlab(*asked)
    assert code == 0, err
    folder, report = tmp_path / "out", read(tmp_path / "out")
    (step,) = [each for each in report.changes if each.name == "timestep"]
    assert isinstance(step.after, float)
    assert step.after >= 8e-3
    assert report.proof is not None
    assert report.proof.holds
    assert report.proof.same_runs == len(report.proof.seeds) == 10
    assert report.proof.tuned.error_peak is not None
    assert report.proof.tuned.error_peak <= 1e-5
    assert report.file == "tuned/tuned.xml"
    text = (folder / report.file).read_text()
    assert "<!-- a comment stays -->" in text
    assert f"{report.lines[0].file}:{report.lines[0].line}: {report.lines[0].element}" in out
    assert contactlab("sweep", "out/proof.yaml", "--workers", "0").code == 0
    for name in report.stores:
        assert verify(folder / name) == []
    before = [(folder / name / "manifest.json").read_bytes() for name in report.stores]
    again = contactlab(*asked, "--format", "json")
    kept: Any = json.loads(again.out)
    assert kept["changes"] == report.model_dump(mode="json")["changes"]
    assert before == [(folder / name / "manifest.json").read_bytes() for name in report.stores]
    patch = contactlab(*asked, "--patch").out.encode()
    made = ["patch", "-p1", "--binary", pendulum.name]
    done = subprocess.run(made, input=patch, cwd=tmp_path, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert pendulum.read_bytes() == (folder / report.file).read_bytes() != PENDULUM.encode()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--error", "0"), "--error 0: write a length, such as 1e-3 or 1mm"),
        (("--error", "near"), "--error near: write a length, such as 1e-3"),
        (("--budget", "soon"), "--budget soon: write a time, such as 90s, 5min or 1h"),
        (("--budget", "1e-3s"), "--budget 0.001s is too short: 3 runs of the model"),
        (("--within", "penetration_mx=1"), "did you mean 'penetration_max'?"),
        (("--within", "slip"), "'--within slip' is no tolerance"),
        (("--free", "friction"), "--free: no 'friction'"),
        (("--drive", "push"), "push"),
    ],
)
def test_a_wrong_option_is_one_line(
    contactlab: Run, pendulum: Path, options: tuple[str, ...], words: str
) -> None:
    code, out, err = contactlab("tune", pendulum.name, "-o", "out", "--workers", "0", *options)
    assert (code, out) == (2, "")
    assert words in err.splitlines()[-1]


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("no model", 2, "not XML"),
        ("<mujoco/>", 2, "nothing in it moves"),
        # h w is 43, where any integrator of MuJoCo is unstable.
        (PENDULUM.replace('damping="0.05"', 'stiffness="1e9"'), 1, "as written ends as"),
    ],
    ids=["no model", "nothing to tune", "diverges"],
)
def test_a_model_that_cannot_be_tuned_is_one_line(
    contactlab: Run, tmp_path: Path, text: str, code: int, words: str
) -> None:
    (tmp_path / "model.xml").write_text(text)
    done = contactlab("tune", "model.xml", "-o", "out", *AT_LEISURE)
    assert (done.code, done.out) == (code, "")
    assert words in done.err.splitlines()[-1]


def test_a_folder_with_results_of_another_model_is_left_alone(
    contactlab: Run, pendulum: Path, tmp_path: Path
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "sources.json").write_text('{"tune": "/elsewhere/robot.xml"}')
    done = contactlab("tune", pendulum.name, "-o", "out", *AT_LEISURE)
    assert done.code == 2
    assert "has the results of /elsewhere/robot.xml" in done.err
    assert [each.name for each in (tmp_path / "out").iterdir()] == ["sources.json"]
