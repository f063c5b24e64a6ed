"""URDF as it is found in ROS packages, as a scene by itself."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from contactlab.errors import SceneError
from contactlab.scene.scene import Scene

Write = Callable[[Path, Mapping[str, str]], None]
# Tetrahedra of 0.1 and 0.2 m.
SMALL = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
LARGE = SMALL.replace(".1", ".2")
ARM = """<robot name="arm">{extra}
  <link name="base"><collision><geometry><box size=".1 .1 .1"/></geometry></collision></link>
  <link name="arm">
    <inertial>
      <mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual><geometry><mesh filename="package://arm/meshes/gone.dae"/></geometry></visual>
    <collision><geometry><mesh filename="{mesh}"/></geometry></collision>
  </link>
  <joint name="hinge" type="revolute">
    <parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
</robot>
"""
STRIP = '<mujoco><compiler meshdir="../meshes" strippath="true"/></mujoco>'


def arm(mesh: str, extra: str = "") -> str:
    return ARM.format(mesh=mesh, extra=extra)


def size(scene: Scene) -> float:
    """Return the longest edge of the scene's mesh [m]."""
    vertices = np.array(scene.base({}).model.mesh_vert)
    return float(np.linalg.norm(vertices[:, None] - vertices, axis=2).max())


@pytest.mark.parametrize(
    ("mesh", "extra", "place"),
    [
        ("package://arm/meshes/part.obj", "", "arm/"),
        ("package:///arm/meshes/part.obj", "", "arm/"),
        ("model://arm/meshes/part.obj", "", "arm/"),
        ("../meshes/part.obj", "", ""),
        ("package://elsewhere/part.obj", STRIP, ""),
    ],
)
def test_a_mesh_of_the_package_is_found(
    mesh: str, extra: str, place: str, write_files: Write, tmp_path: Path
) -> None:
    files = {"arm/urdf/arm.urdf": arm(mesh, extra), "arm/meshes/part.obj": SMALL}
    write_files(tmp_path, files)
    scene = Scene.open("arm/urdf/arm.urdf", tmp_path)
    assert [str(file) for file in scene.source.content.files] == [
        f"{place}meshes/part.obj",
        f"{place}urdf/arm.urdf",
    ]
    assert scene.base({}).model.jnt_range[0].tolist() == [-1, 1]


def test_the_package_s_own_file_goes_before_one_of_that_path(
    write_files: Write, tmp_path: Path
) -> None:
    """The package `arm` holds 0.2 m; a folder that is nearer only looks like it."""
    write_files(
        tmp_path,
        {
            "arm/robots/arm.urdf": arm("package://arm/meshes/part.obj"),
            "arm/robots/meshes/part.obj": SMALL,
            "arm/meshes/part.obj": LARGE,
        },
    )
    assert size(Scene.open("arm/robots/arm.urdf", tmp_path)) == pytest.approx(
        0.2 * 2**0.5, rel=1e-6
    )


@pytest.mark.parametrize(
    ("mesh", "place"),
    [
        ("package://arm/meshes/part.obj", "arm/meshes/part.obj"),
        ("package://other/meshes/part.obj", "arm/urdf/other/meshes/part.obj"),
        ("meshes/part.obj", "arm/urdf/meshes/part.obj"),
    ],
)
def test_a_missing_mesh_is_told_with_its_place_and_the_line_to_write(
    mesh: str, place: str, write_files: Write, tmp_path: Path
) -> None:
    write_files(tmp_path, {"arm/urdf/arm.urdf": arm(mesh)})
    with pytest.raises(SceneError, match="does not compile") as caught:
        Scene.open("arm/urdf/arm.urdf", tmp_path)
    message = str(caught.value)
    assert f"expected at {tmp_path / place};" in message
    assert '<mujoco><compiler meshdir="FOLDER" strippath="true"/></mujoco>' in message
    assert "gone.dae" not in message
    assert len(message.splitlines()) < 8


def test_what_the_message_says_to_write_is_right(write_files: Write, tmp_path: Path) -> None:
    line = '<mujoco><compiler meshdir="../meshes" strippath="true"/></mujoco>'
    files = {
        "arm/urdf/arm.urdf": arm("package://other/cad/part.obj", line),
        "arm/meshes/part.obj": SMALL,
    }
    write_files(tmp_path, files)
    assert Scene.open("arm/urdf/arm.urdf", tmp_path).base({}).model.nmesh == 1


def test_a_missing_mesh_of_mjcf_is_told_likewise(write_files: Write, tmp_path: Path) -> None:
    geom = '<body><freejoint/><geom type="mesh" mesh="x"/></body>'
    asset = '<asset><mesh name="x" file="x.obj"/></asset>'
    write_files(tmp_path, {"robot.xml": f"<mujoco>{asset}<worldbody>{geom}</worldbody></mujoco>"})
    with pytest.raises(SceneError) as caught:
        Scene.open("robot.xml", tmp_path)
    assert f"expected at {tmp_path / 'x.obj'};" in str(caught.value)
    assert '<compiler meshdir="FOLDER"/>' in str(caught.value)


def test_a_mesh_that_mujoco_cannot_read_is_told(write_files: Write, tmp_path: Path) -> None:
    write_files(tmp_path, {"arm/arm.urdf": arm("part.dae"), "arm/part.dae": "<COLLADA/>"})
    with pytest.raises(SceneError, match=r"part\.dae'(.|\n)*reads meshes from \.stl, \.obj and"):
        Scene.open("arm/arm.urdf", tmp_path)
