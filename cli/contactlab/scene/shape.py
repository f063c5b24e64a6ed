"""Volumes and extents of a body's geoms, which is what its inertia can be held against."""

import math
from collections.abc import Callable

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from contactlab.contact import Floats

_GEOM = mujoco.mjtGeom


def solid_geoms(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the geoms of a body that have a volume: those that touch if any, else all."""
    geoms: list[int] = np.flatnonzero(model.geom_bodyid == body).tolist()
    solid = [geom for geom in geoms if int(model.geom_type[geom]) in _VOLUMES]
    touching = [geom for geom in solid if model.geom_contype[geom] or model.geom_conaffinity[geom]]
    return touching or solid


def volume(model: mujoco.MjModel, geom: int) -> float:
    """Return the volume of a geom [m^3], of a mesh that of its convex hull."""
    kind = int(model.geom_type[geom])
    points = _points(model, geom) if kind in _MESHES else np.array(model.geom_size[geom])
    return _VOLUMES[kind](points)


def extent(model: mujoco.MjModel, body: int, direction: Floats) -> tuple[float, float]:
    """Return from where to where a body's geoms reach along a unit vector of its frame [m]."""
    spans = [
        _span(model, geom, direction)
        for geom in np.flatnonzero(model.geom_bodyid == body).tolist()
        if int(model.geom_type[geom]) in _VOLUMES
    ]
    return min(low for low, _ in spans), max(high for _, high in spans)


def _span(model: mujoco.MjModel, geom: int, direction: Floats) -> tuple[float, float]:
    kind, size = int(model.geom_type[geom]), np.array(model.geom_size[geom])
    local = rotation(model.geom_quat[geom]).T @ direction
    centre = float(model.geom_pos[geom] @ direction)
    if kind in _MESHES:
        along = _points(model, geom) @ local
        return centre + float(along.min()), centre + float(along.max())
    reach = _REACHES[kind](size, np.abs(local))
    return centre - reach, centre + reach


def rotation(quaternion: Floats) -> Floats:
    """Return the (3, 3) matrix of a unit quaternion."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.array(quaternion))
    return matrix.reshape(3, 3)


def _points(model: mujoco.MjModel, geom: int) -> Floats:
    mesh = int(model.geom_dataid[geom])
    first = int(model.mesh_vertadr[mesh])
    return np.array(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])], np.float64)


def _hull_volume(points: Floats) -> float:
    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        return 0.0


def _sphere(size: Floats) -> float:
    return 4 / 3 * math.pi * float(size[0]) ** 3


def _cylinder(size: Floats) -> float:
    return 2 * math.pi * float(size[0]) ** 2 * float(size[1])


_MESHES = {int(_GEOM.mjGEOM_MESH), int(_GEOM.mjGEOM_SDF)}
# Of the sizes of a geom, or of the points of a mesh.
_VOLUMES: dict[int, Callable[[Floats], float]] = {
    int(_GEOM.mjGEOM_SPHERE): _sphere,
    int(_GEOM.mjGEOM_CAPSULE): lambda size: _sphere(size) + _cylinder(size),
    int(_GEOM.mjGEOM_CYLINDER): _cylinder,
    int(_GEOM.mjGEOM_BOX): lambda size: 8 * float(size.prod()),
    int(_GEOM.mjGEOM_ELLIPSOID): lambda size: 4 / 3 * math.pi * float(size.prod()),
    **dict.fromkeys(_MESHES, _hull_volume),
}
# Of the sizes of a geom and the magnitudes of a direction in its frame.
_REACHES: dict[int, Callable[[Floats, Floats], float]] = {
    int(_GEOM.mjGEOM_SPHERE): lambda size, _: float(size[0]),
    int(_GEOM.mjGEOM_CAPSULE): lambda size, along: size[0] + size[1] * along[2],
    int(_GEOM.mjGEOM_CYLINDER): lambda size, along: (
        size[0] * math.hypot(along[0], along[1]) + size[1] * along[2]
    ),
    int(_GEOM.mjGEOM_BOX): lambda size, along: float(size @ along),
    int(_GEOM.mjGEOM_ELLIPSOID): lambda size, along: float(np.linalg.norm(size * along)),
}
