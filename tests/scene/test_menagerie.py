"""Robots of MuJoCo Menagerie as scenes: found, told when they are not, and run as any other."""

import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab import resources
from contactlab.errors import SceneError
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import find_scene, menagerie_name, stored_scene

pytestmark = pytest.mark.long

Write = Callable[[Path, Mapping[str, str]], None]
ROBOT = "franka_emika_panda"
BALL = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
FLOOR = (
    "<mujoco><include file='panda.xml'/>"
    "<worldbody><geom type='plane' size='1 1 1' pos='0 0 -1'/></worldbody></mujoco>"
)
needs_robot = pytest.mark.skipif(
    "MENAGERIE_ROOT" not in os.environ,
    reason="MENAGERIE_ROOT names no folder with the robot's meshes",
)


@pytest.fixture
def folder(tmp_path: Path, write_files: Write, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder that stands in for what the package downloads, with a robot of our own."""
    write_files(tmp_path / ROBOT, {"panda.xml": BALL, "scene.xml": FLOOR, "notes.txt": "mine"})
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    return tmp_path


@pytest.mark.parametrize(
    ("reference", "name", "files"),
    [
        (f"menagerie:{ROBOT}", ROBOT, ["panda.xml", "scene.xml"]),
        (f"menagerie:{ROBOT}/scene", f"{ROBOT}-scene", ["panda.xml", "scene.xml"]),
        (f"menagerie:{ROBOT}/panda", f"{ROBOT}-panda", ["panda.xml"]),
    ],
)
def test_a_robot_is_a_scene_of_its_own_files(
    folder: Path, reference: str, name: str, files: list[str]
) -> None:
    source = find_scene(reference, Path("elsewhere"))
    assert source.model.is_relative_to(folder)
    assert [str(file) for file in source.content.files] == files
    assert source.name == menagerie_name(reference) == name
    assert source.manifest is None


@pytest.mark.parametrize(
    ("reference", "words"),
    [
        ("menagerie:franka_emika_pnda", ["franka_emika_pnda", f"did you mean '{ROBOT}'"]),
        ("menagerie:", ["no robot ''", "mujoco-menagerie names"]),
        (f"menagerie:{ROBOT}/pnda", ["no entry 'pnda'", "did you mean 'panda'"]),
        (f"menagerie:{ROBOT}/x", ["no entry 'x'", "write one of hand, "]),
        (f"menagerie:{ROBOT}/panda/more", ["no entry 'panda/more'"]),
        (f"menagerie:{ROBOT}/hand", ["has no hand.xml"]),
        ("menagerie:unitree_g1", ["cannot get unitree_g1", "MENAGERIE_ROOT"]),
    ],
)
@pytest.mark.usefixtures("folder")
def test_what_is_not_there_is_told(reference: str, words: list[str]) -> None:
    with pytest.raises(SceneError) as caught:
        find_scene(reference)
    assert [word for word in words if word not in str(caught.value)] == []


@pytest.mark.usefixtures("free_of_waiting")
def test_a_download_that_fails_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("MENAGERIE_BASE_URL", (tmp_path / "nowhere").as_uri())
    with pytest.raises(SceneError, match="without a network, set MENAGERIE_ROOT"):
        find_scene(f"menagerie:{ROBOT}")


def test_a_cache_that_cannot_be_written_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cache").write_text("a file")
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "cache"))
    with pytest.raises(SceneError, match=f"cannot get {ROBOT}"):
        find_scene(f"menagerie:{ROBOT}")


@pytest.fixture
def free_of_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the package try again at once."""
    monkeypatch.setattr("mujoco_menagerie._cache.time.sleep", lambda _: None)


def test_without_the_package_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    with pytest.raises(SceneError, match="pip install 'mujoco-menagerie>="):
        find_scene(f"menagerie:{ROBOT}")


@pytest.mark.usefixtures("folder")
def test_a_copy_needs_no_menagerie(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene.open(f"menagerie:{ROBOT}")
    content = scene.source.content
    content.copy_to(tmp_path / "copy")
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    copy = Scene(stored_scene(tmp_path / "copy", str(content.model), scene.name))
    assert (copy.hash, copy.name) == (scene.hash, scene.name)
    assert copy.run_id(copy.resolve({}, 1, None)) == scene.run_id(scene.resolve({}, 1, None))


@needs_robot
def test_the_panda_keeps_only_the_files_that_it_refers_to() -> None:
    source = find_scene(f"menagerie:{ROBOT}/panda")
    names = {file.as_posix() for file in source.content.files}
    assert "panda.xml" in names
    assert not names & {"LICENSE", "README.md", "scene.xml", "panda_nohand.xml", "hand.xml"}
    model = mujoco.MjModel.from_xml_path(str(source.model))
    assert len(names) == 1 + model.nmesh


def bare(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile an arm with fixed fingers, without actuators, damping or limits."""
    others = (*spec.actuators, *spec.equalities, *spec.tendons, *spec.keys, *spec.sensors)
    fingers = [joint for joint in spec.joints if joint.name.startswith("finger")]
    for element in (*others, *fingers):
        spec.delete(element)
    for joint in spec.joints:
        joint.damping[0], joint.limited = 0, False
    return spec.compile()


@needs_robot
def test_panda_free_is_the_panda() -> None:
    """Equal inertia matrices and bias forces, in any posture and motion, to rounding.

    Both models hold the same numbers to 7 digits or more; those of the hand's quarter turn have 7,
    so that what turns with it differs by 1e-7 of its share.
    """
    own = bare(mujoco.MjSpec.from_file(str(resources.MODELS / "panda_free" / "scene.xml")))
    real = bare(mujoco.MjSpec.from_file(str(find_scene(f"menagerie:{ROBOT}/panda").model)))
    assert (own.nv, real.nv) == (7, 7)
    assert np.array_equal(own.dof_armature, real.dof_armature)
    random = np.random.default_rng(0)
    for _ in range(20):
        posture, motion = random.uniform(-3, 3, (2, 7))
        first, second = (_dynamics(model, posture, motion) for model in (own, real))
        assert np.allclose(first, second, rtol=0, atol=1e-6 * np.abs(second).max())


def _dynamics(model: mujoco.MjModel, posture: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Return (7, 8) the inertia matrix and, beside it, the bias forces."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = posture, motion
    mujoco.mj_forward(model, data)
    inertia = np.zeros((7, 7))
    for row, unit in zip(inertia, np.eye(7), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    return np.column_stack([inertia, data.qfrc_bias])
