"""Errors of the panel tasks with a scene without oracle."""

import math
from collections.abc import Callable, Mapping

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.measure.oracle_error import middle_axis_flip
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.mcap.trace_reader import StoredTrace


def measure_period_error(angles: Floats, step: float) -> float:
    """Return the error of the period of a rod that swings by .2 at first, of (N + 1,) angles.

    Expected is that of a physical pendulum over Gauss' mean of 1 and the cosine of half of .2.
    """
    crossings = np.flatnonzero((angles[:-1] > 0) & (angles[1:] <= 0))
    exact = crossings + angles[crossings] / (angles[crossings] - angles[crossings + 1])
    inertia, centre = find_rod_inertia(1.0, 0.02)
    small = 2 * math.pi * math.sqrt(inertia / (9.81 * centre))
    one, other = 1.0, math.cos(0.1)
    for _ in range(8):
        one, other = (one + other) / 2, math.sqrt(one * other)
    return float(np.diff(exact).mean()) * step * one / small - 1


def find_rod_inertia(length: float, radius: float) -> tuple[float, float]:
    """Return inertia about its end and center of a capsule of 1 kg, of a length between centers."""
    tube, ends = math.pi * radius**2 * length, 4 / 3 * math.pi * radius**3
    tube, ends = tube / (tube + ends), ends / (tube + ends)
    across = tube * (length**2 / 12 + radius**2 / 4)
    across += ends * (2 / 5 * radius**2 + length**2 / 4 + 3 / 8 * length * radius)
    return across + (length / 2) ** 2, length / 2


def _pendulum_error(trace: StoredTrace, record: EvidenceRecord) -> float:
    del record
    return measure_period_error(trace.qpos[:, 0], float(trace.time[1] - trace.time[0]))


def _gyroscope_error(trace: StoredTrace, record: EvidenceRecord) -> float:
    """Return the error of the time when a free box turns over."""
    del record
    start = trace.qvel[:1, 3:6]
    edges = np.array([0.1, 0.2, 0.3])
    inertia = ((edges**2).sum() - edges**2)[None] / 3
    expected = float(middle_axis_flip(inertia, start)[0])
    about = trace.qvel[:, 4]
    turns = np.flatnonzero(np.sign(about[:-1]) != np.sign(about[1:]))
    if not len(turns):
        return math.inf
    at = int(turns[0])
    share = about[at] / (about[at] - about[at + 1])
    return float(trace.time[at] + share * (trace.time[1] - trace.time[0])) / expected - 1


def _grasp_error(trace: StoredTrace, record: EvidenceRecord) -> float:
    """Return the fall of a held block [m]."""
    del record
    return float(trace.qpos[0, 4] - trace.qpos[-1, 4])


def _stack_error(trace: StoredTrace, record: EvidenceRecord) -> float:
    """Return the error of the load on the lowest contact of a stack; infinite if it fell."""
    if trace.qpos[-1, -5] < 0.9 * trace.qpos[0, -5]:
        return math.inf
    return float(record.metrics["weights_borne"] or 0) / 10 - 1


TASK_ERRORS: Mapping[str, Callable[[StoredTrace, EvidenceRecord], float]] = {
    "pendulum": _pendulum_error,
    "gyroscope": _gyroscope_error,
    "grasp": _grasp_error,
    "stack": _stack_error,
}
"""Error of a run by task, from its trace and record."""
