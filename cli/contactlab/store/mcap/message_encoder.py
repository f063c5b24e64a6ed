"""Encodes the arrays of one run as groups of Message records of one channel and one length."""

from collections.abc import Callable, Iterator, Mapping
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
    Columns,
    Integers,
    Records,
    Rows,
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


class TraceColumns:
    """The numbers of a trace's messages, computed once for all of its runs.

    Attributes:
        states: those of states and steps.
        contacts: those of pairs that touch; None if none does.
    """

    def __init__(
        self, trace: Trace, times: Times, pairs: Mapping[int, tuple[PairTrace, PairSeries]]
    ) -> None:
        """Take log times (n, N + 1), and pairs with net quantities by channel, in order."""
        arrays = {name: getattr(trace, name) for name in ("time", "qpos", "qvel")}
        arrays |= {f"step.{name}": getattr(trace, own) for own, (name, _) in STEP_ARRAYS.items()}
        for own, name in MOMENTUM_ARRAYS.items():
            momentum, nothing = getattr(trace, own), np.empty((trace.runs, trace.steps, 0))
            arrays[f"step.{name}"] = nothing if momentum is None else momentum
        momenta = 0 if trace.momentum is None else 3
        self._sizes, self._momenta = (trace.qpos.shape[2], trace.qvel.shape[2]), momenta
        self._rows = np.arange(trace.steps + 1)
        self.states = Columns({STATE_CHANNEL: arrays | _head_fields(STATE_CHANNEL, times)})
        self.contacts = Columns(
            {
                channel: _contact_arrays(pair, net, trace.timestep)
                | _head_fields(channel, times[:, :-1])
                for channel, (pair, net) in pairs.items()
            }
        )
        shape = 0, trace.runs, trace.steps
        counts = [net.contacts for _, net in pairs.values()]
        self._counts = np.stack(counts) if counts else np.zeros(shape, np.int32)

    def state_records(self, run: int) -> Iterator[Records]:
        """Yield the state before each step with the step's quantities, then the last state."""
        rows, layout = self._rows, state_record(*self._sizes, self._momenta)
        states = Records(np.full_like(rows, STATE_CHANNEL), rows, layout, self.states, run)
        yield states.select_records(slice(-1))
        last = last_state_record(*self._sizes)
        yield states.select_records(slice(-1, None))._replace(layout=last)

    def contact_records(self, run: int) -> Iterator[Records]:
        """Yield the steps with contact, grouped over all pairs by number of contact points."""
        counts = self._counts[:, run]
        for count in range(1, counts.max(initial=0) + 1):
            places, rows = np.nonzero(counts == count)
            if len(rows):
                ids = self.contacts.ids[places]
                yield Records(ids, rows, contacts_record(count), self.contacts, run)


def _contact_arrays(pair: PairTrace, net: PairSeries, timestep: Floats) -> dict[str, NDArray[Any]]:
    arrays = {name: getattr(net, own) for own, (name, _) in PAIR_ARRAYS.items()}
    arrays |= {"count": net.contacts, "found": pair.found}
    arrays |= {f"points.{name}": pair.slots[..., columns] for name, columns in POINT_FIELDS.items()}
    return arrays | derived_fields(net.normal, net.tangential, net.distance, timestep[:, None])


def _head_fields(channel: int, times: Times) -> dict[str, NDArray[Any]]:
    """Return the head fields of a channel's records with log times (n, rows)."""
    number = np.broadcast_to(np.array(channel, "<u2"), times.shape)
    return {"channel": number, "log_time": times, "publish_time": times}


def derived_fields(
    normal: Floats, tangential: Floats, distance: Floats, timestep: Floats | float
) -> dict[str, Floats]:
    """Return the contact values that follow from others, by field."""
    with np.errstate(over="ignore", invalid="ignore"):
        return {
            "normal_impulse": normal * timestep,
            "tangential_impulse": tangential * timestep,
            "penetration": np.maximum(0.0 - distance, 0.0),
        }
