"""An examination opens its model, infers its task and resolves its runs once."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.plan.task_options import read_task_options
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import write_model
from contactlab.scene.scene import Scene
from contactlab.schema.examination import SectionName
from contactlab.studies.examine.examination import ExamineRequest, examine_model
from contactlab.tasks.session import Session

MODEL = """
<mujoco><option timestep="0.005"/><worldbody><geom type="plane" size="1 1 .1"/>
<body pos="0 0 .0999"><freejoint/><geom type="sphere" size=".1"/></body></worldbody></mujoco>
"""
# Two of the scene, without and with recording sensors, and one with the lines of files, for lint.
MOST_COMPILED = 3
# Three as the scene is opened, three as its store's copy is, then one each for the task, the first
# run, the motions of all seeds, the stored runs of all seeds, and the poses of a fallen start.
MOST_RESOLVED = 11


def count_calls(patch: pytest.MonkeyPatch, counts: Counter[str], owner: type, name: str) -> None:
    """Count the calls of a method."""
    method: Callable[..., Any] = getattr(owner, name)

    def counted(*words: Any, **named: Any) -> Any:
        counts[name] += 1
        return method(*words, **named)

    patch.setattr(owner, name, counted)


def test_a_model_is_compiled_and_its_runs_are_resolved_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "ball.xml"
    path.write_text(MODEL)
    counts = Counter[str]()
    count_calls(monkeypatch, counts, mujoco.MjSpec, "compile")
    count_calls(monkeypatch, counts, Scene, "resolve")
    sections: tuple[SectionName, ...] = ("labels", "budget", "facts", "contacts", "fixes")
    request = ExamineRequest(
        str(path), task=read_task_options(drive="none", duration="0.1s"), sections=sections
    )
    report = examine_model(request, Session(tmp_path / "results"))
    assert report.budget is not None
    assert report.task_verdict is not None
    assert 0 < counts["compile"] <= MOST_COMPILED
    assert 0 < counts["resolve"] <= MOST_RESOLVED


def test_the_count_sees_a_second_opening(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "ball.xml"
    path.write_text(MODEL)
    counts = Counter[str]()
    count_calls(monkeypatch, counts, mujoco.MjSpec, "compile")
    scenes = [Scene.open(str(path)) for _ in range(2)]
    assert counts["compile"] == 2 * len(scenes)


def test_a_written_model_is_compiled_once_more_to_be_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only recording sensors are added to the model that its writer compiled."""
    path = tmp_path / "ball.xml"
    path.write_text(MODEL)
    written = write_model(
        Scene.open(str(path)), ModelEdits({"cone": "elliptic"}), tmp_path / "changed"
    )
    reference = written.reference
    counts = Counter[str]()
    count_calls(monkeypatch, counts, mujoco.MjSpec, "compile")
    shared = Scene.open(reference).base({})
    assert counts["compile"] == 1
    del written
    alone = Scene.open(reference).base({})
    assert counts["compile"] == 3
    assert model_bytes(shared.model) == model_bytes(alone.model)
    assert shared.pairs == alone.pairs
    assert shared.settings == alone.settings


def model_bytes(model: mujoco.MjModel) -> bytes:
    """Return a model as MuJoCo saves it."""
    saved = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, saved)
    return saved.tobytes()
