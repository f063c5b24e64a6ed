"""Messages of fixed width as NumPy structured types: constant bytes in a template, values in place.

A repeated field of known count is written packed, also when it is empty, so each message of one
layout has the same length and its fields the same offsets.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import DTypeLike, NDArray

from contactlab.store.mcap.messages import CONTACTS, LAST_STATE, STATE
from contactlab.store.mcap.wire import (
    LENGTH_DELIMITED,
    EnumType,
    Field,
    MessageType,
    Scalar,
    tag,
    varint,
)

_Column = tuple[str, DTypeLike, int]

_FRAME = struct.Struct("<BQ")
_HEADER = (("channel", "<u2", 9), ("log_time", "<u8", 15), ("publish_time", "<u8", 23))
HEADER_SIZE = 31


@dataclass(frozen=True)
class Layout:
    """Fixed bytes, and columns (name, NumPy format, offset) where the values go."""

    template: bytes
    columns: tuple[_Column, ...] = ()

    @property
    def size(self) -> int:
        """Length in bytes."""
        return len(self.template)

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """The structured type whose items lie as this layout says."""
        names, formats, offsets = zip(*self.columns, strict=True) if self.columns else ((), (), ())
        return np.dtype(
            {"names": names, "formats": formats, "offsets": offsets, "itemsize": self.size}
        )

    def after(self, head: bytes) -> "Layout":
        """Return this layout with fixed bytes before it."""
        moved = tuple((name, form, offset + len(head)) for name, form, offset in self.columns)
        return Layout(head + self.template, moved)

    def fill(self, memory: NDArray[np.uint8]) -> NDArray[np.void]:
        """Return memory as items that hold the template; their columns are to be filled."""
        form = f"V{self.size}"
        memory.view(form)[:] = np.frombuffer(self.template, form)
        return memory.view(self.dtype)


def record(body: Layout) -> Layout:
    """Return the MCAP Message record around a message; its sequence number stays zero."""
    head = _FRAME.pack(Opcode.MESSAGE, HEADER_SIZE - _FRAME.size + body.size)
    framed = body.after(head.ljust(HEADER_SIZE, b"\0"))
    return Layout(framed.template, (*_HEADER, *framed.columns))


@cache
def state_record(nq: int, nv: int, momentum: int) -> Layout:
    """Return the record of a state and the step that starts there; `momentum` is 3 or 0."""
    vectors = {"linear_momentum": momentum, "angular_momentum": momentum}
    return record(_message(STATE, {"qpos": nq, "qvel": nv, **vectors}))


@cache
def last_state_record(nq: int, nv: int) -> Layout:
    """Return the record of the state that no step follows."""
    return record(_message(LAST_STATE, {"qpos": nq, "qvel": nv}))


@cache
def contacts_record(points: int) -> Layout:
    """Return the record of one pair's contacts in one step."""
    vectors = ("position", "normal", "tangent", "force", "torque")
    velocities = ("linear_velocity", "angular_velocity")
    return record(
        _message(CONTACTS, dict.fromkeys((*vectors, *velocities), 3) | {"points": points})
    )


def _message(message: MessageType, counts: Mapping[str, int]) -> Layout:
    whole = Layout(b"")
    for field in message.fields:
        part = _field(field, counts).after(whole.template)
        whole = Layout(part.template, (*whole.columns, *part.columns))
    return whole


def _field(field: Field, counts: Mapping[str, int]) -> Layout:
    if isinstance(field.kind, MessageType):
        inner = _message(field.kind, counts)
        head = tag(field.number, LENGTH_DELIMITED) + varint(inner.size)
        if not field.repeated:
            return Layout(inner.template, ((field.name, inner.dtype, 0),)).after(head)
        item, count = inner.after(head), counts[field.name]
        return Layout(item.template * count, ((field.name, (item.dtype, (count,)), 0),))
    if isinstance(field.kind, EnumType):
        return Layout(b"\0", ((field.name, "u1", 0),)).after(tag(field.number, 0))
    return _scalar(field, field.kind, counts)


def _scalar(field: Field, kind: Scalar, counts: Mapping[str, int]) -> Layout:
    _, wire_type, form = kind.value
    width = np.dtype(form).itemsize
    if not field.repeated:
        return Layout(bytes(width), ((field.name, form, 0),)).after(tag(field.number, wire_type))
    count = counts[field.name]
    head = tag(field.number, LENGTH_DELIMITED) + varint(width * count)
    return Layout(bytes(width * count), ((field.name, (form, (count,)), 0),)).after(head)
