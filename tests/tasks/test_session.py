"""Sweeps that studies make up: what is stored already is not run again."""

from pathlib import Path

import pytest

from contactlab.run.sweep_request import SceneLoader
from contactlab.tasks.session import Session

pytestmark = pytest.mark.long


def test_the_same_sweep_is_run_once_and_another_one_replaces_it(tmp_path: Path) -> None:
    """A study that is interrupted and run again goes on where it stopped."""
    finished: list[str] = []
    session = Session(tmp_path, progress=lambda runs: finished.extend(each.label for each in runs))
    scenes = SceneLoader(Path())

    def run(drop_height: float) -> str:
        axes = {"drop_height": [drop_height]}
        sweep = {"version": 1, "scene": "ball_drop", "duration": 0.1, "axes": axes}
        return session.run_derived("drop", sweep, scenes, resume=True).digest

    first = run(0.5)
    assert run(0.5) == first
    assert len(finished) == 1
    assert run(0.6) != first
    assert len(finished) == 2
    assert run(0.5) != first, "the store of another sweep was replaced"
