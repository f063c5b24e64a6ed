"""Distances between configurations and between invariants, and their summary over a run."""

from typing import NamedTuple

import numpy as np

from contactlab.contact.rotations import angles_between
from contactlab.contact.trace_arrays import Floats, Invariants
from contactlab.contact.trace_setup import Joints

_LENGTH = 1e-3


class Discrepancy(NamedTuple):
    """Summary of distances over time: at the last time, the mean, and the largest."""

    final: float
    mean: float
    peak: float

    @classmethod
    def of(cls, distances: Floats) -> "Discrepancy":
        """Summarize (T,) distances."""
        return cls(float(distances[-1]), float(distances.mean()), float(distances.max()))


def distances(joints: Joints, first: Floats, second: Floats) -> Floats:
    """Return (T,) distances [m] between configurations (T, nq): the largest of any joint.

    Slides and free positions count in metres. A hinge counts its angle times the length of its
    degree of freedom. A rotation counts the angle of the one that leads from the first to the
    second, the norm of the quaternion's logarithm, times that length.
    """
    scalars = list(joints.scalars)
    parts = [np.abs(first[:, scalars] - second[:, scalars]) * joints.lengths]
    for place in joints.points:
        apart = first[:, place : place + 3] - second[:, place : place + 3]
        parts.append(np.linalg.norm(apart, axis=1)[:, None])
    for place, reach in zip(joints.rotations, joints.reaches, strict=True):
        turn = angles_between(first[:, place : place + 4], second[:, place : place + 4])
        parts.append((turn * reach)[:, None])
    return np.concatenate(parts, axis=1).max(axis=1, initial=0.0)


def drifts(run: Invariants, reference: Invariants) -> Floats:
    """Return (T,) largest relative deviation of a run's energy and momenta from the reference's.

    Energy is taken as a share of the reference's peak kinetic energy K, which counts as at least
    what lifts everything by 1 mm; momentum as a share of sqrt(2 m K); angular momentum as a share
    of its largest magnitude, which counts as at least 1 mm times sqrt(2 m K).
    """
    scale = max(float(reference.kinetic.max()), reference.lift, float(np.finfo(float).tiny))
    parts = [np.abs(run.energy - reference.energy) / scale]
    push = np.sqrt(2 * reference.mass * scale)
    if run.momentum is not None and reference.momentum is not None:
        parts.append(np.linalg.norm(run.momentum - reference.momentum, axis=1) / push)
    if run.angular_momentum is not None and reference.angular_momentum is not None:
        most = float(np.linalg.norm(reference.angular_momentum, axis=1).max())
        parts.append(
            np.linalg.norm(run.angular_momentum - reference.angular_momentum, axis=1)
            / max(most, _LENGTH * push)
        )
    return np.maximum.reduce(parts)
