"""`contactlab effects` from the command line."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from contactlab.command_line.main import command_line
from contactlab.schema.study_reports import EffectsReport
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

SLIDE = "version: 1\nscene: box_slide\nduration: 0.2\ntolerances: {drift: 0.01}\n"


def run(*args: str) -> Any:
    return CliRunner().invoke(command_line(), ["effects", *args, "--workers", "0"])


@pytest.mark.long
def test_report_figure_and_evidence(tmp_path: Path) -> None:
    sweep, figure = tmp_path / "s.yaml", tmp_path / "bars.png"
    sweep.write_text(SLIDE)
    out = tmp_path / "out"
    done = run(str(sweep), "--seeds", "1", "-o", str(out), "--figure", str(figure))
    assert done.exit_code == 0, done.output
    assert "smallest set: " in done.output
    assert "holds in 10 fresh runs" in done.output
    assert "effects: {base: auto" in done.output
    assert figure.read_bytes().startswith(b"\x89PNG")
    report = EffectsReport.model_validate_json((out / "effects.json").read_text())
    assert {"effects", "smallest_set", "time_ratio"} <= json.loads(
        (out / "effects.json").read_text()
    ).keys()
    assert all(each.time_ratio is not None for each in report.effects if each.verdict != "unused")
    assert report.time_ratio is not None
    for name in report.stores:
        assert find_problems(out / name) == []
    assert Store.open(out / "one-by-one").manifest.sweep.resolved["effects"] == {"base": "all"}


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
