"""Convex hulls of meshes with fewer vertices, within a distance of their own."""

from collections.abc import Callable, Iterable

import mujoco
import numpy as np
from scipy.optimize import nnls

from contactlab.contact.trace_arrays import Floats

COUNTS = (8, 12, 16, 24, 32, 48, 64, 96, 128)
"""Vertices that hulls are tried with."""
_SUM = 1e3
"""Weight of the condition that convex weights add up to 1, over the size of the hull."""
Made = Callable[[dict[str, int]], mujoco.MjModel]
"""Compiles a model whose meshes, by name, have hulls of so many vertices at most."""


def fewer_vertices(model: mujoco.MjModel, made: Made, within: float) -> dict[str, int]:
    """Return the fewest vertices of the hulls that collide, by mesh, within a distance [m].

    Meshes whose hull is as small as can be, or whose own frame hangs on it, are left out.
    """
    left = {mesh: hull(model, mesh) for mesh in colliding(model)}
    found = dict[str, int]()
    for count in COUNTS:
        left = {mesh: own for mesh, own in left.items() if len(own) > count}
        if not left:
            break
        smaller = made({model.mesh(mesh).name: count for mesh in left})
        # A mesh without faces is its hull, whose inertia would be another.
        left = {mesh: own for mesh, own in left.items() if _is_same(model, smaller, mesh)}
        for mesh, own in list(left.items()):
            if hull_distance(own, hull(smaller, mesh)) <= within:
                found[model.mesh(mesh).name] = count
                del left[mesh]
    return found


def _is_same(model: mujoco.MjModel, other: mujoco.MjModel, mesh: int) -> bool:
    """Return whether a mesh has the same vertices, in a frame of its own, in both models."""
    one, two = (
        np.concatenate([made.mesh_vert[first : first + count].ravel(), made.mesh_pos[mesh]])
        for made in (model, other)
        for first, count in [(made.mesh_vertadr[mesh], made.mesh_vertnum[mesh])]
    )
    return bool(np.array_equal(one, two))


def colliding(model: mujoco.MjModel) -> list[int]:
    """Return the meshes whose hulls collide, by id."""
    bits = np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)
    bits[[*model.pair_geom1, *model.pair_geom2]] = 1
    meshes = (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & (bits != 0)
    return sorted({int(mesh) for mesh in model.geom_dataid[meshes] if _graph(model, mesh) >= 0})


def _graph(model: mujoco.MjModel, mesh: int) -> int:
    return int(model.mesh_graphadr[mesh])


def hull(model: mujoco.MjModel, mesh: int) -> Floats:
    """Return (N, 3) vertices of a mesh's hull [m]."""
    address = _graph(model, mesh)
    count = int(model.mesh_graph[address])
    which = model.mesh_graph[address + 2 + count : address + 2 + 2 * count]
    return np.asarray(model.mesh_vert[model.mesh_vertadr[mesh] + which], float)


def hull_distance(outer: Floats, inner: Floats) -> float:
    """Return how far a hull (N, 3) reaches beyond another (K, 3) of some of its vertices [m].

    The Hausdorff distance of both: of convex shapes it is largest at a vertex, whose distance is
    that of the nearest point w V with weights w >= 0 that add up to 1 (least squares, Lawson and
    Hanson 1974).
    """
    centre = outer.mean(axis=0)
    heavy = _SUM * max(float(np.abs(outer - centre).max()), 1e-300)
    rows = np.vstack([(inner - centre).T, np.full(len(inner), heavy)])
    return max(
        (_distance(rows, vertex, heavy) for vertex in _others(outer, inner, centre)), default=0.0
    )


def _others(outer: Floats, inner: Floats, centre: Floats) -> Iterable[Floats]:
    kept = {vertex.tobytes() for vertex in inner}
    return (vertex - centre for vertex in outer if vertex.tobytes() not in kept)


def _distance(rows: Floats, vertex: Floats, heavy: float) -> float:
    weights, _ = nnls(rows, np.append(vertex, heavy))
    return float(np.linalg.norm(rows[:3] @ (weights / weights.sum()) - vertex))
