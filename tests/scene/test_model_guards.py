"""A scene's files are its own: nothing else of the machine is read or copied."""

import os
from pathlib import Path

import pytest

from contactlab.errors import SceneError
from contactlab.scene.model_guards import ALLOWED, allow_files, scene_tree
from contactlab.scene.scene_source import collect_files, find_scene

TEXTURE = '<texture name="t" type="cube" file="own.png" fileright="{}"/>'
MODEL = "<mujoco><asset>{}</asset><worldbody/></mujoco>"


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(ALLOWED, "")
    home = tmp_path / "home"
    (home / ".ssh").mkdir(parents=True)
    (home / ".ssh" / "id_rsa").write_text("key")
    monkeypatch.setenv("HOME", str(home))


def model_naming(folder: Path, name: str) -> Path:
    """Write a model that names a file, in a place that MuJoCo never reads."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "own.png").touch()
    path = folder / "robot.xml"
    path.write_text(MODEL.format(TEXTURE.format(name)))
    return path


def write(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return path


@pytest.mark.parametrize("place", ["Downloads", "Downloads/robot", "Downloads/robot/urdf", "."])
@pytest.mark.parametrize("name", ["/etc/passwd", "../" * 20 + "etc/passwd", "{home}/.ssh/id_rsa"])
def test_a_model_names_no_file_of_the_machine(tmp_path: Path, place: str, name: str) -> None:
    home = tmp_path / "home"
    path = model_naming(home / place, name.format(home=home))
    with pytest.raises(SceneError, match="lies outside of"):
        collect_files(path)


@pytest.mark.parametrize("up", ["", "../", "../../"])
def test_hidden_files_are_never_a_scene_s(tmp_path: Path, up: str) -> None:
    root = tmp_path / "project"
    write(root / "pyproject.toml")
    for folder in (root, root / "scenes", root / "scenes" / "box"):
        write(folder / ".env")
    path = model_naming(root / "scenes" / "box", f"{up}.env")
    with pytest.raises(SceneError, match="allow its folder: `contactlab --allow-files"):
        collect_files(path)


def test_a_link_is_where_it_leads(tmp_path: Path) -> None:
    path = model_naming(tmp_path / "a" / "b" / "c" / "model", "wall.png")
    secret = write(tmp_path / "other" / "secret")
    (path.parent / "wall.png").symlink_to(secret)
    with pytest.raises(SceneError, match="lies outside of"):
        collect_files(path)


def test_what_is_outside_and_not_there_is_said_to_be_missing(tmp_path: Path) -> None:
    """As the meshes of a menagerie that a package downloads on its first use."""
    path = model_naming(tmp_path / "a" / "b" / "c" / "model", str(tmp_path / "menagerie" / "a.png"))
    with pytest.raises(SceneError, match="does not exist, and lies outside of"):
        collect_files(path)
    write(tmp_path / "menagerie" / "a.png")
    with pytest.raises(SceneError, match=r"a.png lies outside of"):
        collect_files(path)


def test_a_manifest_that_is_a_link_is_not_read(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("password: 1")
    folder = tmp_path / "some" / "own" / "deep" / "scene"
    folder.mkdir(parents=True)
    (folder / "scene.yaml").symlink_to(secret)
    with pytest.raises(SceneError, match="lies outside of") as caught:
        find_scene(str(folder))
    assert "password" not in str(caught.value)


def test_pipes_are_not_waited_for(tmp_path: Path) -> None:
    path = model_naming(tmp_path / "model", "pipe")
    os.mkfifo(path.parent / "pipe")
    with pytest.raises(SceneError, match="no regular file"):
        collect_files(path)
    path.write_text('<mujoco><include file="pipe"/></mujoco>')
    with pytest.raises(SceneError, match="no regular file"):
        collect_files(path)


@pytest.mark.parametrize(
    ("marker", "model", "file"),
    [
        ("some/urdf/x.txt", "some/urdf", "some/meshes/a.stl"),
        ("some/package.xml", "some/robots/one/urdf", "some/robots/two/meshes/a.stl"),
        ("some/package.xml", "some/robots/one/urdf", "some/a.stl"),
        ("pkg/__init__.py", "pkg/assets/one", "pkg/textures/a.png"),
        (".git/config", "scenes/one", "meshes/a.stl"),
    ],
)
def test_a_model_names_the_files_of_its_package(
    tmp_path: Path, marker: str, model: str, file: str
) -> None:
    root = tmp_path / "some" / "where"
    write(root / marker)
    there = write(root / file)
    up = "../" * len(Path(model).parts)
    path = model_naming(root / model, up + file)
    assert there in {root_file(path, each) for each in collect_files(path).files}


def root_file(path: Path, file: Path) -> Path:
    return collect_files(path).root / file


def test_a_python_package_is_taken_as_a_whole(tmp_path: Path) -> None:
    for each in ("pkg", "pkg/inner"):
        write(tmp_path / each / "__init__.py")
    (tmp_path / "pkg" / "inner" / "assets").mkdir()
    assert scene_tree(tmp_path / "pkg" / "inner" / "assets") == tmp_path / "pkg"


def test_a_ros_package_may_name_another_beside_it(tmp_path: Path) -> None:
    for each in ("arm", "hand"):
        write(tmp_path / "share" / each / "package.xml")
    mesh = write(tmp_path / "share" / "hand" / "meshes" / "a.stl")
    path = model_naming(tmp_path / "share" / "arm" / "urdf", "../../hand/meshes/a.stl")
    assert mesh in {root_file(path, each) for each in collect_files(path).files}


def test_the_user_may_allow_a_folder(tmp_path: Path) -> None:
    mesh = write(tmp_path / "elsewhere" / "deep" / "a.stl")
    path = model_naming(tmp_path / "one" / "two" / "three", str(mesh))
    with pytest.raises(SceneError, match=f"--allow-files {mesh.parent}"):
        collect_files(path)
    allow_files([mesh.parent])
    assert mesh in {root_file(path, each) for each in collect_files(path).files}


def test_a_store_s_copy_names_its_own_files_only(tmp_path: Path) -> None:
    copy = tmp_path / "project" / "scenes" / "0"
    write(tmp_path / "project" / "pyproject.toml")
    write(tmp_path / "project" / "a.stl")
    path = model_naming(copy, "../../a.stl")
    collect_files(path)
    with pytest.raises(SceneError, match="lies outside of"):
        collect_files(path, copy=copy)


# What MuJoCo would read of /elsewhere, written so that a reader of XML may miss it.
DELIVERIES = {
    "meshdir": '<compiler meshdir="/elsewhere"/><asset><mesh file="m.obj"/></asset>',
    "assetdir": '<compiler assetdir="/elsewhere"/><asset><mesh file="m.obj"/></asset>',
    "the last of two": '<compiler meshdir="."/><compiler meshdir="/elsewhere"/>'
    '<asset><mesh file="m.obj"/></asset>',
    "a character's number": '<asset><mesh file="&#47;elsewhere/m.obj"/></asset>',
    "behind plain text": '<![CDATA[<!--]]><asset><mesh file="/elsewhere/m.obj"/></asset>',
    "behind an instruction": '<?x <!-- ?><asset><mesh file="/elsewhere/m.obj"/></asset>',
    "flexcomp": '<worldbody><flexcomp name="f" type="mesh" file="/elsewhere/m.obj"/></worldbody>',
    "part": '<asset><model name="p" file="/elsewhere/part.xml"/></asset>',
    "skin": '<asset><skin file="/elsewhere/s.skn"/></asset>',
    "height": '<asset><hfield name="h" file="/elsewhere/h.bin" size="1 1 1 1"/></asset>',
    "included": '<worldbody><include file="/elsewhere/part.xml"/></worldbody>',
}


@pytest.mark.parametrize("bom", ["", "\ufeff"])
@pytest.mark.parametrize("name", DELIVERIES)
def test_no_way_of_writing_it_hides_a_file(tmp_path: Path, name: str, bom: str) -> None:
    elsewhere = tmp_path / "elsewhere"
    for file in ("m.obj", "s.skn", "h.bin"):
        write(elsewhere / file)
    (elsewhere / "part.xml").write_text("<mujoco/>")
    project = tmp_path / "project"
    write(project / "pyproject.toml")
    text = DELIVERIES[name].replace("elsewhere", str(elsewhere)[1:])
    path = project / "robot.xml"
    path.write_text(f"{bom}<mujoco>{text}</mujoco>")
    with pytest.raises(SceneError, match="outside of"):
        collect_files(path)


LINK = '<link name="a"><collision><geometry><mesh filename="m.obj"/></geometry></collision></link>'
DECOYS = {
    "assetdir sets meshdir again": '<mujoco><compiler meshdir="."/><compiler assetdir="{outside}"/>'
    '<asset><mesh file="m.obj"/></asset></mujoco>',
    "a compiler that a URDF does not have": '<robot name="r"><mujoco><compiler '
    'meshdir="{outside}"/></mujoco>' + LINK + '<compiler meshdir="."/></robot>',
    "a compiler of a link": '<ROBOT name="r"><mujoco><compiler meshdir="{outside}"/></mujoco>'
    + LINK
    + '<link name="b"><compiler meshdir="."/></link></ROBOT>',
    "a model by its type": '<mujoco><asset><model file="part.mjb" content_type="text/xml"/>'
    "</asset></mujoco>",
    "a model that an included file attaches": '<mujoco><include file="inner/more.xml"/></mujoco>',
    "a model that is attached by two paths": '<mujoco><asset><model name="a" file="part.xml"/>'
    '<model name="b" file="link/part.xml"/></asset></mujoco>',
    "a model that is included and attached": '<mujoco><compiler meshdir="other"/>'
    '<include file="inner/deep.xml"/><asset><model file="inner/deep.xml"/></asset></mujoco>',
}


@pytest.mark.parametrize("name", DECOYS)
def test_no_decoy_hides_the_file_that_mujoco_opens(tmp_path: Path, name: str) -> None:
    """Next to each file that MuJoCo opens lies another one, which is the model's to name."""
    outside, project = tmp_path / "outside", tmp_path / "project"
    for folder in (outside, project, project / "inner", project / "other/sub"):
        write(folder / "m.obj")
    write(project / "pyproject.toml")
    part = "<mujoco><asset><mesh name='m' file='{}'/></asset></mujoco>"
    (project / "part.mjb").write_text(part.format(outside / "m.obj"))
    (project / "inner/only.xml").write_text(part.format(outside / "m.obj"))
    (project / "inner/more.xml").write_text(
        "<mujocoinclude><asset><model file='only.xml'/></asset></mujocoinclude>"
    )
    (project / "part.xml").write_text(part.format("m.obj"))
    (project / "inner/deep.xml").write_text(part.format("sub/m.obj"))
    (project / "inner/sub").symlink_to(outside)
    (project / "link").mkdir()
    (project / "link/part.xml").symlink_to("../part.xml")
    (project / "link/m.obj").symlink_to(outside / "m.obj")
    path = project / "robot.xml"
    path.write_text(DECOYS[name].format(outside=outside))
    with pytest.raises(SceneError, match="lies outside of"):
        collect_files(path)
