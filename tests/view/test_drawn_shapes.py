"""Shapes fill the boxes that the engine puts around its geoms; poses are the engine's."""

from collections.abc import Sequence
from itertools import product

import mujoco
import numpy as np
import pytest

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.model_names import name_by_address
from contactlab.view.drawn_shapes import BodyShape, body_poses, body_shapes

GEOMS = {
    "box": 'type="box" size="0.1 0.2 0.3"',
    "sphere": 'type="sphere" size="0.2"',
    "ellipsoid": 'type="ellipsoid" size="0.1 0.2 0.3"',
    "cylinder": 'type="cylinder" size="0.1 0.3"',
    "capsule": 'type="capsule" size="0.1 0.3"',
    "mesh": 'type="mesh" mesh="wedge"',
}
MODEL = """
<mujoco>
  <asset>
    <mesh name="wedge" vertex="0 0 0  1 0 0  0 2 0  0 0 3"/>
    <hfield name="hills" nrow="3" ncol="4" size="2 1 0.5 0.1"
      elevation="0 0.2 0.4 0.1  0.9 0.3 1 0  0.5 0.6 0.7 0.8"/>
    <material name="red" rgba="1 0 0 1"/>
  </asset>
  <worldbody>
    <geom name="field" type="hfield" hfield="hills"/>
    <geom name="ground" type="plane" size="0 3 0.1" pos="0 0 -1"/>
    <body name="thing" pos="0.3 0.2 0.1">
      <freejoint/>
      <geom name="it" pos="0.1 -0.2 0.3" quat="0.5 -0.1 0.7 0.2" {geom} material="red"/>
      <geom name="hidden" size="0.1" group="3" pos="0.1 -0.2 0.3"/>
      <geom name="clear" size="0.1" rgba="1 1 1 0"/>
    </body>
    <body pos="0 0 5"><joint type="hinge"/><geom name="proxy" size="0.1" group="4"/>
      <body><joint type="ball"/><geom type="box" size="1 1 1"/></body>
    </body>
  </worldbody>
</mujoco>
"""


def compiled(geom: str) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(MODEL.format(geom=GEOMS[geom]))
    name_by_address(spec)
    return spec.compile()


def rotation(quaternion: Floats) -> Floats:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def extremes(shape: BodyShape, turn: Floats, origin: Floats) -> tuple[Floats, Floats]:
    """Return the least and largest coordinates of a shape in a frame (turn, origin)."""
    axes = turn.T @ rotation(shape.rotation) * shape.size / 2
    centre = turn.T @ (shape.position - origin)
    if shape.form == "mesh":
        points = (shape.vertices @ rotation(shape.rotation).T + shape.position - origin) @ turn
        return points.min(axis=0), points.max(axis=0)
    if shape.form == "box":
        half = np.abs(axes).sum(axis=1)
    elif shape.form == "ellipsoid":
        half = np.linalg.norm(axes, axis=1)
    else:
        half = np.linalg.norm(axes[:, :2], axis=1) + np.abs(axes[:, 2])
    return centre - half, centre + half


@pytest.mark.parametrize("geom", GEOMS)
def test_shapes_fill_the_box_around_their_geom(geom: str) -> None:
    model = compiled(geom)
    index = model.geom("it").id
    origin, turn = model.geom_pos[index], rotation(model.geom_quat[index])
    mine = [each for each in body_shapes(model) if each.name.partition("/")[0] == "it"]
    spans = [extremes(each, turn, origin) for each in mine]
    low, high = np.min([each[0] for each in spans], 0), np.max([each[1] for each in spans], 0)
    centre, half = model.geom_aabb[index].reshape(2, 3)
    # Meshes are kept in single precision, at most 3 m long.
    np.testing.assert_allclose(low, centre - half, atol=1e-6)
    np.testing.assert_allclose(high, centre + half, atol=1e-6)
    assert {each.body for each in mine} == {int(model.geom_bodyid[index])}
    assert all(each.colour.tolist() == [1, 0, 0, 1] for each in mine)


def test_a_capsule_has_round_ends() -> None:
    parts = [each for each in body_shapes(compiled("capsule")) if each.name.startswith("it")]
    assert sorted(each.form for each in parts) == ["cylinder", "ellipsoid", "ellipsoid"]
    tube = next(each for each in parts if each.form == "cylinder")
    ends = [tube.position + rotation(tube.rotation)[:, 2] * side * 0.3 for side in (1, -1)]
    balls = [each.position for each in parts if each.form == "ellipsoid"]
    np.testing.assert_allclose(balls, ends, atol=1e-15)


def test_a_height_field_is_met_where_the_engine_meets_it() -> None:
    model = compiled("box")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    [field] = [each for each in body_shapes(model) if each.name == "field"]
    corners = field.vertices[field.triangles]
    assert len(corners) == 2 * (3 - 1) * (4 - 1)
    for triangle in corners:
        # A little within the triangle, where one cell alone is met.
        for weights in ([0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]):
            point = np.array(weights) @ triangle
            start, down = np.array([point[0], point[1], 9.0]), np.array([0.0, 0.0, -1.0])
            far = mujoco.mj_rayHfield(model, data, model.geom("field").id, start, down, None)
            assert start[2] - far == pytest.approx(point[2], abs=1e-6)


def test_triangles_of_a_field_face_up() -> None:
    [field] = [each for each in body_shapes(compiled("box")) if each.name == "field"]
    a, b, c = field.vertices[field.triangles].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_a_plane_is_a_thin_box_below_it() -> None:
    model = compiled("box")
    [ground] = [each for each in body_shapes(model) if each.name == "ground"]
    assert ground.form == "box"
    assert ground.position[2] + ground.size[2] / 2 == pytest.approx(-1)
    assert ground.size[1] == 6
    assert ground.size[0] > 2 * model.stat.extent


def test_what_viewers_hide_is_left_out_unless_a_body_has_nothing_else() -> None:
    names = {each.name for each in body_shapes(compiled("box"))}
    assert not names & {"hidden", "clear"}
    assert "proxy" in names


def loop_poses(model: mujoco.MjModel, qpos: Floats) -> Sequence[Floats]:
    found: list[Floats] = []
    for row in qpos:
        data = mujoco.MjData(model)
        data.qpos[:] = row
        mujoco.mj_forward(model, data)
        found.append(np.hstack([data.xpos, data.xquat]))
    return found


def test_poses_are_those_of_the_engine() -> None:
    model = compiled("box")
    qpos = np.random.default_rng(0).standard_normal((9, model.nq))
    positions, rotations = body_poses(model, qpos)
    expected = np.array(loop_poses(model, qpos))
    np.testing.assert_array_equal(np.concatenate([positions, rotations], axis=2), expected)
    for row, body in product(range(len(qpos)), range(model.nbody)):
        assert np.linalg.norm(rotations[row, body]) == pytest.approx(1, abs=1e-14)
