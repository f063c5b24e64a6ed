"""How fast the surfaces of graded pairs move against each other."""

from collections.abc import Sequence

import mujoco
import numpy as np

from contactlab.contact import Floats
from contactlab.scene import MonitoredPair

_MOST_STATES = 5000


def pair_speeds(
    model: mujoco.MjModel, pairs: Sequence[MonitoredPair], qpos: Floats, qvel: Floats
) -> Floats:
    """Return (P,) a bound on how fast the geoms of each pair move against each other [m/s].

    The speed of their centres, and for the turning of each its angular speed times the farthest
    that a ball of its least half extent lies off its centre: a sphere that spins goes nowhere.

    Args:
        model: the run's model.
        pairs: the pairs.
        qpos: (N, nq) configurations; of more than 5000, every few.
        qvel: (N, nv) velocities.
    """
    geoms = sorted({geom for pair in pairs for side in pair.geoms for geom in side})
    places = {geom: place for place, geom in enumerate(geoms)}
    reach = np.array([_reach(model, geom) for geom in geoms])
    data = mujoco.MjData(model)
    speeds = np.zeros(len(pairs))
    stride = max(1, -(-len(qpos) // _MOST_STATES))
    velocity = np.zeros((len(geoms), 6))
    sides = [[[places[geom] for geom in side] for side in pair.geoms] for pair in pairs]
    for row in range(0, len(qpos), stride):
        data.qpos[:], data.qvel[:] = qpos[row], qvel[row]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        for place, geom in enumerate(geoms):
            kind = mujoco.mjtObj.mjOBJ_GEOM
            mujoco.mj_objectVelocity(model, data, kind, geom, velocity[place], 0)
        turning = np.linalg.norm(velocity[:, :3], axis=1) * reach
        for index, (first, second) in enumerate(sides):
            apart = velocity[first, None, 3:] - velocity[None, second, 3:]
            moving = np.linalg.norm(apart, axis=2)
            total = moving + turning[first][:, None] + turning[None, second]
            speeds[index] = max(speeds[index], float(total.max()))
    return speeds


def _reach(model: mujoco.MjModel, geom: int) -> float:
    """Return how far off a geom's centre a ball in it can lie [m]; 0 for a plane."""
    inside = float(model.geom_aabb[geom, 3:].min())
    return max(float(model.geom_rbound[geom]) - inside, 0.0)
