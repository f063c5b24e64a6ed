"""Plug-ins in one file each, loaded in this process and forgotten after the test."""

import shutil
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from contactlab import plugins
from contactlab.registry import transaction
from contactlab.resources import scene_folder

SOURCES = Path(__file__).parent / "springs/src/contactlab_springs"
SWEEP = """\
version: 1
scene: ./ball
duration: 0.02
axes:
  timestep: [1.0e-3, 2.0e-3]
  engine: [mujoco, frozen]
"""


class _ForgetError(Exception):
    """Takes back what a test added."""


@pytest.fixture
def forgotten(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Forget plug-ins at the end of a test."""
    monkeypatch.setattr(plugins, "_loaded", {})
    modules = set(sys.modules)
    with suppress(_ForgetError), transaction():
        yield
        raise _ForgetError
    for name in set(sys.modules) - modules:
        if name.startswith("contactlab_plugin_"):
            del sys.modules[name]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a sweep of a scene that names a plug-in's oracle, and the plug-in's files."""
    shutil.copytree(scene_folder("ball_drop"), tmp_path / "ball")
    manifest = tmp_path / "ball/scene.yaml"
    before = manifest.read_text()
    manifest.write_text(before.replace("name: restitution", "name: starting_height"))
    assert manifest.read_text() != before
    (tmp_path / "small.yaml").write_text(SWEEP)
    shutil.copy(SOURCES / "hover.py", tmp_path)
    engine = (SOURCES / "frozen_engine.py").read_text()
    own = "\nfrom contactlab.engines import ENGINES\n\nENGINES.add(FrozenEngine())\n"
    (tmp_path / "frozen_engine.py").write_text(engine + own)
    return tmp_path
