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
    """
    geoms = sorted({geom for pair in pairs for side in pair.geoms for geom in side})
    places = {geom: place for place, geom in enumerate(geoms)}
    stride = max(1, -(-len(qpos) // _MOST_STATES))
    velocities = _velocities(model, geoms, qpos[::stride], qvel[::stride])
    if mean:
        velocities = velocities.mean(axis=0, keepdims=True)
    turning = np.linalg.norm(velocities[..., :3], axis=2) * [_reach(model, geom) for geom in geoms]
    speeds = np.zeros(len(pairs))
    for index, pair in enumerate(pairs):
        first, second = ([places[geom] for geom in side] for side in pair.geoms)
        apart = velocities[:, first, None, 3:] - velocities[:, None, second, 3:]
        moving = np.linalg.norm(apart, axis=3)
        speeds[index] = (moving + turning[:, first, None] + turning[:, None, second]).max()
    return speeds


def _velocities(model: mujoco.MjModel, geoms: Sequence[int], qpos: Floats, qvel: Floats) -> Floats:
    """Return (N, G, 6) the angular and linear velocities of geoms in the world frame."""
    data = mujoco.MjData(model)
    velocities = np.zeros((len(qpos), len(geoms), 6))
    for row, position, velocity in zip(velocities, qpos, qvel, strict=True):
        data.qpos[:], data.qvel[:] = position, velocity
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        for place, geom in enumerate(geoms):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_GEOM, geom, row[place], 0)
    return velocities


def _reach(model: mujoco.MjModel, geom: int) -> float:
    """Return how far off a geom's centre a ball in it can lie [m]; 0 for a plane."""
    inside = float(model.geom_aabb[geom, 3:].min())
    return max(float(model.geom_rbound[geom]) - inside, 0.0)
