"""Shapes of a model, and the poses of its bodies in given configurations."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats, Integers

Form = Literal["box", "ellipsoid", "cylinder", "mesh"]


@dataclass(frozen=True)
class BodyShape:
    """A rigid part of a body."""

    name: str  # unique in the model
    body: int  # index of its body
    form: Form  # its kind; a cylinder's axis is its z axis
    size: Floats  # (3,) full extents along its own axes [m]; ones for a mesh
    position: Floats  # (3,) of its center in the body's frame [m]
    rotation: Floats  # (4,) unit quaternion w, x, y, z to the body's frame
    colour: Floats  # (4,) red, green, blue and opacity, 0 to 1
    vertices: Floats  # (V, 3) of a mesh in its own frame [m]; empty for other forms
    triangles: Integers  # (T, 3) indices of a mesh's vertices; empty for other forms


_GEOM_TYPES = mujoco.mjtGeom
# Form of a kind of geom, and the indices of its half sizes along its three axes.
_SOLID_FORMS: dict[int, tuple[Form, list[int]]] = {
    int(_GEOM_TYPES.mjGEOM_SPHERE): ("ellipsoid", [0, 0, 0]),
    int(_GEOM_TYPES.mjGEOM_ELLIPSOID): ("ellipsoid", [0, 1, 2]),
    int(_GEOM_TYPES.mjGEOM_BOX): ("box", [0, 1, 2]),
    int(_GEOM_TYPES.mjGEOM_CYLINDER): ("cylinder", [0, 0, 1]),
    int(_GEOM_TYPES.mjGEOM_CAPSULE): ("cylinder", [0, 0, 1]),
}
_SURFACE_TYPES = {
    int(kind)
    for kind in (_GEOM_TYPES.mjGEOM_MESH, _GEOM_TYPES.mjGEOM_SDF, _GEOM_TYPES.mjGEOM_HFIELD)
}
VISIBLE_GROUPS = 3  # of geoms, from 0: MuJoCo's viewers hide the groups above


def body_poses(model: mujoco.MjModel, qpos: Floats) -> tuple[Floats, Floats]:
    """Return the poses of all B bodies in configurations (F, nq), in the world frame.

    They are positions (F, B, 3) [m] and unit quaternions (F, B, 4) w, x, y, z.
    """
    data = mujoco.MjData(model)
    positions = np.empty((len(qpos), model.nbody, 3))
    rotations = np.empty((len(qpos), model.nbody, 4))
    for row, configuration in enumerate(qpos):
        data.qpos[:] = configuration
        mujoco.mj_kinematics(model, data)
        positions[row], rotations[row] = data.xpos, data.xquat
    return positions, rotations


def drawn_geoms(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return whether each geom is drawn: groups 0 to 2, and other groups where none of these is.

    A geom of another group, such as a collision geom, is drawn if its center lies in no box around
    a geom of groups 0 to 2 of the same rigid body. MuJoCo's viewers hide it, even if the robot has
    no other geoms.
    """
    opaque = np.array([bool(_geom_colour(model, geom)[3]) for geom in range(model.ngeom)], bool)
    is_visible = opaque & (model.geom_group < VISIBLE_GROUPS)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    axes = data.geom_xmat.reshape(-1, 3, 3)
    centres, halves = model.geom_aabb[:, :3], model.geom_aabb[:, 3:]
    middles = data.geom_xpos + np.einsum("gij,gj->gi", axes, centres)
    rigid = model.body_weldid[model.geom_bodyid]
    is_drawn = is_visible.copy()
    for geom in np.flatnonzero(opaque & ~is_visible).tolist():
        others = np.flatnonzero(is_visible & (rigid == rigid[geom]))
        away = np.einsum("gij,gi->gj", axes[others], middles[geom] - data.geom_xpos[others])
        covers = (np.abs(away - centres[others]) <= halves[others]).all(axis=1)
        is_drawn[geom] = not covers.any()
    return is_drawn


def body_shapes(model: mujoco.MjModel) -> tuple[BodyShape, ...]:
    """Return the parts of the drawn geoms."""
    geoms = np.flatnonzero(drawn_geoms(model)).tolist()
    return tuple(shape for geom in geoms for shape in _shapes_of(model, geom))


def _shapes_of(model: mujoco.MjModel, geom: int) -> Iterator[BodyShape]:
    kind, size = int(model.geom_type[geom]), model.geom_size[geom].copy()
    if kind in _SOLID_FORMS:
        form, axes = _SOLID_FORMS[kind]
        yield _geom_shape(model, geom, form, 2 * size[axes])
    if kind == _GEOM_TYPES.mjGEOM_CAPSULE:
        for end, place in (("/top", size[1]), ("/bottom", -size[1])):
            offset = np.array([0.0, 0.0, place])
            yield _geom_shape(model, geom, "ellipsoid", np.full(3, 2 * size[0]), offset, end)
    elif kind == _GEOM_TYPES.mjGEOM_PLANE:
        # A plane is a thin box below it; an infinite one is larger than the scene.
        reach = float(model.stat.extent)
        half = np.where(size[:2] > 0, size[:2], 3 * reach)
        thickness = reach / 100
        below = np.array([0.0, 0.0, -thickness / 2])
        yield _geom_shape(model, geom, "box", np.array([*(2 * half), thickness]), below)
    elif kind in _SURFACE_TYPES:
        read_surface = _height_field_surface if kind == _GEOM_TYPES.mjGEOM_HFIELD else _mesh_surface
        vertices, triangles = read_surface(model, int(model.geom_dataid[geom]))
        plain = _geom_shape(model, geom, "mesh", np.ones(3))
        yield replace(plain, vertices=vertices, triangles=triangles)


def _geom_shape(
    model: mujoco.MjModel,
    geom: int,
    form: Form,
    size: Floats,
    offset: Floats | None = None,
    suffix: str = "",
) -> BodyShape:
    """Return a shape in the geom's frame, or shifted from its center by a vector in that frame."""
    rotation, moved = model.geom_quat[geom].copy(), np.zeros(3)
    if offset is not None:
        mujoco.mju_rotVecQuat(moved, offset, rotation)
    no_vertices = np.empty((0, 3))
    no_triangles = np.empty((0, 3), np.int32)
    return BodyShape(
        name=model.geom(geom).name + suffix,
        body=int(model.geom_bodyid[geom]),
        form=form,
        size=size,
        position=model.geom_pos[geom] + moved,
        rotation=rotation,
        colour=_geom_colour(model, geom),
        vertices=no_vertices,
        triangles=no_triangles,
    )


def _mesh_surface(model: mujoco.MjModel, mesh: int) -> tuple[Floats, Integers]:
    start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    first, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    vertices = model.mesh_vert[start : start + count].astype(np.float64)
    return vertices, model.mesh_face[first : first + faces].copy()


def _height_field_surface(model: mujoco.MjModel, field: int) -> tuple[Floats, Integers]:
    """Return a height field's upper side, each of its cells as two triangles."""
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    start = int(model.hfield_adr[field])
    half_x, half_y, height, _ = model.hfield_size[field]
    y, x = np.meshgrid(
        np.linspace(-half_y, half_y, rows), np.linspace(-half_x, half_x, columns), indexing="ij"
    )
    z = model.hfield_data[start : start + rows * columns] * height
    vertices = np.stack([x.ravel(), y.ravel(), z.astype(np.float64)], axis=1)
    place = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    low, right = place[:-1, :-1].ravel(), place[:-1, 1:].ravel()
    up, far = place[1:, :-1].ravel(), place[1:, 1:].ravel()
    cells = np.stack([low, right, far, low, far, up], axis=1)
    return vertices, cells.reshape(-1, 3)


def _geom_colour(model: mujoco.MjModel, geom: int) -> Floats:
    """Return a geom's color, or its material's if its own is not set."""
    own, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    unset_colour = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)
    if material >= 0 and np.array_equal(own, unset_colour):
        own = model.mat_rgba[material]
    return own.astype(np.float64)
