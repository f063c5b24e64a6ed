"""Message records back into arrays."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import FOUND, SLOT_WIDTH, Floats
from contactlab.store.mcap.chunks import overlapping
from contactlab.store.mcap.encode import POINT_FIELDS
from contactlab.store.mcap.layout import (
    HEADER_SIZE,
    Layout,
    contacts_record,
    last_state_record,
    state_record,
)
from contactlab.store.mcap.stored import StoredPair

Offsets = NDArray[np.int64]


@dataclass(frozen=True)
class Messages:
    """Message records of one channel, scattered over a buffer.

    Attributes:
        data: (bytes,) the content of all chunks.
        offsets: (M,) where each record starts, in time order.
    """

    data: NDArray[np.uint8]
    offsets: Offsets

    @property
    def sizes(self) -> NDArray[np.int64]:
        """(M,) length of each record, its nine bytes of opcode and length included."""
        lengths = overlapping(self.data, 8)[self.offsets + 1].view("<u8")
        return lengths.astype(np.int64) + 9

    def pick(self, chosen: slice | NDArray[np.bool_], layout: Layout) -> NDArray[np.void]:
        """Return the chosen records, which must all have this layout."""
        items = overlapping(self.data, layout.size)[self.offsets[chosen]]
        return items.view(layout.dtype)

    def blob(self) -> bytes:
        """Return the content of the one message."""
        [start], [size] = self.offsets.tolist(), self.sizes.tolist()
        return self.data[start + HEADER_SIZE : start + size].tobytes()


def state_arrays(messages: Messages, nq: int, nv: int) -> tuple[Mapping[str, Any], NDArray[Any]]:
    """Return the arrays of all states and steps by their names in a trace, and the log times."""
    sizes = messages.sizes
    fitting = [m for m in (0, 3) if np.all(sizes[:-1] == state_record(nq, nv, m).size)]
    if not fitting or sizes[-1] != last_state_record(nq, nv).size:
        raise ValueError(f"a state message does not hold {nq} positions and {nv} velocities")
    stepped = messages.pick(slice(None, -1), state_record(nq, nv, fitting[0]))
    last = messages.pick(slice(-1, None), last_state_record(nq, nv))
    names = ("time", "qpos", "qvel")
    states = {name: np.concatenate((stepped[name], last[name])) for name in names}
    times = np.concatenate((stepped["log_time"], last["log_time"]))
    return states | _step_arrays(stepped["step"], momentum=fitting[0] > 0), times


def _step_arrays(step: NDArray[np.void], *, momentum: bool) -> dict[str, Any]:
    return {
        "kinetic": step["kinetic_energy"].copy(),
        "potential": step["potential_energy"].copy(),
        "contacts": step["contacts"].astype(np.int32),
        "least_distance": step["least_distance"].copy(),
        "iterations": step["solver_iterations"].astype(np.int32),
        "iterations_most": step["solver_iterations_most"].astype(np.int32),
        "momentum": step["linear_momentum"].copy() if momentum else None,
        "spin": step["angular_momentum"].copy() if momentum else None,
    }


def stored_pair(name: str, messages: Messages, times: NDArray[Any]) -> StoredPair:
    """Return a pair's contacts.

    Args:
        name: the pair's name.
        messages: its messages.
        times: (N + 1,) log time of the states.
    """
    counts = _counts(messages.sizes)
    net = np.empty(len(counts), _NET)
    points = np.zeros((counts.sum(), SLOT_WIDTH))
    starts = np.cumsum(counts) - counts
    for count in np.unique(counts).tolist():
        chosen = counts == count
        items = messages.pick(chosen, contacts_record(count))
        for field in _NET.names or ():
            net[field][chosen] = items[field]
        rows = starts[chosen][:, None] + np.arange(count)
        points[rows] = _slots(items)
    steps = np.searchsorted(times, net["log_time"])
    if not np.array_equal(times[steps], net["log_time"]):
        raise ValueError(f"a contact of '{name}' has no state of its time")
    return StoredPair(
        name=name,
        steps=steps.astype(np.int32),
        contacts=counts.astype(np.int32),
        found=net["found"].astype(np.int32),
        mode=net["mode"].astype(np.int8),
        normal=net["normal_force"].copy(),
        tangential=net["tangential_force"].copy(),
        usage=net["friction_usage"].copy(),
        slip=net["slip_speed"].copy(),
        distance=net["distance"].copy(),
        points=points,
    )


def _counts(sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the contact points of messages by their length."""
    none = contacts_record(0).size
    counts, rest = np.divmod(sizes - none, contacts_record(1).size - none)
    if np.any(rest) or np.any(counts < 1):
        raise ValueError("a contact message has another layout")
    return counts


def _slots(items: NDArray[np.void]) -> Floats:
    """(m, count, 23) contact slots of messages with `count` points each."""
    points = items["points"]
    slots = np.empty((*points.shape, SLOT_WIDTH))
    slots[..., FOUND] = items["found"][:, None]
    for name, columns in POINT_FIELDS.items():
        slots[..., columns] = points[name]
    return slots


_NET = np.dtype(
    [
        ("log_time", "u8"),
        ("found", "u4"),
        ("mode", "u1"),
        ("normal_force", "f8"),
        ("tangential_force", "f8"),
        ("friction_usage", "f8"),
        ("slip_speed", "f8"),
        ("distance", "f8"),
    ]
)
