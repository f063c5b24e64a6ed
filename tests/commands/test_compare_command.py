"""`compare`, with and without `--update`, on stores of real sweeps."""

import json
import shutil
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactlab.judge.waivers import add_waivers, waivers_for
from contactlab.resources import scene_folder
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.schema.comparison import ComparisonReport
from contactlab.store.finished_store import Store

Run = Callable[..., Any]
SLIDE = """\
version: 1
scene: SCENE
duration: 0.6
trace: none
axes:
  direction: {values: [0.0, 45.0], role: scenario}
  cone: [elliptic, pyramidal]
"""
THROWN_MODEL = """\
<mujoco model="thrown">
  <option timestep="0.004" cone="elliptic"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <body name="box" pos="0 0 0.1">
      <freejoint name="box"/>
      <geom name="box" type="box" size="0.1 0.06 0.04" mass="1" solref="0.02 0.05"/>
    </body>
  </worldbody>
</mujoco>
"""
THROWN = """\
version: 1
title: A box thrown onto the floor
description: Where it comes to rest depends on the last digits of how it is thrown.
duration: 3.0
subject: box
pairs:
  - {geoms: [floor, box], slots: 8}
initial:
  spin:
    default: 21.0
    unit: rad/s
    description: angular velocity
    sets: {box.wx: spin, box.wz: "0.3 * spin", box.z: "1.0", box.vx: "1.0"}
perturb: {coordinates: [box.wx, box.wz, box.z], scale: 1.0e-5}
"""
THROWS = """\
version: 1
scene: thrown
seeds: 40
knife_edge: true
trace: none
checks: none
thresholds: {drift: LIMIT}
axes: {spin: [SPIN]}
"""


def swept(folder: Path, name: str, text: str) -> Path:
    """Write a store of a sweep beside a folder's scenes."""
    ask = read_request(text, "tried", folder / name, folder=folder, workers=0)
    run_sweep(ask, lambda *_: None, lambda _finished: None)
    return folder / name


def changed_scene(folder: Path, old: str, new: str) -> str:
    """Copy a shipped scene, change its model and return the sweep of it."""
    scene = folder / "changed" / "box_slide"
    shutil.copytree(scene_folder("box_slide"), scene)
    model = scene / "scene.xml"
    text = model.read_text()
    assert old in text
    model.write_text(text.replace(old, new))
    return SLIDE.replace("SCENE", "changed/box_slide")


@pytest.fixture(autouse=True)
def _not_in_a_github_job(monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction]
    for name in ("GITHUB_ACTIONS", "GITHUB_STEP_SUMMARY"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture(scope="module")
def slides(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Stores of one sweep, of the same one again, and of two that were tampered with."""
    folder = tmp_path_factory.mktemp("slides")
    stores = {name: swept(folder, name, SLIDE.replace("SCENE", "box_slide")) for name in "ab"}
    for name, old, new in (
        ("friction", 'friction="0.5 ', 'friction="0.525 '),
        ("margin", "<geom condim", '<geom margin="0.001" condim'),
    ):
        part = tmp_path_factory.mktemp(name)
        stores[name] = swept(part, name, changed_scene(part, old, new))
    return stores


@pytest.mark.long
def test_the_same_sweep_twice(contactlab: Run, slides: dict[str, Path]) -> None:
    code, out, err = contactlab("compare", str(slides["a"]), str(slides["b"]))
    assert (code, err) == (0, "")
    assert out.startswith("same: no check of ")
    assert "4 paired by id, all bitwise equal" in out


@pytest.mark.long
@pytest.mark.parametrize("name", ["friction", "margin"])
def test_a_changed_scene_is_compared_by_axes_and_named_first(
    contactlab: Run, slides: dict[str, Path], name: str
) -> None:
    stores = str(slides["a"]), str(slides[name])
    code, out, err = contactlab("compare", *stores, "--match", "id")
    assert (code, out) == (3, "")
    assert "the scene changed (" in err
    assert err.endswith("add --match axes\n")
    code, out, _ = contactlab("compare", *stores)
    assert code in (0, 1)
    assert "paired by axes" in out
    [changed] = [line for line in out.splitlines() if line.startswith("changed ")]
    assert name in changed
    assert " -> " in changed
    assert out.index(changed) < out.index("\nbaseline ")


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "line"),
    [
        # v^2 / (2 mu g) in half of mu: 1 / 1.05 of the way.
        ("friction", "oracle_expected unchanged"),
        # Boxes are carried a millimetre higher up.
        ("margin", "distance_min"),
    ],
)
def test_a_changed_scene_by_axes(
    contactlab: Run,
    slides: dict[str, Path],
    name: str,
    line: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "200")  # cells of tables wrap between words
    arguments = ["compare", str(slides["a"]), str(slides[name]), "--match", "axes"]
    code, out, err = contactlab(*arguments)
    assert code == 1
    assert "4 paired by axes, 0 bitwise equal" in out
    assert line in out
    assert "WARN  same scene_hash" in out
    assert err == f"error: {out.splitlines()[0]}\n"


@pytest.mark.night
def test_a_millionth_of_a_millionth(tmp_path: Path, contactlab: Run) -> None:
    """The throw is chaotic enough that a start 1e-6 away turns some label, 1e-12 none.

    A nudge of 1e-6 moves the resting place by about 1e-6 of where seeds 1e-5 apart spread it; the
    threshold lies in the middle, so that about one run in twenty is on the edge.
    """
    (tmp_path / "thrown").mkdir()
    (tmp_path / "thrown" / "scene.xml").write_text(THROWN_MODEL)
    (tmp_path / "thrown" / "scene.yaml").write_text(THROWN)
    plain = THROWS.replace("SPIN", "21.0").replace("knife_edge: true", "knife_edge: false")
    first = swept(tmp_path, "first", plain.replace("LIMIT", "1.0"))
    middle = float(np.median(Store.open(first).columns.numbers("drift").values))
    sweep = THROWS.replace("LIMIT", repr(middle))
    one = swept(tmp_path, "one", sweep.replace("SPIN", "21.0"))
    two = swept(tmp_path, "two", sweep.replace("SPIN", repr(21 * (1 + 1e-12))))
    code, out, _ = contactlab("compare", "one", "two", "--match", "axes", "--format", "json")
    report = json.loads(out)
    assert (code, report["pairs"]["paired"], report["pairs"]["bitwise_equal"]) == (0, 40, 0)
    flags = [Store.open(path).columns.numbers("knife_edge").values == 1 for path in (one, two)]
    assert report["pairs"]["knife_edge"] == (flags[0] | flags[1]).sum() >= 1


@pytest.mark.long
def test_a_baseline_is_small_sound_and_comparable(
    contactlab: Run, slides: dict[str, Path], tmp_path: Path
) -> None:
    code, out, err = contactlab("compare", "kept", str(slides["a"]), "--update")
    assert (code, err) == (0, "")
    said = " ".join(out.split())
    assert said.startswith(f"kept holds the 4 runs of {slides['a']} without traces: ")
    files = [path for path in (tmp_path / "kept").rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 100_000
    assert contactlab("verify", "kept")[0] == 0
    assert contactlab("compare", "kept", str(slides["b"]))[0] == 0
    assert contactlab("compare", "kept", str(slides["b"]), "--update")[0] == 0
    run = Store.open(tmp_path / "kept").table["run_id"][0].as_py()
    assert contactlab("verify", "kept", run)[0] == 0


def test_a_baseline_is_no_store_with_traces(contactlab: Run, store: Path) -> None:
    shutil.copytree(store, "other")
    code, _, err = contactlab("compare", "other", str(store), "--update")
    assert code == 2
    assert err == "error: other is not a baseline, so it is not replaced; name another folder\n"


@pytest.mark.long
def test_files_are_written_by_their_endings(
    contactlab: Run, slides: dict[str, Path], tmp_path: Path
) -> None:
    names = ("out/a.md", "out/a.json", "out/a.xml", "out/a.txt")
    options = [part for name in names for part in ("-o", name)]
    code, out, _ = contactlab("compare", str(slides["a"]), str(slides["b"]), *options)
    assert code == 0
    # The file has another width than the terminal.
    assert (tmp_path / "out/a.txt").read_text().split() == out.split()
    assert (tmp_path / "out/a.md").read_text().startswith("### ✅ same")
    assert json.loads((tmp_path / "out/a.json").read_text())["exit_code"] == 0
    assert "<testsuites>" in (tmp_path / "out/a.xml").read_text()
    code, _, err = contactlab("compare", str(slides["a"]), str(slides["b"]), "-o", "a.html")
    assert code == 2
    assert "a.html: write a name that ends in .txt, .json, .md, .xml" in err


@pytest.mark.long
@pytest.mark.parametrize("view", ["json", "markdown", "junit", "github"])
def test_every_view_is_printed(contactlab: Run, slides: dict[str, Path], view: str) -> None:
    code, out, _ = contactlab("compare", str(slides["a"]), str(slides["b"]), "--format", view)
    starts = {"json": "{", "markdown": "###", "junit": "<?xml", "github": ""}
    assert code == 0
    assert out.startswith(starts[view])


@pytest.mark.long
def test_in_a_github_job(
    contactlab: Run, slides: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    summary = tmp_path / "summary.md"
    summary.write_text("before\n")
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    arguments = [str(slides["a"]), str(slides["friction"]), "--match", "axes"]
    code, out, err = contactlab("compare", *arguments)
    assert code == 1
    assert "::" not in out
    annotations = [line for line in err.splitlines() if line.startswith("::error title=")]
    assert 1 <= len(annotations) <= 10
    assert summary.read_text().startswith("before\n### ❌ ")
    code, _, err = contactlab("compare", "nowhere", str(slides["a"]))
    sentence = "the baseline cannot be read: no store at nowhere"
    assert f"### ❌ not comparable: {sentence}" in summary.read_text()
    told = f"stores can be compared: {sentence}; `contactlab sweep` writes one"
    assert (code, err.splitlines()[0]) == (3, f"::error title=contactlab compare::{told}")


def test_a_missing_trace(contactlab: Run, store: Path) -> None:
    shutil.copytree(store, "candidate")
    trace = min(Path("candidate").rglob("*.mcap"))
    trace.unlink()
    code, _, err = contactlab("compare", str(store), "candidate")
    assert code == 3
    name = trace.relative_to("candidate")
    assert err.startswith(f"error: the candidate candidate is not sound: {name}: missing")


@pytest.mark.parametrize("asked", [[], ["--thorough"]])
def test_a_changed_byte_of_a_trace_is_found(contactlab: Run, store: Path, asked: list[str]) -> None:
    shutil.copytree(store, "candidate")
    trace = min(Path("candidate").rglob("*.mcap"))
    data = bytearray(trace.read_bytes())
    data[len(data) // 2] ^= 1
    trace.write_bytes(data)
    code, _, err = contactlab("compare", str(store), "candidate", *asked)
    assert code == 3
    assert "changed since it was written" in err


@pytest.mark.long
def test_waiving_a_change(
    contactlab: Run, slides: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    policy = tmp_path / "policy.yaml"
    arguments = ["compare", str(slides["a"]), str(slides["friction"]), "--match", "axes"]
    report = ComparisonReport.model_validate_json(contactlab(*arguments, "--format", "json")[1])
    first, *others, last = dict.fromkeys(
        check.name for check in report.findings if check.outcome == "failed"
    )
    rest = ["--policy", "policy.yaml", "--reason", "stiffer floor", "--until", "2999-01-31"]
    code, out, _ = contactlab(*arguments, *rest, "--waive", first)
    assert (code, "waived: stiffer floor" in out) == (1, True)
    until = date(2999, 1, 31)
    for name in others:
        add_waivers(policy, waivers_for(report.findings, name, "stiffer floor", until))
    code, out, _ = contactlab(*arguments, *rest, "--waive", last)
    assert code == 0
    assert "waived: stiffer floor" in out
    assert policy.read_text().count("until: 2999-01-31") == len(others) + 2
    assert contactlab(*arguments, "--policy", "policy.yaml")[0] == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--waive", "x"], "name it with --policy FILE"),
        (["--policy", "none.yaml"], "no file none.yaml"),
        (["--policy", "p.yaml", "--waive", "x", "--reason", "y"], "there is no check 'x'"),
    ],
)
def test_options_that_say_too_little(
    contactlab: Run, slides: dict[str, Path], options: list[str], message: str
) -> None:
    code, out, err = contactlab("compare", str(slides["a"]), str(slides["b"]), *options)
    assert (code, out) == (2, "")
    assert message in err
