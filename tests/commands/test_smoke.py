"""Each command does its main job once, on a model of one ball or a store of two runs."""

import importlib
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer.main

from contactlab.command_line.main import command_line

BALL = """<mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="1 1 .1"/>
  <body name="ball" pos="0 0 .1"><freejoint/><geom name="ball" size=".1"/></body></worldbody>
</mujoco>
"""
SWEEP = "{version: 1, scene: ball_drop, duration: 0.05, axes: {timestep: [1.0e-3, 2.0e-3]}}"
# Of each command, or a part of it: what is asked of it, the exit code, and words that it prints.
SMOKES: dict[str, tuple[str, int, str]] = {
    "sweep": ("{folder}/two.yaml -o {folder}/again --workers 0", 0, "2 runs"),
    "sweep --merge": ("{store} -o {folder}/merged", 0, "4 runs"),
    "stability": ("free_fal", 2, "did you mean 'free_fall'?"),
    "effects": ("{folder}/none.xml", 2, "none.xml"),
    "examine --check task": (
        "{folder}/ball.xml --duration 0.2 --workers 0 -o {folder}/check.json",
        0,
        "numerical error",
    ),
    "examine": (
        "{folder}/ball.xml --section budget --drive none --duration 0.1 --workers 0",
        0,
        "ok: numerical error",
    ),
    "tradeoff": ("{store}", 1, "2 configurations"),
    "show": ("{store}", 0, "4 runs"),
    "verify STORE RUN": ("{store} {run}", 0, "equal"),
    "render": ("{store} {run} -o {folder}/run.pdf", 2, ".mcap"),
    "verify": ("{store}", 0, "sound"),
    "compare": ("{store} {folder}/copy", 0, "same"),
    "report": ("{store} -o {folder}/page.html", 0, "page.html"),
    "list": ("scenes", 0, "ball_drop"),
    "init": ("{folder}/ball.xml", 0, "wrote sweep.yaml"),
    "list schemas": ("sweep", 0, "$schema"),
    "explain": ("chatter", 0, "chatter"),
    "fit": ("ball_drop -o {folder}/fit", 2, "recording"),
    "bisect": ("{folder}/two.yaml --good 4.0.0 --bad 4.0.0", 2, "4.0.0"),
    # It asks a Python of its own, which takes a second to start; tests/lock has that.
    "lock": ("{folder}/two.yaml --check --file {folder}/two.lock", 2, "two.lock"),
    "parity": ("{folder}/two.yaml --against nobody", 2, "nobody"),
    "tune": ("{folder}/none.xml", 2, "none.xml"),
    "compare --update": ("{folder}/baseline {store}", 0, "baseline"),
    "lint": ("{folder}/ball.xml", 0, "nothing found"),
    "diff": ("{folder}/ball.xml {folder}/ball.xml", 0, "no difference"),
    "shrink": ("{store} {run}", 2, "not the model alone"),
    "gradients": ("{folder}/ball.xml --output-coordinate nothing", 2, "no such coordinate"),
    "grip": ("{folder}/ball.xml", 2, "no actuator"),
    "parity --install nobody": ("", 2, "nobody"),
    "success": ("{store}", 3, "no episode says how it ended"),
    "advisories": ("", 0, "CL-2026-0001"),
    "render STORE": ("{store} -o {folder}/messages", 0, "4 traces"),
}


Run = Callable[..., Any]


@pytest.fixture
def places(store: Path, tmp_path: Path) -> dict[str, str]:
    """A model, a sweep file, and a store with one of its runs."""
    (tmp_path / "ball.xml").write_text(BALL)
    (tmp_path / "two.yaml").write_text(SWEEP)
    shutil.copytree(tmp_path / store, tmp_path / "copy")
    run = next((tmp_path / store / "traces").rglob("*.mcap")).stem
    return {"folder": str(tmp_path), "store": str(tmp_path / store), "run": run}


@pytest.fixture(autouse=True)
def _undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no films and charts: their libraries take seconds to start, in tests of their own."""
    page_view: Any = importlib.import_module("contactlab.page.page_view")
    monkeypatch.setattr(page_view, "header_films", lambda *_, **_drawn: page_view.Films([]))
    monkeypatch.setattr(page_view, "focal_picture", lambda *_: None)
    monkeypatch.setattr(page_view, "vega_bundle", lambda *_: "")
    monkeypatch.setattr(page_view, "static_svg", lambda *_: "<svg/>")


def test_no_command_is_left_out() -> None:
    group: Any = typer.main.get_command(command_line())
    assert set(group.commands) == {name.split()[0] for name in SMOKES}


@pytest.mark.interface
@pytest.mark.parametrize("name", SMOKES)
def test_it_does_its_job(name: str, places: dict[str, str], contactlab: Run) -> None:
    arguments, code, words = SMOKES[name]
    words_of_name = [word for word in name.split() if not word.isupper()]
    result = contactlab(*words_of_name, *arguments.format(**places).split())
    assert result.code == code, result
    assert words in result.out + result.err, result
