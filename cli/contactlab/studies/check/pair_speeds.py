"""How fast the geoms of monitored pairs move against each other."""

from collections.abc import Sequence

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.contact_pairs import MonitoredPair

_MOST_STATES = 5000


def pair_speeds(
    model: mujoco.MjModel,
    pairs: Sequence[MonitoredPair],
    qpos: Floats,
    qvel: Floats,
    *,
    mean: bool = False,
    step: float = 1e9,
) -> Floats:
    """Return (P,) a bound on how fast the geoms of each pair move against each other [m/s].

    The relative speed of their centres, and for the rotation of each its angular speed times how
    far off its centre a ball of its least half extent can lie: a sphere that spins goes nowhere.

    Args:
        model: the run's model.
        pairs: the pairs.
        qpos: (N, nq) configurations; of more than 5000, an evenly spaced part counts.
        qvel: (N, nv) velocities.
        mean: whether of the mean velocities, where what only shakes is at rest; else the largest.
        step: length of a step [s]; states count whose bounding spheres can meet within it.
    """
    geoms = sorted({geom for pair in pairs for side in pair.geoms for geom in side})
    places = {geom: place for place, geom in enumerate(geoms)}
    stride = max(1, -(-len(qpos) // _MOST_STATES))
    centres, velocities = _motion(model, geoms, qpos[::stride], qvel[::stride])
    if mean:
        centres, velocities = (each.mean(axis=0, keepdims=True) for each in (centres, velocities))
    planes = np.asarray(model.geom_type)[geoms] == int(mujoco.mjtGeom.mjGEOM_PLANE)
    bounds = np.where(planes, np.inf, np.asarray(model.geom_rbound)[geoms])
    turning = np.linalg.norm(velocities[..., :3], axis=2) * [_reach(model, geom) for geom in geoms]
    speeds = np.zeros(len(pairs))
    for index, pair in enumerate(pairs):
        first, second = ([places[geom] for geom in side] for side in pair.geoms)
        apart = velocities[:, first, None, 3:] - velocities[:, None, second, 3:]
        moving = np.linalg.norm(apart, axis=3)
        speed = moving + turning[:, first, None] + turning[:, None, second]
        gap = np.linalg.norm(centres[:, first, None] - centres[:, None, second], axis=3)
        near = gap - bounds[first][:, None] - bounds[second] <= speed * step
        speeds[index] = (speed * near).max()
    return speeds


def _motion(
    model: mujoco.MjModel, geoms: Sequence[int], qpos: Floats, qvel: Floats
) -> tuple[Floats, Floats]:
    """Return (N, G, 3) centres of geoms, and (N, G, 6) angular and linear velocities, all world."""
    data = mujoco.MjData(model)
    centres, velocities = np.zeros((len(qpos), len(geoms), 3)), np.zeros((len(qpos), len(geoms), 6))
    for place, row, position, velocity in zip(centres, velocities, qpos, qvel, strict=True):
        data.qpos[:], data.qvel[:] = position, velocity
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        place[:] = data.geom_xpos[list(geoms)]
        for out, geom in zip(row, geoms, strict=True):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_GEOM, geom, out, 0)
    return centres, velocities


def _reach(model: mujoco.MjModel, geom: int) -> float:
    """Return how far off a geom's centre a ball in it can lie [m]; 0 for a plane."""
    inside = float(model.geom_aabb[geom, 3:].min())
    return max(float(model.geom_rbound[geom]) - inside, 0.0)
