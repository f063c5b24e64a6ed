"""The arrays of one run as groups of Message records, each of one channel and one length."""

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import zstandard
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import (
    FOUND,
    POINT_FIELDS,
    Floats,
    PairSeries,
    PairTrace,
    Trace,
)
from contactlab.store.mcap.trace_messages import (
    MessageLayout,
    constant_record,
    contacts_record,
    last_state_record,
    state_record,
)

# Matches of at least six bytes, found by a table that fits the L1 cache: files of the same size as
# at level -3 in 0.7 (one body) to 0.85 (a stack) of the time. The window is a chunk's length.
_FAST = zstandard.ZstdCompressionParameters(
    strategy=zstandard.STRATEGY_FAST,
    window_log=20,
    hash_log=11,
    chain_log=6,
    search_log=1,
    min_match=6,
    target_length=3,
    write_checksum=True,
)


class Scratch(threading.local):
    """Buffers and a compressor that a thread reuses from run to run.

    The system hands out fresh memory page by page, which takes longer than filling the page;
    without reuse, encoding a file takes one and a half times as long.
    """

    def __init__(self) -> None:
        self._buffers: dict[str, NDArray[np.uint8]] = {}
        self.compressor = zstandard.ZstdCompressor(compression_params=_FAST)

    def take(self, name: str, size: int) -> NDArray[np.uint8]:
        """Return `size` bytes of arbitrary content, valid until the name is taken again."""
        buffer = self._buffers.get(name)
        if buffer is None or len(buffer) < size:
            buffer = self._buffers[name] = np.empty(size, np.uint8)
        return buffer[:size]


SCRATCH = Scratch()

Rows = NDArray[np.intp]
Items = NDArray[np.void]

STATE_CHANNEL = 1

STEP_ARRAYS = {
    "kinetic": ("kinetic_energy", np.float64),
    "potential": ("potential_energy", np.float64),
    "contacts": ("contacts", np.int32),
    "least_distance": ("least_distance", np.float64),
    "iterations": ("solver_iterations", np.int32),
    "iterations_most": ("solver_iterations_most", np.int32),
}
"""Field and type of each array of steps in a message."""
MOMENTUM_ARRAYS = {"momentum": "linear_momentum", "angular_momentum": "angular_momentum"}
PAIR_ARRAYS = {
    "mode": ("mode", np.int8),
    "normal": ("normal_force", np.float64),
    "tangential": ("tangential_force", np.float64),
    "usage": ("friction_usage", np.float64),
    "slip": ("slip_speed", np.float64),
    "distance": ("distance", np.float64),
}
"""Field and type of each array of a pair in its message."""


@dataclass(frozen=True)
class MessageGroup:
    """Message records of one channel and one length, still to be filled."""

    channel: int  # the channel's id
    rows: Rows  # (m,) state row of each record, ascending; at most one record a channel and row
    layout: MessageLayout  # layout of a record
    # Writes the values into (m,) records that hold the layout's template.
    fill: Callable[[Items], None]

    def records(self, times: NDArray[np.uint64]) -> Items:
        """Return the records, given the log time of each state row; valid until the next call."""
        items = self.layout.fill(SCRATCH.take("records", len(self.rows) * self.layout.size))
        items["channel"] = self.channel
        items["log_time"] = items["publish_time"] = times[span_of(self.rows)]
        self.fill(items)
        return items


def single_message(channel: int, row: int, *parts: bytes) -> MessageGroup:
    """Return one message, of which these are the bytes, one part after the other."""
    return MessageGroup(channel, np.array([row]), constant_record(parts), lambda _: None)


def span_of(rows: Rows) -> Rows | slice:
    """Return rows as a slice where they are consecutive, which indexes without a copy."""
    consecutive = len(rows) > 0 and rows[-1] - rows[0] == len(rows) - 1
    return slice(int(rows[0]), int(rows[-1]) + 1) if consecutive else rows


def state_groups(trace: Trace, run: int) -> Iterator[MessageGroup]:
    """Yield the state before each step with the step's quantities, then the last state."""
    nq, nv = trace.qpos.shape[2], trace.qvel.shape[2]
    momentum = 0 if trace.momentum is None else 3
    rows = np.arange(trace.steps + 1)
    stepped, last = slice(0, trace.steps), slice(trace.steps, None)

    def fill(items: Items) -> None:
        _fill_state(trace, run, stepped, items)
        _fill_step(trace, run, items["step"])

    yield MessageGroup(STATE_CHANNEL, rows[stepped], state_record(nq, nv, momentum), fill)
    fill_last = partial(_fill_state, trace, run, last)
    yield MessageGroup(STATE_CHANNEL, rows[last], last_state_record(nq, nv), fill_last)


def _fill_state(trace: Trace, run: int, rows: slice, items: Items) -> None:
    items["time"] = trace.time[run, rows]
    items["qpos"] = trace.qpos[run, rows]
    items["qvel"] = trace.qvel[run, rows]


def _fill_step(trace: Trace, run: int, step: Items) -> None:
    for name, (field, _) in STEP_ARRAYS.items():
        step[field] = getattr(trace, name)[run]
    if trace.momentum is not None:
        for name, field in MOMENTUM_ARRAYS.items():
            step[field] = getattr(trace, name)[run]


def contact_groups(
    channel: int, pair: PairTrace, series: PairSeries, run: int, timestep: float
) -> Iterator[MessageGroup]:
    """Yield the steps in which a pair touches, grouped by their number of contact points."""
    counts, slots = series.contacts[run], pair.slots[run]
    for count in np.flatnonzero(np.bincount(counts)).tolist():
        if count == 0:
            continue
        rows = np.flatnonzero(counts == count)

        def fill(items: Items, rows: Rows = rows, count: int = count) -> None:
            _fill_net(series, run, rows, timestep, items)
            _fill_points(slots[span_of(rows), :count], items)

        yield MessageGroup(channel, rows, contacts_record(count), fill)


def _fill_net(series: PairSeries, run: int, rows: Rows, timestep: float, items: Items) -> None:
    for name, (field, _) in PAIR_ARRAYS.items():
        items[field] = getattr(series, name)[run, rows]
    fill_derived(items, timestep)


def fill_derived(items: Items, timestep: float) -> None:
    """Write what follows from other values of contacts."""
    with np.errstate(over="ignore", invalid="ignore"):
        items["normal_impulse"] = items["normal_force"] * timestep
        items["tangential_impulse"] = items["tangential_force"] * timestep
        items["penetration"] = np.maximum(0.0 - items["distance"], 0.0)


def _fill_points(slots: Floats, items: Items) -> None:
    """Write contact slots (m, count, 23) as the points of m records, in single precision."""
    items["count"] = slots.shape[1]
    items["found"] = slots[:, 0, FOUND]
    points = items["points"]
    with np.errstate(over="ignore"):
        for name, columns in POINT_FIELDS.items():
            points[name] = slots[..., columns]
