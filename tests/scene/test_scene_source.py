"""A scene's files: which they are, their hash, and a copy that is the same scene."""

import shutil
import struct
import warnings
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from contactlab.engines import Buffers
from contactlab.engines.mujoco_batch import roll_out
from contactlab.engines.rollout_trace import trajectory_hash
from contactlab.errors import ModelWarning, SceneError
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import find_scene, stored_scene

Files = Mapping[str, str | bytes]
TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
TRIANGLE = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nf 1 2 3\n"
FLOOR = '<geom type="plane" size="1 1 1"/>'
GEOM = f'<worldbody>{FLOOR}<body pos="0 0 .1"><freejoint/>{{}}</body></worldbody>'
MESH = GEOM.format('<geom type="mesh" mesh="x"/>')
BALL = GEOM.format('<geom size=".1"/>')


def png() -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", 2, 2, 8, 2, 0, 0, 0)
    pixels = zlib.compress(bytes(14))
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    )


def stl() -> bytes:
    corners = [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)]
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    triangles = b"".join(
        struct.pack("<12fH", 0, 0, 0, *(number for corner in face for number in corners[corner]), 0)
        for face in faces
    )
    return bytes(80) + struct.pack("<I", len(faces)) + triangles


def urdf(mesh: str, extra: str = "", visual: str = "") -> str:
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    return (
        f'<robot name="r">{extra}<link name="base"><inertial><mass value="1"/>{inertia}</inertial>'
        f'{visual}<collision><geometry><mesh filename="{mesh}"/></geometry></collision></link>'
        "</robot>"
    )


def asset(line: str, compiler: str = "", body: str = BALL) -> str:
    return f"<mujoco><compiler {compiler}/><asset>{line}</asset>{body}</mujoco>"


def option(text: str) -> str:
    return f"<mujoco><compiler {text}/></mujoco>"


def strip(folder: str) -> str:
    return f'<mujoco><compiler strippath="true" {folder}/></mujoco>'


X = '<mesh name="x" file="x.obj"/>'
HFIELD = struct.pack("<ii4f", 2, 2, 0, 0.1, 0.2, 0.3)
VISUAL = '<visual><geometry><mesh filename="{}"/></geometry></visual>'
# For each model, the files beside it that it needs; whatever else lies there does not belong to it.
CASES: dict[str, tuple[str, Files]] = {
    "mesh": ("scene.xml", {"scene.xml": asset(X, body=MESH), "x.obj": TETRAHEDRON}),
    "binary mesh": (
        "scene.xml",
        {"scene.xml": asset('<mesh name="x" file="m/x.stl"/>', body=MESH), "m/x.stl": stl()},
    ),
    "mesh folder": (
        "scene.xml",
        {"scene.xml": asset(X, 'meshdir="m" texturedir="t"', MESH), "m/x.obj": TETRAHEDRON},
    ),
    "asset folder": (
        "scene.xml",
        {"scene.xml": asset(X, 'assetdir="m"', MESH), "m/x.obj": TETRAHEDRON},
    ),
    "spaces": (
        "scene.xml",
        {
            "scene.xml": asset('<mesh name="x" file="x y.obj"/>', 'meshdir="m m"', MESH),
            "m m/x y.obj": TETRAHEDRON,
        },
    ),
    "a parent's folder": (
        "models/scene.xml",
        {
            "models/scene.xml": asset('<mesh name="x" file="../assets/x.obj"/>', body=MESH),
            "assets/x.obj": TETRAHEDRON,
        },
    ),
    "stripped paths": (
        "scene.xml",
        {
            "scene.xml": asset('<mesh name="x" file="far/x.obj"/>', 'strippath="true"', MESH),
            "x.obj": TETRAHEDRON,
        },
    ),
    "height field": (
        "scene.xml",
        {
            "scene.xml": asset('<hfield name="h" file="h.bin" size="1 1 1 1"/>', 'meshdir="m"'),
            "m/h.bin": HFIELD,
        },
    ),
    "textures": (
        "scene.xml",
        {
            "scene.xml": asset(
                '<texture name="t" type="2d" file="t.png"/>'
                '<texture name="c" type="cube" fileup="u.png" filedown="u.png"/>',
                'meshdir="m" texturedir="t"',
            ),
            "t/t.png": png(),
            "t/u.png": png(),
        },
    ),
    "includes": (
        "scene.xml",
        {
            "scene.xml": '<mujoco><include file="sub/a.xml"/></mujoco>',
            "sub/a.xml": '<mujocoinclude><include file="b.xml"/></mujocoinclude>',
            "sub/b.xml": f"<mujocoinclude>{BALL}</mujocoinclude>",
        },
    ),
    "an include that the main file's folder decides": (
        "scene.xml",
        {
            "scene.xml": '<mujoco><include file="sub/a.xml"/></mujoco>',
            "sub/a.xml": '<mujocoinclude><include file="b.xml"/></mujocoinclude>',
            "b.xml": f"<mujocoinclude>{BALL}</mujocoinclude>",
        },
    ),
    "a compiler after an include": (
        "scene.xml",
        {
            "scene.xml": f'<mujoco><include file="a.xml"/><compiler meshdir="m"/><asset>{X}</asset>'
            f"{MESH}</mujoco>",
            "a.xml": option('meshdir="k"'),
            "m/x.obj": TETRAHEDRON,
        },
    ),
    "a compiler in an include": (
        "scene.xml",
        {
            "scene.xml": f'<mujoco><compiler meshdir="m"/><include file="a.xml"/><asset>{X}</asset>'
            f"{MESH}</mujoco>",
            "a.xml": option('meshdir="k"'),
            "k/x.obj": TETRAHEDRON,
        },
    ),
    "an asset beside the include that names it": (
        "scene.xml",
        {
            "scene.xml": '<mujoco><compiler meshdir="m"/><include file="sub/a.xml"/>'
            f"{MESH}</mujoco>",
            "sub/a.xml": '<mujocoinclude><asset><mesh name="x" file="../k/x.obj"/></asset>'
            "</mujocoinclude>",
            "k/x.obj": TETRAHEDRON,
        },
    ),
    "an attached model": (
        "scene.xml",
        {
            "scene.xml": '<mujoco><asset><model name="r" file="r/robot.xml"/></asset><worldbody>'
            '<attach model="r" body="b" prefix="r_"/></worldbody></mujoco>',
            "r/robot.xml": '<mujoco><compiler meshdir="a"/><include file="asset.xml"/><worldbody>'
            '<body name="b"><freejoint/><geom type="mesh" mesh="x"/></body></worldbody></mujoco>',
            "r/asset.xml": f"<mujoco><asset>{X}</asset></mujoco>",
            "r/a/x.obj": TETRAHEDRON,
        },
    ),
    "urdf": ("x.urdf", {"x.urdf": urdf("x.obj"), "x.obj": TETRAHEDRON}),
    "urdf with folders": ("x.urdf", {"x.urdf": urdf("m/x.obj"), "m/x.obj": TETRAHEDRON}),
    "urdf of a package": (
        "x.urdf",
        {"x.urdf": urdf("package://p/x.obj", strip('meshdir="m"')), "m/x.obj": TETRAHEDRON},
    ),
    "urdf in its package": (
        "urdf/x.urdf",
        {"urdf/x.urdf": urdf("package://p/m/x.obj"), "m/x.obj": TETRAHEDRON},
    ),
    "urdf that names its package": (
        "p/urdf/x.urdf",
        {"p/urdf/x.urdf": urdf("package://p/m/x.obj"), "p/m/x.obj": TETRAHEDRON},
    ),
    "urdf of a package within another folder of it": (
        "p/robots/r/x.urdf",
        {"p/robots/r/x.urdf": urdf("package://p/robots/r/x.obj"), "p/robots/r/x.obj": TETRAHEDRON},
    ),
    "assets of a package": (
        "p/scene.xml",
        {
            "p/scene.xml": asset(
                '<mesh name="x" file="package://p/x.obj"/>'
                '<hfield name="h" file="model://q/h.bin" size="1 1 1 1"/>'
                '<texture name="t" type="2d" file="package://q/t.png"/>',
                body=MESH,
            ),
            "p/x.obj": TETRAHEDRON,
            "q/h.bin": HFIELD,
            "q/t.png": png(),
        },
    ),
    "urdf of two packages": (
        "p/urdf/x.urdf",
        {"p/urdf/x.urdf": urdf("model://q/m/x.obj"), "q/m/x.obj": TETRAHEDRON},
    ),
    "urdf without its visual mesh": (
        "x.urdf",
        {"x.urdf": urdf("x.obj", visual=VISUAL.format("y.dae")), "x.obj": TETRAHEDRON},
    ),
    "a flexible body": (
        "scene.xml",
        {
            "scene.xml": '<mujoco><compiler meshdir="m"/><worldbody><body name="b">'
            '<flexcomp name="f" type="mesh" file="x.obj" radius=".01" rigid="true"/></body>'
            "</worldbody></mujoco>",
            "m/x.obj": TRIANGLE,
        },
    ),
}
Write = Callable[[Path, Files], None]


@pytest.fixture
def write() -> Write:
    def write_files(folder: Path, files: Files) -> None:
        for name, content in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            data = content if isinstance(content, bytes) else content.encode()
            (folder / name).write_bytes(data)

    return write_files


def trajectory(scene: Scene) -> str:
    run = scene.resolve({}, 5, 0.1)
    base = scene.base(run.structure)
    rollout = roll_out(
        [base.prepare(run.list_edits()).model], scene.initial_states([run]), run.steps, Buffers()
    )
    return trajectory_hash(rollout, 0)


@pytest.mark.parametrize("case", CASES)
def test_a_copy_is_the_same_scene(case: str, write: Write, tmp_path: Path, differing: Any) -> None:
    model, files = CASES[case]
    write(tmp_path / "own", files)
    (tmp_path / "own" / "unrelated.obj").write_text(TETRAHEDRON)
    scene = Scene.open(str(tmp_path / "own" / model))
    assert {file.as_posix() for file in scene.source.content.files} == files.keys()
    scene.source.content.copy_to(tmp_path / "copy")
    shutil.rmtree(tmp_path / "own")
    copy = Scene(stored_scene(tmp_path / "copy", str(scene.source.content.model), scene.name))
    assert copy.hash == scene.hash
    assert copy.name == scene.name
    # A model remembers where its files lay, and how long that text is, which pads its buffer.
    places = {"npaths", "nbuffer", "mesh_pathadr", "hfield_pathadr", "tex_pathadr"}
    assert differing(copy.base({}).model, scene.base({}).model) <= places
    assert trajectory(copy) == trajectory(scene)


@pytest.mark.parametrize("case", CASES)
def test_every_file_counts(case: str, write: Write, tmp_path: Path) -> None:
    model, files = CASES[case]
    write(tmp_path, files)
    own = find_scene(str(tmp_path / model)).content.hash
    assert find_scene(str(tmp_path / model)).content.hash == own
    for name in files:
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data + b"\n")
        assert find_scene(str(tmp_path / model)).content.hash != own
        (tmp_path / name).write_bytes(data)


@pytest.mark.parametrize(
    ("files", "named"),
    [
        ({"scene.xml": asset('<mesh name="x" file="gone.obj"/>', body=MESH)}, "gone.obj"),
        ({"scene.xml": '<mujoco><include file="gone.xml"/></mujoco>'}, "gone.xml"),
        ({"scene.xml": asset('<model name="r" file="gone.xml"/>')}, "gone.xml"),
        ({"scene.xml": asset('<texture name="t" type="2d" file="gone.png"/>')}, "gone.png"),
    ],
)
def test_a_missing_file_is_named(files: Files, named: str, write: Write, tmp_path: Path) -> None:
    write(tmp_path, files)
    with pytest.raises(SceneError, match=named):
        Scene.open(str(tmp_path / "scene.xml"))


ATTACHING = (
    '<mujoco><asset><model name="r" file="{root}/far/robot.xml"/></asset><worldbody>'
    '<attach model="r" body="b" prefix="r_"/></worldbody></mujoco>'
)
ROBOT = (
    '<mujoco><compiler meshdir="{root}/far/m"/><asset><mesh name="x" file="x.obj"/>'
    '<mesh name="y" file="{root}/y.obj"/></asset><worldbody><body name="b"><freejoint/>'
    '<geom type="mesh" mesh="x"/><geom type="mesh" mesh="y"/></body></worldbody></mujoco>'
)


@pytest.mark.parametrize("model", ["near/scene.xml", "far/robot.xml"])
def test_absolute_paths_are_found_in_a_copy(model: str, write: Write, tmp_path: Path) -> None:
    own = tmp_path / "own"
    files = {"near/scene.xml": ATTACHING, "far/robot.xml": ROBOT}
    write(own, {name: text.format(root=own) for name, text in files.items()})
    write(own, {"far/m/x.obj": TETRAHEDRON, "y.obj": TETRAHEDRON.replace(".1", ".2")})
    scene = Scene.open(str(own / model))
    scene.source.content.copy_to(tmp_path / "copy")
    shutil.rmtree(own)
    copy = Scene(stored_scene(tmp_path / "copy", str(scene.source.content.model), scene.name))
    assert copy.hash == scene.hash
    assert trajectory(copy) == trajectory(scene)


def test_licences_go_with_a_copy_and_are_no_part_of_the_scene(write: Write, tmp_path: Path) -> None:
    model, files = CASES["urdf that names its package"]
    write(tmp_path, files)
    own = find_scene(str(tmp_path / model)).content
    kept = ["p/LICENSE", "p/NOTICE.md", "p/m/COPYING.txt", "LICENCE-APACHE"]
    left = ["p/licensed.xml", "p/other/LICENSE", "../LICENSE"]
    write(tmp_path, dict.fromkeys([*kept, *left], "terms"))
    content = find_scene(str(tmp_path / model)).content
    content.copy_to(tmp_path / "copy")
    found = {path for path in (tmp_path / "copy").rglob("*") if path.is_file()}
    assert {str(path.relative_to(tmp_path / "copy")) for path in found} == {*files, *kept}
    assert content.hash == own.hash == stored_scene(tmp_path / "copy", model, "x").content.hash


def test_a_copy_within_a_package_of_that_name_is_found_first(write: Write, tmp_path: Path) -> None:
    """A store may lie within the package; what it keeps must not change with it."""
    model, files = CASES["urdf in its package"]
    write(tmp_path / "p" / "store", files)
    write(tmp_path / "p", {"m/x.obj": TETRAHEDRON.replace(".1", ".2")})
    assert find_scene(str(tmp_path / "p" / "store" / model)).content.root == tmp_path
    copy = stored_scene(tmp_path / "p" / "store", model, "x").content
    assert copy.root == tmp_path / "p" / "store"


def test_what_mujoco_warns_of_is_said_once_and_not_of_a_copy(write: Write, tmp_path: Path) -> None:
    write(tmp_path, {"scene.xml": f'<mujoco><compiler settotalmass="3"/>{BALL}</mujoco>'})
    with pytest.warns(ModelWarning, match="scene.xml: .*settotalmass") as caught:
        scene = Scene.open(str(tmp_path / "scene.xml"))
    assert len(caught) == 1
    with warnings.catch_warnings(action="error"):
        scene.base({}, frozenset({"energy"}))
        Scene(stored_scene(tmp_path, "scene.xml", "scene"))
