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

from contactlab.store.mcap.trace_schema import (
    CONTACTS,
    LAST_STATE,
    LENGTH_DELIMITED,
    STATE,
    EnumType,
    MessageField,
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
class MessageLayout:
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

    def after(self, head: bytes) -> "MessageLayout":
        """Return this layout with fixed bytes before it."""
        moved = tuple((name, form, offset + len(head)) for name, form, offset in self.columns)
        return MessageLayout(head + self.template, moved)

    def fill(self, memory: NDArray[np.uint8]) -> NDArray[np.void]:
        """Return memory as items that hold the template; their columns are to be filled."""
        form = f"V{self.size}"
        memory.view(form)[:] = np.frombuffer(self.template, form)
        return memory.view(self.dtype)


def message_record(body: MessageLayout) -> MessageLayout:
    """Return the MCAP Message record around a message; its sequence number stays zero."""
    head = _FRAME.pack(Opcode.MESSAGE, HEADER_SIZE - _FRAME.size + body.size)
    framed = body.after(head.ljust(HEADER_SIZE, b"\0"))
    return MessageLayout(framed.template, (*_HEADER, *framed.columns))


@cache
def state_record(nq: int, nv: int, momentum: int) -> MessageLayout:
    """Return the record of a state and the step that starts there; `momentum` is 3 or 0."""
    vectors = {"linear_momentum": momentum, "angular_momentum": momentum}
    return message_record(_message(STATE, {"qpos": nq, "qvel": nv, **vectors}))


@cache
def last_state_record(nq: int, nv: int) -> MessageLayout:
    """Return the record of the state that no step follows."""
    return message_record(_message(LAST_STATE, {"qpos": nq, "qvel": nv}))


@cache
def contacts_record(points: int) -> MessageLayout:
    """Return the record of one pair's contacts in one step."""
    vectors = ("position", "normal", "tangent", "force", "torque")
    velocities = ("linear_velocity", "angular_velocity")
    return message_record(
        _message(CONTACTS, dict.fromkeys((*vectors, *velocities), 3) | {"points": points})
    )


def _message(message: MessageType, counts: Mapping[str, int]) -> MessageLayout:
    whole = MessageLayout(b"")
    for field in message.fields:
        part = _field(field, counts).after(whole.template)
        whole = MessageLayout(part.template, (*whole.columns, *part.columns))
    return whole


def _field(field: MessageField, counts: Mapping[str, int]) -> MessageLayout:
    if isinstance(field.kind, MessageType):
        inner = _message(field.kind, counts)
        head = tag(field.number, LENGTH_DELIMITED) + varint(inner.size)
        if not field.repeated:
            return MessageLayout(inner.template, ((field.name, inner.dtype, 0),)).after(head)
        item, count = inner.after(head), counts[field.name]
        return MessageLayout(item.template * count, ((field.name, (item.dtype, (count,)), 0),))
    if isinstance(field.kind, EnumType):
        return MessageLayout(b"\0", ((field.name, "u1", 0),)).after(tag(field.number, 0))
    return _scalar(field, field.kind, counts)


def _scalar(field: MessageField, kind: Scalar, counts: Mapping[str, int]) -> MessageLayout:
    _, wire_type, form = kind.value
    width = np.dtype(form).itemsize
    if not field.repeated:
        return MessageLayout(bytes(width), ((field.name, form, 0),)).after(
            tag(field.number, wire_type)
        )
    count = counts[field.name]
    head = tag(field.number, LENGTH_DELIMITED) + varint(width * count)
    return MessageLayout(bytes(width * count), ((field.name, (form, (count,)), 0),)).after(head)
