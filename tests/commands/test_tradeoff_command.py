"""`contactlab tradeoff`: what it runs, prints and writes, and what it ends in."""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import mujoco
import pytest

from contactlab import resources
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep

Run = Callable[..., Any]
SWEEP = """
version: 1
scene: double_pendulum
duration: 0.3
axes:
  timestep: [1.0e-3, 2.0e-3, 4.0e-3]
  integrator: [Euler, RK4]
tolerances: {oracle_error: 0.1%}
trace: none
"""


@pytest.fixture
def swing(tmp_path: Path) -> Path:
    """A sweep file of 6 runs."""
    path = tmp_path / "swing.yaml"
    path.write_text(SWEEP)
    return path


@pytest.fixture(scope="module")
def _swung(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of these runs that nobody may change."""
    folder = tmp_path_factory.mktemp("swung")
    request = read_request(SWEEP, "swing", folder / "swung", folder=folder, workers=0)
    run_sweep(request, lambda *_: None, lambda _runs: None)
    return folder / "swung"


@pytest.fixture
def swung(_swung: Path, tmp_path: Path) -> str:
    """A copy of the store, named as commands in `tmp_path` name it."""
    shutil.copytree(_swung, tmp_path / "swung")
    return "swung"


@pytest.mark.long
def test_a_sweep_is_run_timed_and_weighed(contactlab: Run, swing: Path, tmp_path: Path) -> None:
    code, out, err = contactlab("tradeoff", swing.name, "--workers", "0")
    assert code == 0, err
    assert "6 configurations of double_pendulum" in out
    assert "from a timing pass" in " ".join(out.split())
    assert re.search(r'\n  scene\.xml:\d+: <option [^>]*timestep="', out)
    store = tmp_path / "results/tradeoff/swing"
    assert (store / "manifest.json").is_file()
    again = contactlab("tradeoff", str(store))
    assert again.code == 0
    same, _, _ = again.out.replace(str(store), "results/tradeoff/swing").partition(
        "\nwrite the model"
    )
    head, subject, rest = out.partition("swing: 6 configurations")
    assert head.startswith("qpos0, 0.3 s without controls; 1 seed; observed: all bodies")
    assert "\nas written: numerics ok" in head
    # Lines wrap elsewhere, since the path of the store has another length.
    words = same.split()
    assert (subject + rest).split()[: len(words)] == words


def test_a_store_is_weighed_as_json(contactlab: Run, swung: str) -> None:
    code, out, err = contactlab("tradeoff", swung, "--format", "json")
    assert (code, err) == (0, "")
    data = json.loads(out)
    schema = json.loads((resources.SCHEMAS / "tradeoff.schema.json").read_text())
    jsonschema.Draft202012Validator(schema).validate(data)
    assert set(data["recommendation"]["configuration"]) == {"timestep", "integrator"}
    assert set(data["recommendation"]["margins"]) == {"oracle_error"}
    assert data["front"]


def test_what_a_store_recommends_is_written_into_its_model(
    contactlab: Run, swung: str, tmp_path: Path
) -> None:
    code, out, _ = contactlab("tradeoff", swung)
    assert code == 0
    assert "write the model: contactlab tradeoff swung --model FOLDER" in out
    code, out, err = contactlab("tradeoff", swung, "--model", "model", "--format", "json")
    assert (code, err) == (0, "")
    chosen = json.loads(out)["recommendation"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model" / "scene.xml"))
    assert model.opt.timestep == chosen["configuration"]["timestep"]
    # Measured times choose: where they choose the scene as it is written, no line changes.
    written = (tmp_path / "model" / "scene.xml").read_text()
    assert all(line.split(": ", 1)[1] in written for line in chosen["mjcf"])


def test_no_folder_with_files_is_written_into(contactlab: Run, swung: str, tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text("the user's own")
    for place in (".", "scene.xml"):
        code, _, err = contactlab("tradeoff", swung, "--model", place)
        assert code == 2
        assert err == f"error: {place} is not an empty folder; choose another one with --model\n"
    assert (tmp_path / "scene.xml").read_text() == "the user's own"


def test_a_tolerance_that_nothing_meets_ends_in_1(contactlab: Run, swung: str) -> None:
    code, out, err = contactlab("tradeoff", swung, "--tolerance", "steps=1%")
    assert code == 1
    assert "no configuration of mujoco is feasible" in out or "no configuration is feasible" in out
    assert err == (
        "error: none of 6 configurations is feasible: tolerance steps rules out 6 configurations; "
        "the best has 75\n"
    )


def test_the_recommendation_is_written_and_met_again(
    contactlab: Run, swung: str, tmp_path: Path
) -> None:
    code, _, err = contactlab("tradeoff", swung, "--write", "recommended.yaml")
    assert code == 0
    assert err.endswith("next: contactlab sweep recommended.yaml\n")
    code, out, err = contactlab("sweep", "recommended.yaml", "--workers", "0")
    assert code == 0, err
    assert "10 of 10 runs are as expected" in out
    assert (tmp_path / "recommended.yaml").is_file()
    again = contactlab("tradeoff", swung, "--write", "recommended.yaml")
    assert again.code == 2
    assert again.err == "error: recommended.yaml exists; choose another file with --write\n"


@pytest.mark.long
def test_a_figure_is_drawn(contactlab: Run, swung: str, tmp_path: Path) -> None:
    code, _, err = contactlab("tradeoff", swung, "--figure", "chart.svg")
    assert (code, err) == (0, "drew chart.svg\n")
    assert (tmp_path / "chart.svg").read_text().startswith("<svg")


MISTAKES = [
    (["swung", "--metric", "oracle_eror"], 2, "error: no number 'oracle_eror' in the table of swu"),
    (["swung", "--metric", "error_peak"], 3, "error: no run in swung has a value of error_peak; "),
    (["swung", "--tolerance", "depth=1"], 2, "error: no number 'depth' in the table of swung"),
    (
        ["swung", "--tolerance", "oracle_error"],
        2,
        "error: '--tolerance oracle_error' is not a tolerance; write",
    ),
    (
        ["swung", "--tolerance", "oracle_error=-1"],
        2,
        "error: '--tolerance oracle_error=-1' is not a tolerance",
    ),
    (
        ["swung", "--tolerance", "oracle_error=nan"],
        2,
        "error: '--tolerance oracle_error=nan' is not a tolerance",
    ),
    (["swung", "--figure", "chart.bmp"], 2, "error: chart.bmp: write a name that ends in .png or"),
    (["swung", "--figure", "no/chart.png"], 2, "error: cannot write no/chart.png: no folder no"),
    (["swung", "--write", "no/again.yaml"], 2, "error: cannot write no/again.yaml: no folder no"),
    (["swung", "-o", "elsewhere"], 2, "error: swung is a folder; -o is the store of a sweep"),
    (["nowhere"], 2, "error: no sweep file and no shipped sweep named 'nowhere'"),
    (["nowhere.yaml"], 2, "error: no sweep file nowhere.yaml"),
    (["."], 3, "error: . is not a store: it has no manifest.json"),
]


@pytest.mark.parametrize(
    ("arguments", "code", "message"), MISTAKES, ids=lambda each: str(each)[:40]
)
def test_bad_input(
    contactlab: Run, swung: str, tmp_path: Path, arguments: list[str], code: int, message: str
) -> None:
    assert (tmp_path / swung).is_dir()
    before = sorted(tmp_path.iterdir())
    found = contactlab("tradeoff", *arguments)
    assert found.code == code
    assert found.err.startswith(message)
    assert "Traceback" not in found.err
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.long
def test_a_store_is_weighed_and_drawn_without_the_engine(swung: str, tmp_path: Path) -> None:
    command = """
import sys
from contactlab.__main__ import main
sys.argv = ["contactlab", "tradeoff", *sys.argv[1:]]
try:
    main()
finally:
    assert "mujoco" not in sys.modules
    assert "scipy" not in sys.modules
"""
    arguments = [swung, "--figure", "chart.svg"]
    done = subprocess.run(
        [sys.executable, "-c", command, *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


STIFF = """<mujoco>
  <worldbody><body><joint name="slide" type="slide" axis="0 0 1" stiffness="1e8" springref="1"/>
    <geom size=".05" mass="1"/></body></worldbody>
</mujoco>"""


@pytest.mark.parametrize("output", ["text", "json"])
def test_a_model_that_diverges_gets_a_verdict(contactlab: Run, tmp_path: Path, output: str) -> None:
    """A spring of 10^4 rad/s is unstable above h = 2e-4 s: no run ends, and none has an error."""
    (tmp_path / "stiff.xml").write_text(STIFF)
    (tmp_path / "stiff.yaml").write_text(
        "version: 1\nscene: stiff.xml\nduration: 0.5\ndrive: none\n"
        "axes: {timestep: [1.0e-3, 2.0e-3]}\n"
    )
    code, out, err = contactlab("tradeoff", "stiff.yaml", "--workers", "0", "--format", output)
    assert code == 1
    assert "none of 2 configurations is feasible: label diverged" in err
    if output == "json":
        data = json.loads(out)
        assert data["recommendation"] is None
        assert {each["error"] for each in data["configurations"]} == {None}
        assert data["insensitive_knobs"] == []
