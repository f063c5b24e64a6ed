"""Coordinates of the start are axes of every model: set by name, raised by `drop_height`."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.scene import Scene

MODEL = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="trunk" pos="0 0 1">
      <freejoint/>
      <geom size=".1"/>
      <body name="leg" pos="0 0 -.2">
        <joint name="knee" axis="0 1 0"/>
        <geom size=".05"/>
      </body>
    </body>
    <body name="cart" pos="2 0 1">
      <joint name="rail" type="slide" axis="1 0 0"/>
      <geom size=".1"/>
      <body name="bob" pos="0 0 .3"><joint name="swivel" type="ball"/><geom size=".05"/></body>
    </body>
    <body name="ball" pos="0 3 2"><freejoint name="flight"/><geom size=".1"/></body>
  </worldbody>
  <keyframe><key name="crouch" qpos="0 0 .5 1 0 0 0  .3  .1  1 0 0 0  0 3 2 1 0 0 0"/></keyframe>
</mujoco>
"""


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    (tmp_path / "robot.xml").write_text(MODEL)
    return SceneLoader(tmp_path).open("robot.xml")


def start(scene: Scene, **values: object) -> np.ndarray:
    """Return (qpos, qvel) of a run of seed 0."""
    named = {name.replace("__", "."): value for name, value in values.items()}
    states = scene.initial_states([scene.resolve(named, 0, None)])
    return np.concatenate([states.qpos[0], states.qvel[0]])


def test_each_coordinate_is_an_axis_that_sets_one_number(scene: Scene) -> None:
    written = start(scene)
    names = scene.catalogue.coordinate_names
    model = scene.base({}).model
    places = set[int]()
    for name in names:
        if name.endswith((".qw", ".qx", ".qy", ".qz")):
            continue
        moved = start(scene, **{name.replace(".", "__"): 0.125})
        [place] = np.flatnonzero(moved != written).tolist()
        assert moved[place] == 0.125
        places.add(place)
    quaternions = 4 * 3  # of the trunk, the bob and the ball
    assert len(places) == model.nq + model.nv - quaternions


@pytest.mark.parametrize("height", [0.25, -0.25])
def test_drop_height_raises_every_free_body_and_nothing_else(scene: Scene, height: float) -> None:
    model = scene.base({}).model
    expected = start(scene)
    for joint in range(model.njnt):
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            expected[model.jnt_qposadr[joint] + 2] += height
    assert np.array_equal(start(scene, drop_height=height), expected)


def test_a_turned_start_keeps_a_unit_quaternion(scene: Scene) -> None:
    turned = start(scene, trunk__qz=1.0)[3:7]
    assert np.allclose(turned, np.array([1, 0, 0, 1]) / np.sqrt(2), atol=1e-15)


def test_units_are_those_of_the_joint(scene: Scene) -> None:
    units = {
        "trunk.z": "m",
        "trunk.qw": "1",
        "trunk.vx": "m/s",
        "trunk.wx": "rad/s",
        "knee": "rad",
        "knee.v": "rad/s",
        "rail": "m",
        "rail.v": "m/s",
        "swivel.wz": "rad/s",
        "flight.z": "m",
        "drop_height": "m",
    }
    for name, unit in units.items():
        axis = scene.catalogue.find_axis(name)
        assert axis is not None
        assert (name, axis.unit) == (name, unit)


def test_a_set_start_has_an_id_of_its_own_and_an_unset_one_keeps_its_id(scene: Scene) -> None:
    written = scene.run_id(scene.resolve({}, 0, None))
    ids = {
        scene.run_id(scene.resolve(values, 0, None))
        for values in ({"drop_height": 0.1}, {"trunk.z": 0.6}, {"knee.v": 0.1}, {"knee": 0.1})
    }
    assert len(ids | {written}) == 5


def test_a_height_conflicts_with_the_drop_height(scene: Scene) -> None:
    axis = scene.catalogue.find_axis("trunk.z")
    assert axis is not None
    assert axis.conflicts == ("drop_height",)
    assert "trunk.z" not in scene.catalogue.names
    assert "drop_height" in scene.catalogue.names


def test_a_manifest_needs_only_its_changes_and_starts_like_the_bare_model(
    scene: Scene, tmp_path: Path
) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "scene.xml").write_text(MODEL)
    (folder / "scene.yaml").write_text("version: 1\ndrive: auto\n")
    described = SceneLoader(tmp_path).open("folder")
    assert described.duration == scene.duration
    assert np.array_equal(start(described), start(scene))
    assert described.resolve({}, 0, None).keyframe == "crouch"
    (folder / "scene.yaml").write_text("version: 1\nkeyframe: qpos0\n")
    assert SceneLoader(tmp_path).open("folder").resolve({}, 0, None).keyframe == "qpos0"


def test_a_scene_may_define_its_own_drop_height() -> None:
    ball = SceneLoader(None).open("ball_drop")
    axis = ball.catalogue.find_axis("drop_height")
    assert axis is not None
    assert not ball.catalogue.sets_start("drop_height")
    [first, second] = [
        ball.initial_states([ball.resolve({"drop_height": height}, 0, None)]).qpos[0, 2]
        for height in (0.25, 0.5)
    ]
    assert second - first == pytest.approx(0.25, abs=1e-12)
