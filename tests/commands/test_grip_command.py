"""`contactlab grip` prints a verdict, writes data and films, and says by its code what it found."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.grip.grippers import claw, claw_with_bar

from contactlab.schema.grip import GripReport

Run = Callable[..., Any]


def test_it_prints_a_verdict_and_writes_data(contactlab: Run, tmp_path: Path) -> None:
    path, target = tmp_path / "claw.xml", tmp_path / "claw.json"
    path.write_text(claw(cone="elliptic", impratio="100"), encoding="utf-8")
    code, out, _ = contactlab("grip", str(path), "--object", "box:50x40x40mm", "-o", str(target))
    assert code == 0
    assert out.startswith("holds a box of 50x40x40 mm and 0.1 kg")
    assert "without a load" in out
    report = GripReport.model_validate_json(target.read_text(encoding="utf-8"))
    assert report.holds
    assert max(map(len, out.splitlines())) <= 80


@pytest.mark.parametrize("fixes", [False, pytest.param(True, marks=pytest.mark.long)])
def test_creep_ends_with_one_and_names_lines(
    contactlab: Run, tmp_path: Path, *, fixes: bool
) -> None:
    """Trials of fixes take seconds, and do not change the verdict or the exit code."""
    path = tmp_path / "bar.xml"
    path.write_text(claw_with_bar(8, 0.1), encoding="utf-8")
    words = () if fixes else ("--no-fixes",)
    code, out, err = contactlab("grip", str(path), "--keyframe", "held", "--format", "json", *words)
    report = json.loads(out)
    assert code == 1
    assert "body bar creeps" in err
    assert report["keyframe"] == "held"
    lines = [line for each in report["fixes"] for line in each["lines"]]
    assert any("bar.xml:" in line for line in lines) == fixes


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--film", "grip.avi"], "end its name in .mp4 or .gif"),
        (["--tolerance", "1mm"], "write a speed"),
        (["--keyframe", "held", "--squeeze", "3"], "would be ignored"),
    ],
)
def test_bad_input_is_told_before_anything_runs(
    contactlab: Run, tmp_path: Path, words: list[str], said: str
) -> None:
    path = tmp_path / "claw.xml"
    path.write_text(claw(), encoding="utf-8")
    code, _, err = contactlab("grip", str(path), *words)
    assert code == 2
    assert said in err


@pytest.mark.long
def test_a_film_is_written(contactlab: Run, tmp_path: Path) -> None:
    pytest.importorskip("av")
    path, target = tmp_path / "bar.xml", tmp_path / "bar.gif"
    path.write_text(claw_with_bar(8, 0.1), encoding="utf-8")
    _, _, err = contactlab(
        "grip", str(path), "--keyframe", "held", "--no-fixes", "--film", str(target)
    )
    if "no OpenGL" in err:
        pytest.skip("there is no OpenGL to draw with")
    assert target.read_bytes().startswith(b"GIF8")
