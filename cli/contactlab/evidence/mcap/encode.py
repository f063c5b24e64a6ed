"""The arrays of one run as groups of Message records, each group of one channel and one length."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from contactlab.evidence.mcap.layout import (
    Layout,
    contacts_record,
    last_state_record,
    record,
    state_record,
)
from contactlab.evidence.mcap.scratch import SCRATCH
from contactlab.trace import (
    ANGULAR_VELOCITY,
    DISTANCE,
    FORCE,
    FOUND,
    LINEAR_VELOCITY,
    NORMAL,
    POSITION,
    SLOT_WIDTH,
    TANGENT,
    TORQUE,
    Floats,
    PairSeries,
    PairTrace,
    Trace,
)

Rows = NDArray[np.intp]
Items = NDArray[np.void]

STATE_CHANNEL = 1

POINT_FIELDS = {
    "position": POSITION,
    "normal": NORMAL,
    "tangent": TANGENT,
    "distance": DISTANCE,
    "force": FORCE,
    "torque": TORQUE,
    "linear_velocity": LINEAR_VELOCITY,
    "angular_velocity": ANGULAR_VELOCITY,
}


@dataclass(frozen=True)
class Group:
    """Message records of one channel and one length, still to be filled.

    Attributes:
        channel: the channel's id.
        rows: (m,) state row of each, ascending; at most one record a channel and row.
        layout: how each record lies in memory.
        fill: writes the values into (m,) records that hold the layout's template.
    """

    channel: int
    rows: Rows
    layout: Layout
    fill: Callable[[Items], None]


def state_groups(trace: Trace, run: int) -> Iterator[Group]:
    """Yield the states before each step with what the step measured, then the last state."""
    nq, nv = trace.qpos.shape[2], trace.qvel.shape[2]
    momentum = 0 if trace.momentum is None else 3
    rows = np.arange(trace.steps + 1)
    stepped, last = slice(0, trace.steps), slice(trace.steps, None)

    def fill(items: Items) -> None:
        _fill_state(trace, run, stepped, items)
        _fill_step(trace, run, items["step"])

    yield Group(STATE_CHANNEL, rows[stepped], state_record(nq, nv, momentum), fill)
    fill_last = partial(_fill_state, trace, run, last)
    yield Group(STATE_CHANNEL, rows[last], last_state_record(nq, nv), fill_last)


def _fill_state(trace: Trace, run: int, rows: slice, items: Items) -> None:
    items["time"] = trace.time[run, rows]
    items["qpos"] = trace.qpos[run, rows]
    items["qvel"] = trace.qvel[run, rows]


def _fill_step(trace: Trace, run: int, step: Items) -> None:
    step["kinetic_energy"] = trace.kinetic[run]
    step["potential_energy"] = trace.potential[run]
    step["contacts"] = trace.contacts[run]
    step["least_distance"] = trace.least_distance[run]
    step["solver_iterations"] = trace.iterations[run]
    step["solver_iterations_most"] = trace.iterations_most[run]
    if trace.momentum is not None and trace.spin is not None:
        step["linear_momentum"] = trace.momentum[run]
        step["angular_momentum"] = trace.spin[run]


def contact_groups(
    channel: int, pair: PairTrace, series: PairSeries, run: int, timestep: float
) -> Iterator[Group]:
    """Yield the steps in which a pair touches, those with equally many points together."""
    touching = pair.slots[run, :, :, FOUND] > 0
    counts = np.count_nonzero(touching, axis=1)
    slots = pair.slots[run].reshape(-1, SLOT_WIDTH)
    for count in np.unique(counts[counts > 0]).tolist():
        chosen = counts == count
        rows = np.flatnonzero(chosen)
        places = np.flatnonzero(touching & chosen[:, None]).reshape(len(rows), count)

        def fill(items: Items, rows: Rows = rows, places: Rows = places) -> None:
            _fill_net(series, run, rows, timestep, items)
            _fill_points(slots, places, items)

        yield Group(channel, rows, contacts_record(count), fill)


def _fill_net(series: PairSeries, run: int, rows: Rows, timestep: float, items: Items) -> None:
    normal, tangential = series.normal[run, rows], series.tangential[run, rows]
    distance = series.distance[run, rows]
    items["mode"] = series.mode[run, rows]
    items["normal_force"] = normal
    items["tangential_force"] = tangential
    items["friction_usage"] = series.usage[run, rows]
    items["normal_impulse"] = normal * timestep
    items["tangential_impulse"] = tangential * timestep
    items["slip_speed"] = series.slip[run, rows]
    items["distance"] = distance
    items["penetration"] = np.maximum(0.0 - distance, 0.0)


def _fill_points(slots: Floats, places: Rows, items: Items) -> None:
    memory = SCRATCH.take("points", places.size * SLOT_WIDTH * slots.itemsize)
    points = memory.view(np.float64).reshape(*places.shape, SLOT_WIDTH)
    # Without a mode, NumPy copies once more before it writes to `out`.
    np.take(slots, places, axis=0, out=points, mode="clip")
    items["count"] = places.shape[1]
    items["found"] = points[:, 0, FOUND]
    for name, columns in POINT_FIELDS.items():
        items["points"][name] = points[..., columns]


def blob_group(channel: int, row: int, content: bytes) -> Group:
    """Return one message of ready bytes."""
    return Group(channel, np.array([row]), record(Layout(content)), lambda _: None)
