"""`contactlab effects` from the command line."""

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from contactlab.command_line.main import command_line
from contactlab.schema.effects_report import EffectsReport

SLIDE = (
    "version: 1\nscene: box_slide\nduration: 0.2\n"
    "axes: {direction: {values: [0, 45], role: scenario}}\n"
)


def run(*args: str) -> Any:
    return CliRunner().invoke(command_line(), ["effects", *args, "--workers", "0"])


@pytest.mark.long
def test_a_sweep_is_taken_apart_in_its_scenarios(tmp_path: Path) -> None:
    sweep, figure = tmp_path / "s.yaml", tmp_path / "bars.png"
    sweep.write_text(SLIDE)
    out = tmp_path / "out"
    done = run(str(sweep), "-o", str(out), "--max-cpu", "60s", "--figure", str(figure))
    assert done.exit_code == 0, done.output
    assert figure.read_bytes().startswith(b"\x89PNG")
    report = EffectsReport.model_validate_json((out / "effects.json").read_text())
    assert report.scenarios == 2
    found = {each.name: each for each in report.effects}
    # The box slides until friction stops it.
    assert found["tangential_friction"].verdict == "needed"
    assert not found["tangential_friction"].can_go
    # A time within noise is printed as the same, and has its place.
    times = [each.time_ratio for each in report.effects if each.time_ratio]
    ratios = [1.0 if time.low <= 1 <= time.high else time.ratio for time in times]
    assert report.sentence in " ".join(done.output.split())
    assert ratios == sorted(ratios)


def test_mistakes_are_named(tmp_path: Path) -> None:
    cases = {
        ("ball_drp",): "ball_drop",
        ("ball_drop", "--set", "condim=1,3"): "one value",
        ("ball_drop", "--set", "seeds=3"): "axes of the scene",
        ("ball_drop", "--figure", str(tmp_path / "x.bmp")): ".png or .svg",
    }
    for args, words in cases.items():
        done = run(*args)
        assert done.exit_code != 0
        assert words in str(done.exception)
