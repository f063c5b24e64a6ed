"""Convex hulls of meshes with fewer vertices, within a distance of the original hull."""

from collections.abc import Callable, Iterable

import mujoco
import numpy as np
from scipy.optimize import nnls

from contactlab.contact.trace_arrays import Floats

VERTEX_COUNTS = (8, 12, 16, 24, 32, 48, 64, 96, 128)
"""Numbers of vertices to try."""
Made = Callable[[dict[str, int]], mujoco.MjModel]
"""Compiles a model with at most the given numbers of hull vertices, by mesh name."""


def fewest_vertices(model: mujoco.MjModel, simplify: Made, within: float) -> dict[str, int]:
    """Return the fewest vertices of the colliding hulls within a distance [m], by mesh.

    Meshes whose hull is smallest already, or whose own frame depends on it, are skipped.
    """
    unsimplified = {mesh: hull_vertices(model, mesh) for mesh in colliding_meshes(model)}
    counts = dict[str, int]()
    for count in VERTEX_COUNTS:
        unsimplified = {mesh: own for mesh, own in unsimplified.items() if len(own) > count}
        if not unsimplified:
            break
        smaller = simplify({model.mesh(mesh).name: count for mesh in unsimplified})
        # A mesh without faces equals its hull, so that its inertia would change.
        unsimplified = {
            mesh: own for mesh, own in unsimplified.items() if _is_same_mesh(model, smaller, mesh)
        }
        for mesh, own in list(unsimplified.items()):
            if hull_distance(own, hull_vertices(smaller, mesh)) <= within:
                counts[model.mesh(mesh).name] = count
                del unsimplified[mesh]
    return counts


def _is_same_mesh(model: mujoco.MjModel, other: mujoco.MjModel, mesh: int) -> bool:
    """Return whether a mesh has the same vertices, in its own frame, in both models."""
    one, two = (
        np.concatenate([side.mesh_vert[first : first + count].ravel(), side.mesh_pos[mesh]])
        for side in (model, other)
        for first, count in [(side.mesh_vertadr[mesh], side.mesh_vertnum[mesh])]
    )
    return bool(np.array_equal(one, two))


def colliding_meshes(model: mujoco.MjModel) -> list[int]:
    """Return the ids of meshes whose hulls collide."""
    bits = np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)
    bits[[*model.pair_geom1, *model.pair_geom2]] = 1
    meshes = (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & (bits != 0)
    return sorted(
        {int(mesh) for mesh in model.geom_dataid[meshes] if _graph_address(model, mesh) >= 0}
    )


def _graph_address(model: mujoco.MjModel, mesh: int) -> int:
    return int(model.mesh_graphadr[mesh])


def hull_vertices(model: mujoco.MjModel, mesh: int) -> Floats:
    """Return (N, 3) vertices of a mesh's hull [m]."""
    address = _graph_address(model, mesh)
    count = int(model.mesh_graph[address])
    which = model.mesh_graph[address + 2 + count : address + 2 + 2 * count]
    return np.asarray(model.mesh_vert[model.mesh_vertadr[mesh] + which], float)


def hull_distance(outer: Floats, inner: Floats) -> float:
    """Return how far a hull (N, 3) reaches beyond a hull (K, 3) of some of its vertices [m].

    This is the Hausdorff distance. For convex shapes it is largest at a vertex. The distance of a
    vertex is that to the nearest point w V with weights w >= 0 that sum to 1 (least squares, Lawson
    and Hanson 1974).
    """
    centre = outer.mean(axis=0)
    # The condition that convex weights sum to 1 weighs this much, over the size of the hull.
    heavy = 1e3 * max(float(np.abs(outer - centre).max()), 1e-300)
    rows = np.vstack([(inner - centre).T, np.full(len(inner), heavy)])
    return max(
        (
            _distance_to_hull(rows, vertex, heavy)
            for vertex in _removed_vertices(outer, inner, centre)
        ),
        default=0.0,
    )


def _removed_vertices(outer: Floats, inner: Floats, centre: Floats) -> Iterable[Floats]:
    inner_bytes = {vertex.tobytes() for vertex in inner}
    return (vertex - centre for vertex in outer if vertex.tobytes() not in inner_bytes)


def _distance_to_hull(rows: Floats, vertex: Floats, heavy: float) -> float:
    weights, _ = nnls(rows, np.append(vertex, heavy))
    return float(np.linalg.norm(rows[:3] @ (weights / weights.sum()) - vertex))
