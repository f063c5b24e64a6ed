"""The example: two grasps that succeed, of which one is real."""

import runpy
from pathlib import Path

import pytest
from typer.testing import CliRunner

import contactlab
from contactlab.command_line.main import command_line

EXAMPLE = Path(__file__).parents[2] / "examples" / "recorded_grasp.py"


def test_success_by_sinking_in_is_caught(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    assert "exploited" in capsys.readouterr().out
    stores = [contactlab.open(f"results/grasp_{pads}") for pads in ("solid", "soft")]
    records = [next(iter(store.records())) for store in stores]
    assert [each.success for each in records] == [True, True]
    assert [each.label for each in records] == ["stable", "exploited"]

    # One table has the question's answer, and nothing offers to run the loop again.
    table = CliRunner().invoke(command_line(), ["show", "results/grasp_soft"]).stdout
    assert all(
        each in table for each in ("success", "hold depth [m]", "hold slip [m]", "exploited")
    )
    run = (
        CliRunner().invoke(command_line(), ["show", "results/grasp_soft", records[1].run_id]).stdout
    )
    assert "episode 0, success" in run
    assert "contactlab verify" not in run
