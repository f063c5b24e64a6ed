"""Encodes the arrays of one run as groups of Message records of one channel and one length."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import (
    FOUND,
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
    span_of,
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
    """Messages with records of one length."""

    channels: Rows  # (m,) the id of each one's channel
    rows: Rows  # (m,) its state row; there is at most one message a channel and row
    size: int  # length of a record
    write: Callable[[Bytes, Integers], None]  # writes records at their starts in a buffer


def message_group(records: Records) -> MessageGroup:
    """Return records as messages."""
    write = partial(write_records, records)
    return MessageGroup(records.channels, records.rows, records.layout.size, write)


def single_message(channel: int, row: int, time: int, content: bytes) -> MessageGroup:
    """Return one message."""
    record = message_head(len(content), channel, time) + content

    def write(data: Bytes, starts: Integers) -> None:
        data[starts[0] :][: len(record)] = np.frombuffer(record, np.uint8)

    return MessageGroup(np.array([channel]), np.array([row]), len(record), write)


def state_records(trace: Trace, times: Times, run: int) -> Iterator[Records]:
    """Yield the state before each step with the step's quantities, then the last state.

    Log times (N + 1,) are those of the run.
    """
    nq, nv = trace.qpos.shape[2], trace.qvel.shape[2]
    arrays = {name: getattr(trace, name)[run] for name in ("time", "qpos", "qvel")}
    arrays |= {f"step.{name}": getattr(trace, own)[run] for own, (name, _) in STEP_ARRAYS.items()}
    for own, name in MOMENTUM_ARRAYS.items():
        momentum, nothing = getattr(trace, own), np.empty((trace.steps, 0))
        arrays[f"step.{name}"] = nothing if momentum is None else momentum[run]

    def gather(channels: Rows, rows: Rows) -> dict[str, NDArray[Any]]:
        some = span_of(rows)
        return {path: each[some] for path, each in arrays.items()} | _head_fields(
            channels, times[some]
        )

    rows = np.arange(trace.steps + 1)
    layout = state_record(nq, nv, 0 if trace.momentum is None else 3)
    states = Records(np.full_like(rows, STATE_CHANNEL), rows, layout, gather)
    yield states.select_records(slice(-1))
    yield states.select_records(slice(-1, None))._replace(layout=last_state_record(nq, nv))


def contact_records(
    pairs: Mapping[int, tuple[PairTrace, PairSeries]], times: Times, timestep: float, run: int
) -> Iterator[Records]:
    """Yield the steps with contact, grouped over all pairs by number of contact points.

    Pairs, with their net quantities, are given by the ids of their channels, in order.
    """
    if not pairs:
        return
    ids = np.array([*pairs])

    def of_pairs(name: str) -> NDArray[Any]:
        return np.stack([getattr(series, name)[run] for _, series in pairs.values()])

    counts = of_pairs("contacts")
    arrays = {name: of_pairs(own) for own, (name, _) in PAIR_ARRAYS.items()} | {"count": counts}

    def gather(count: int, channels: Rows, rows: Rows) -> dict[str, NDArray[Any]]:
        where = np.searchsorted(ids, channels), rows
        values = {path: each[where] for path, each in arrays.items()} | _head_fields(
            channels, times[rows]
        )
        net = values["normal_force"], values["tangential_force"], values["distance"]
        firsts = np.flatnonzero(np.diff(channels, prepend=0)).tolist()
        spans = [slice(*ends) for ends in pairwise([*firsts, len(rows)])]
        slots = [
            pairs[int(channels[span.start])][0].slots[run, span_of(rows[span]), :count]
            for span in spans
        ]
        points = np.concatenate(slots)
        values["found"] = points[:, 0, FOUND].astype(np.int32)
        values |= {f"points.{name}": points[..., columns] for name, columns in POINT_FIELDS.items()}
        return values | derived_fields(*net, timestep)

    for count in range(1, counts.max() + 1):
        places, rows = np.nonzero(counts == count)
        if len(rows):
            yield Records(ids[places], rows, contacts_record(count), partial(gather, count))


def _head_fields(channels: Rows, times: Times) -> dict[str, NDArray[Any]]:
    """Return the head fields of records with these (m,) channels and log times."""
    return {"channel": channels, "log_time": times, "publish_time": times}


def derived_fields(
    normal: Floats, tangential: Floats, distance: Floats, timestep: float
) -> dict[str, Floats]:
    """Return the contact values that follow from others, by field."""
    with np.errstate(over="ignore", invalid="ignore"):
        return {
            "normal_impulse": normal * timestep,
            "tangential_impulse": tangential * timestep,
            "penetration": np.maximum(0.0 - distance, 0.0),
        }
