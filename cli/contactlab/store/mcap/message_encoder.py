"""The arrays of one run as groups of Message records, each of one channel and one length."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import (
    POINT_FIELDS,
    Floats,
    PairSeries,
    PairTrace,
    Trace,
)
from contactlab.store.mcap.record_encoder import (
    Bytes,
    Integers,
    Records,
    Rows,
    Values,
    write_records,
)
from contactlab.store.mcap.trace_messages import (
    contacts_record,
    last_state_record,
    message_head,
    state_record,
)

Times = NDArray[np.uint64]

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
    """Messages of one channel whose records have one length."""

    channel: int  # the channel's id
    rows: Rows  # (m,) state row of each, ascending; at most one message a channel and row
    size: int  # length of a record
    write: Callable[[Bytes, Integers], None]  # writes records to where they start in a buffer


def message_group(records: Records) -> MessageGroup:
    """Return records as messages."""
    write = partial(write_records, records)
    return MessageGroup(records.channel, records.rows, records.layout.size, write)


def single_message(channel: int, row: int, time: int, content: bytes) -> MessageGroup:
    """Return one message."""
    record = message_head(len(content), channel, time) + content

    def write(data: Bytes, starts: Integers) -> None:
        data[starts[0] :][: len(record)] = np.frombuffer(record, np.uint8)

    return MessageGroup(channel, np.array([row]), len(record), write)


def state_values(trace: Trace, times: Times) -> Values:
    """Return what states and steps hold, for runs with (n, N + 1) log times."""
    arrays = {name: getattr(trace, name) for name in ("time", "qpos", "qvel")}
    for name, (field, _) in STEP_ARRAYS.items():
        arrays[f"step.{field}"] = getattr(trace, name)
    for name, field in MOMENTUM_ARRAYS.items():
        momentum = getattr(trace, name)
        nothing = np.empty((trace.runs, trace.steps, 0))
        arrays[f"step.{field}"] = nothing if momentum is None else momentum
    return Values(_head(STATE_CHANNEL, times) | arrays)


def state_records(trace: Trace, values: Values, run: int) -> Iterator[Records]:
    """Yield the state before each step with the step's quantities, then the last state."""
    nq, nv = trace.qpos.shape[2], trace.qvel.shape[2]
    momentum = 0 if trace.momentum is None else 3
    rows = np.arange(trace.steps + 1)
    yield Records(STATE_CHANNEL, rows[:-1], state_record(nq, nv, momentum), values, run)
    yield Records(STATE_CHANNEL, rows[-1:], last_state_record(nq, nv), values, run)


def contact_values(
    channel: int, pair: PairTrace, series: PairSeries, times: Times, timestep: Floats
) -> Values:
    """Return what the contacts of a pair hold, for n runs of these (n,) steps."""
    arrays = {field: getattr(series, name) for name, (field, _) in PAIR_ARRAYS.items()}
    arrays |= derived(series.normal, series.tangential, series.distance, timestep[:, None])
    found = pair.found if pair.slots.shape[2] else series.contacts
    arrays |= {"count": series.contacts, "found": found}
    for name, columns in POINT_FIELDS.items():
        arrays[f"points.{name}"] = pair.slots[..., columns]
    return Values(_head(channel, times) | arrays)


def contact_records(
    channel: int, series: PairSeries, values: Values, run: int
) -> Iterator[Records]:
    """Yield the steps in which a pair touches, grouped by their number of contact points."""
    counts = series.contacts[run]
    for count in np.flatnonzero(np.bincount(counts)).tolist():
        if count:
            rows = np.flatnonzero(counts == count)
            yield Records(channel, rows, contacts_record(count), values, run)


def _head(channel: int, times: Times) -> dict[str, NDArray[Any]]:
    """Return what the heads of a channel's records hold."""
    number = np.broadcast_to(np.uint16(channel), times.shape)
    return {"channel": number, "log_time": times, "publish_time": times}


def derived(
    normal: Floats, tangential: Floats, distance: Floats, timestep: float | Floats
) -> dict[str, Floats]:
    """Return what follows from other values of contacts, by field."""
    with np.errstate(over="ignore", invalid="ignore"):
        return {
            "normal_impulse": normal * timestep,
            "tangential_impulse": tangential * timestep,
            "penetration": np.maximum(0.0 - distance, 0.0),
        }
