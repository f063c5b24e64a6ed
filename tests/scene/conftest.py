"""Scenes written for a test, and models compared number by number."""

from collections.abc import Callable, Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.scene.scene import Scene

MakeScene = Callable[..., Scene]
HEAD = "version: 1\ntitle: t\ndescription: d\nduration: 0.1\n"

# Unequal geoms of different priorities, one explicit pair, and a bystander that is not monitored;
# all overlap a little at the start.
UNEQUAL = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1" friction="0.8 0.01 0.001" solref="0.03 0.8"/>
    <body name="low" pos="0 0 .049">
      <freejoint name="low"/>
      <geom name="low" type="box" size=".05 .05 .05" mass="1" friction="0.3 0.02 0.002"
            solref="-4000 -90" solimp="0.8 0.9 0.002" condim="4" priority="2" margin="0.002"/>
    </body>
    <body name="top" pos="0 0 .148">
      <freejoint name="top"/>
      <geom name="top" size=".05" mass="2" solmix="3" condim="6" gap="0.001"/>
    </body>
    <body name="side" pos="1 0 .049">
      <freejoint name="side"/><geom name="side" size=".05" friction="0.1 0.1 0.1"/>
    </body>
    <body name="bystander" pos="-1 0 .049">
      <freejoint name="bystander"/>
      <geom name="bystander" size=".05" friction="0.2 0.3 0.4" solref="0.05 1.5" margin="0.003"/>
    </body>
  </worldbody>
  <contact>
    <pair name="rub" geom1="floor" geom2="side" friction="0.4 0.5 0.01 0.002 0.003" condim="6"
          solref="-900 -20" margin="0.001"/>
  </contact>
</mujoco>
"""
MONITORED = (
    "pairs: [{geoms: [floor, low]}, {geoms: [low, top]}, {geoms: [floor, side]}]\nsubject: low\n"
)


@pytest.fixture(scope="session")
def make_scene(tmp_path_factory: pytest.TempPathFactory) -> MakeScene:
    """Return a maker of scenes from MJCF text, manifest lines and other files by name."""

    def make(
        model: str, manifest: str | None = None, files: Mapping[str, str] | None = None
    ) -> Scene:
        folder = tmp_path_factory.mktemp("scene")
        for name, text in {"scene.xml": model, **(files or {})}.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        if manifest is None:
            return Scene.open(str(folder / "scene.xml"))
        (folder / "scene.yaml").write_text(HEAD + manifest)
        return Scene.open(str(folder))

    return make


@pytest.fixture(scope="session")
def unequal(make_scene: MakeScene) -> Scene:
    """Return the scene of unequal geoms."""
    return make_scene(UNEQUAL, MONITORED)


def _numbers(thing: object) -> dict[str, np.ndarray]:
    names = [name for name in dir(thing) if not name.startswith("_")]
    found = {name: getattr(thing, name, None) for name in names}
    return {
        name: np.array(value)
        for name, value in found.items()
        if isinstance(value, (int, float, np.ndarray)) and np.asarray(value).dtype.kind in "biuf"
    }


def _reach(value: np.ndarray, rel: float) -> float:
    """Return the rounding of zeros that came of a sum of an array's numbers."""
    return rel * float(np.abs(value[np.isfinite(value)]).max(initial=0.0)) if rel else 0.0


@pytest.fixture(scope="session")
def numbers_of() -> Callable[[mujoco.MjModel], dict[str, np.ndarray]]:
    """Return a reader of every number of a model, its options included, by name."""

    def read(model: mujoco.MjModel) -> dict[str, np.ndarray]:
        options = {f"opt.{name}": value for name, value in _numbers(model.opt).items()}
        return _numbers(model) | options

    return read


@pytest.fixture(scope="session")
def differing(
    numbers_of: Callable[[mujoco.MjModel], dict[str, np.ndarray]],
) -> Callable[..., set[str]]:
    """Return a comparison that names what two models differ in."""

    def compare(one: mujoco.MjModel, two: mujoco.MjModel, rel: float = 0.0) -> set[str]:
        first, second = numbers_of(one), numbers_of(two)
        assert first.keys() == second.keys()
        return {
            name
            for name, value in first.items()
            if value.shape != second[name].shape
            or not np.allclose(
                value, second[name], rtol=rel, atol=_reach(value, rel), equal_nan=True
            )
        }

    return compare


@pytest.fixture(scope="session")
def write_files() -> Callable[[Path, Mapping[str, str]], None]:
    """Return a writer of files by name below a folder."""

    def write(folder: Path, files: Mapping[str, str]) -> None:
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)

    return write
