"""Convex hulls of meshes, as used in collisions."""

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats


def hull_vertices(model: mujoco.MjModel, mesh: int) -> Floats:
    """Return the (n, 3) vertices of a mesh's hull, in the frame of its geoms [m].

    For a mesh without a hull graph, these are all of its vertices.
    """
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    points = np.array(model.mesh_vert[first : first + count], np.float64)
    graph = int(model.mesh_graphadr[mesh])
    if graph < 0:
        return points
    hulled = int(model.mesh_graph[graph])
    return points[model.mesh_graph[graph + 2 + hulled : graph + 2 + 2 * hulled]]


def rotation_matrix(quaternion: Floats) -> Floats:
    """Return the (3, 3) matrix of a unit quaternion."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, quaternion)
    return turn.reshape(3, 3)
