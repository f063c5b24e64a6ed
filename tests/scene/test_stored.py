"""A scene that was copied into a store is found again as what it was."""

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import stored_scene

Write = Callable[[Path, Mapping[str, str]], None]
BALL = "<worldbody><body><freejoint/><geom size='.1'/></body></worldbody>"
X = "<asset><mesh name='x' file='x.obj'/></asset>"
MESH = "<worldbody><body><freejoint/><geom type='mesh' mesh='x'/></body></worldbody>"
TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def test_links_keep_their_names(write_files: Write, tmp_path: Path) -> None:
    write_files(
        tmp_path,
        {"far/away/shape.obj": TETRAHEDRON, "own/scene.xml": f"<mujoco>{X}{MESH}</mujoco>"},
    )
    (tmp_path / "own" / "x.obj").symlink_to(tmp_path / "far" / "away" / "shape.obj")
    scene = Scene.open(str(tmp_path / "own" / "scene.xml"))
    assert [str(file) for file in scene.source.content.files] == ["scene.xml", "x.obj"]
    scene.source.content.copy_to(tmp_path / "copy")
    copy = Scene(stored_scene(tmp_path / "copy", "scene.xml", "scene"))
    assert (copy.base({}).model.mesh_vert == scene.base({}).model.mesh_vert).all()


@pytest.mark.parametrize("model", ["scene.xml", "mjcf/scene.xml", "../shared/scene.xml"])
def test_a_stored_scene_keeps_its_manifest(model: str, write_files: Write, tmp_path: Path) -> None:
    manifest = f"version: 1\ntitle: t\ndescription: d\nduration: 0.4\nmodel: {model}\n"
    write_files(
        tmp_path / "own" / "here", {"scene.yaml": manifest, model: f"<mujoco>{BALL}</mujoco>"}
    )
    scene = Scene.open(str(tmp_path / "own" / "here"))
    content = scene.source.content
    content.copy_to(tmp_path / "copy")
    copy = Scene(stored_scene(tmp_path / "copy", str(content.model), scene.name))
    assert copy.source.manifest == scene.source.manifest
    assert (copy.duration, copy.hash, copy.name) == (0.4, scene.hash, "here")
    assert copy.run_id(copy.resolve({}, 1, None)) == scene.run_id(scene.resolve({}, 1, None))


def test_a_stored_model_stays_bare_beside_a_manifest(write_files: Write, tmp_path: Path) -> None:
    manifest = "version: 1\ntitle: t\ndescription: d\nduration: 0.4\n"
    write_files(tmp_path / "own", {"scene.yaml": manifest, "scene.xml": f"<mujoco>{BALL}</mujoco>"})
    scene = Scene.open(str(tmp_path / "own" / "scene.xml"))
    scene.source.content.copy_to(tmp_path / "copy")
    assert stored_scene(tmp_path / "copy", "scene.xml", "scene").manifest is None
    assert scene.source.manifest is None
