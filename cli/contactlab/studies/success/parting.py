"""The moment when two episodes of the same case part, and the forces on their object then."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.contact_pairs import body_reaches
from contactlab.scene.model_names import name_of
from contactlab.schema.success import PartingForce
from contactlab.store.mcap.trace_reader import StoredTrace


@dataclass(frozen=True)
class PartingMoment:
    """When an object of two episodes is first at different places.

    Attributes:
        time: the moment [s].
        body: the body that parts first.
        distance: the distance that counts [m].
        forces: mean normal forces of pairs just before.
    """

    time: float
    body: str
    distance: float
    forces: tuple[PartingForce, ...]


def find_parting(
    model: mujoco.MjModel,
    bodies: Sequence[int],
    traces: tuple[StoredTrace, StoredTrace],
    pairs: Sequence[str],
) -> PartingMoment | None:
    """Return when bodies of two episodes part; None if they never do while both last.

    The second episode may make several steps for each of the first.
    """
    original, variant = traces
    most_samples, reach_share = 2000, 0.5  # farther than half of the reach of a body is elsewhere
    count = min(len(original.time), most_samples)
    rows = np.unique(np.linspace(0, len(original.time) - 1, count).astype(int))
    rows = rows[original.time[rows] <= variant.time[-1] + np.ptp(original.time[:2]) / 2]
    half_step = np.ptp(variant.time[:2]) / 2
    others = np.searchsorted(variant.time, original.time[rows] - half_step)
    others = np.minimum(others, len(variant.time) - 1)
    apart = np.linalg.norm(
        _find_positions(model, original.qpos[rows], bodies)
        - _find_positions(model, variant.qpos[others], bodies),
        axis=2,
    )
    reach = body_reaches(model)[list(bodies)]
    limits = reach_share * np.where(reach > 0, reach, max(model.stat.meansize, 1e-3))
    beyond = apart > limits
    if not beyond.any():
        return None
    first = int(beyond.any(axis=1).argmax())
    place = int(beyond[first].argmax())
    time = float(original.time[rows[first]])
    forces = [
        PartingForce(
            pair=name,
            written=_mean_force(original, name, time),
            variant=_mean_force(variant, name, time),
        )
        for name in pairs
    ]
    body = name_of(model, "body", bodies[place])
    return PartingMoment(time, body, float(limits[place]), tuple(forces))


def _find_positions(model: mujoco.MjModel, qpos: Floats, bodies: Sequence[int]) -> Floats:
    # (T, B, 3) of configurations (T, nq).
    data, places = mujoco.MjData(model), np.empty((len(qpos), len(bodies), 3))
    for row, values in enumerate(qpos):
        data.qpos[:] = values
        mujoco.mj_kinematics(model, data)
        places[row] = data.xpos[list(bodies)]
    return places


def _mean_force(trace: StoredTrace, name: str, time: float) -> float:
    pair = next(each for each in trace.pairs if each.name == name)
    forces = pair.spread_over_steps(len(trace.time) - 1, pair.normal)
    seconds = 0.02  # of the mean before the moment
    inside = (trace.time[:-1] <= time) & (trace.time[:-1] >= time - seconds)
    return float(forces[inside].mean()) if inside.any() else 0.0
