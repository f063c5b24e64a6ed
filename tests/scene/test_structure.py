"""Structure values are written into the MJCF before it is parsed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab import resources
from contactlab.scene.scene import Scene

BALL = "<worldbody><body name='b' pos='0 0 1'><freejoint/><geom {}/></body></worldbody>"
MESH = "<compiler meshdir='{}'/><asset><mesh name='x' file='x.obj'/></asset>"
SOLID = BALL.format("type='mesh' mesh='x'")
TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
DEEP = (
    "structure: {deep: {default: 0.004, unit: m, description: d, "
    "element: .//geom, attribute: margin}}\n"
)
CASES = {
    "a mesh": {"scene.xml": f"<mujoco>{MESH.format('m')}{SOLID}</mujoco>", "m/x.obj": TETRAHEDRON},
    "an include": {
        "scene.xml": "<mujoco><include file='sub/a.xml'/></mujoco>",
        "sub/a.xml": "<mujocoinclude>" + BALL.format("size='.1'") + "</mujocoinclude>",
    },
    "an attached model": {
        "scene.xml": "<mujoco><asset><model name='r' file='r/robot.xml'/></asset><worldbody>"
        "<attach model='r' body='b' prefix='r_'/></worldbody></mujoco>",
        "r/robot.xml": f"<mujoco>{MESH.format('a')}{SOLID}</mujoco>",
        "r/a/x.obj": TETRAHEDRON,
    },
}


@pytest.mark.parametrize("case", CASES)
def test_a_structure_finds_its_files(case: str, make_scene: Callable[..., Scene]) -> None:
    # Elements of included and attached files are written too.
    files = dict(CASES[case])
    scene = make_scene(files.pop("scene.xml"), DEEP, files)
    for value in (0.004, 0.007):
        model = scene.base({"deep": value}).model
        assert model.ngeom == 1
        assert np.all(model.geom_margin == value)


def test_structure_is_as_if_written(differing: Any, tmp_path: Path) -> None:
    folder = resources.MODELS / "box_stack"
    text = (folder / "scene.xml").read_text()
    assert 'count="10"' in text
    (tmp_path / "scene.xml").write_text(text.replace('count="10"', 'count="4"'))
    (tmp_path / "scene.yaml").write_text(
        (folder / "scene.yaml").read_text().replace("default: 10", "default: 4")
    )
    wanted = Scene.open(str(tmp_path)).base({}).model
    assert differing(Scene.open("box_stack").base({"boxes": 4}).model, wanted) == set()
    plain = mujoco.MjModel.from_xml_path(str(tmp_path / "scene.xml"))
    assert (plain.nq, plain.ngeom) == (wanted.nq, wanted.ngeom)
