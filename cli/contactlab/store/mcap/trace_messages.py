"""The messages of a trace: their Protobuf types, schemas and topics, and their layout in memory.

The types are read from the published schema, `schemas/contactlab.proto`. Every field has a fixed
width once its count is known, so that NumPy can write a whole run at once: constant bytes are in a
template, values go into the columns of a structured type. A repeated field of known count is
packed, even if it is empty, so messages of one layout have the same length.

Sources: https://protobuf.dev/programming-guides/encoding/, google/protobuf/descriptor.proto for
the numbers in schemas, https://mcap.dev/spec for Message records.
"""

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache, cached_property
from typing import Any, NamedTuple
from urllib.parse import quote, unquote

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import DTypeLike, NDArray

from contactlab.resources import SCHEMAS

PACKAGE = "contactlab"
PROTOBUF = "protobuf"
STATE_TOPIC = "/state"
EVIDENCE_TOPIC = "/evidence"
_CONTACTS_TOPIC = "/contacts/"

_VARINT, _LENGTH_DELIMITED = 0, 2

_MESSAGE_HEAD = struct.Struct("<BQHIQQ")
_HEADER_COLUMNS = (("channel", "<u2", 9), ("log_time", "<u8", 15), ("publish_time", "<u8", 23))
HEADER_SIZE = 31  # length of a Message record before its content
# Fields that follow from others of a record, from its channel or the timestep.
_IMPULSES = ("normal_impulse", "tangential_impulse")
_DERIVED_FIELDS = ("channel", "publish_time", *_IMPULSES, "penetration")


def contacts_topic(pair: str) -> str:
    """Return a pair's topic; bytes other than letters, digits and `_.-~` become %XX."""
    return _CONTACTS_TOPIC + quote(pair, safe="")


def pair_of_topic(topic: str) -> str | None:
    """Return the pair of a contacts topic, or None for another topic."""
    if not topic.startswith(_CONTACTS_TOPIC):
        return None
    return unquote(topic.removeprefix(_CONTACTS_TOPIC))


class Scalar(Enum):
    """A scalar kind: its number in descriptor.proto, its wire type, its NumPy format."""

    DOUBLE = (1, 1, "<f8")
    FLOAT = (2, 5, "<f4")
    FIXED32 = (7, 5, "<u4")


@dataclass(frozen=True)
class EnumType:
    """A Protobuf enum; its values must be in 0..127, one byte on the wire."""

    name: str
    values: tuple[str, ...]


@dataclass(frozen=True)
class MessageField:
    """A field of a message; repeated scalars are packed."""

    number: int
    name: str
    kind: "Scalar | EnumType | MessageType"
    repeated: bool = False


@dataclass(frozen=True)
class MessageType:
    """A Protobuf message."""

    name: str
    fields: tuple[MessageField, ...]


_PROTO_BLOCK = re.compile(r"^(message|enum) (\w+) \{\n(.*?)^\}", re.MULTILINE | re.DOTALL)
_PROTO_FIELD = re.compile(r"^  (repeated )?(\w+) (\w+) = (\d+);", re.MULTILINE)
_PROTO_VALUE = re.compile(r"^  (\w+) = \d+;", re.MULTILINE)
_PUBLISHED = {
    name: (keyword, body)
    for keyword, name, body in _PROTO_BLOCK.findall(
        (SCHEMAS / "contactlab.proto").read_text(encoding="utf-8")
    )
}


def _parse_message(name: str) -> MessageType:
    fields = _PROTO_FIELD.findall(_PUBLISHED[name][1])
    return MessageType(
        name,
        tuple(
            MessageField(int(number), field, _parse_type(kind), bool(repeated))
            for repeated, kind, field, number in fields
        ),
    )


def _parse_type(name: str) -> "Scalar | EnumType | MessageType":
    if name.upper() in Scalar.__members__:
        return Scalar[name.upper()]
    keyword, body = _PUBLISHED[name]
    return (
        EnumType(name, tuple(_PROTO_VALUE.findall(body)))
        if keyword == "enum"
        else _parse_message(name)
    )


STATE, CONTACTS, POINT = map(_parse_message, ("State", "Contacts", "ContactPoint"))
LAST_STATE = MessageType("State", tuple(field for field in STATE.fields if field.name != "step"))


@cache
def file_descriptor_set(message: MessageType) -> bytes:
    """Return a serialized FileDescriptorSet that defines a message and its field types."""
    types = list(dict.fromkeys(_nested_types(message)))
    file = _encode_delimited(1, f"{PACKAGE}/{message.name}.proto".encode())
    file += _encode_delimited(2, PACKAGE.encode())
    for kind in types:
        if isinstance(kind, MessageType):
            fields = b"".join(
                _encode_delimited(2, _field_descriptor(field)) for field in kind.fields
            )
            file += _encode_delimited(4, _encode_delimited(1, kind.name.encode()) + fields)
    for kind in types:
        if isinstance(kind, EnumType):
            values = b"".join(
                _encode_delimited(
                    2, _encode_delimited(1, name.encode()) + _encode_number(2, number)
                )
                for number, name in enumerate(kind.values)
            )
            file += _encode_delimited(5, _encode_delimited(1, kind.name.encode()) + values)
    return _encode_delimited(1, file + _encode_delimited(12, b"proto3"))


def _nested_types(kind: MessageType | EnumType) -> Iterator[MessageType | EnumType]:
    yield kind
    if isinstance(kind, MessageType):
        for field in kind.fields:
            if isinstance(field.kind, MessageType | EnumType):
                yield from _nested_types(field.kind)


def _field_descriptor(field: MessageField) -> bytes:
    optional, repeated = 1, 3  # of descriptor.proto, FieldDescriptorProto.Label
    label = repeated if field.repeated else optional
    head = (
        _encode_delimited(1, field.name.encode())
        + _encode_number(3, field.number)
        + _encode_number(4, label)
    )
    if isinstance(field.kind, Scalar):
        return head + _encode_number(5, field.kind.value[0])
    type_message, type_enum = 11, 14  # of descriptor.proto, FieldDescriptorProto.Type
    number = type_message if isinstance(field.kind, MessageType) else type_enum
    return (
        head
        + _encode_number(5, number)
        + _encode_delimited(6, f".{PACKAGE}.{field.kind.name}".encode())
    )


class FieldPlace(NamedTuple):
    """Location of a field in an item: the type of its numbers, the first byte, and their axes."""

    kind: np.dtype[Any]
    start: int
    shape: tuple[int, ...] = ()
    strides: tuple[int, ...] = ()

    @property
    def starts(self) -> NDArray[np.intp]:
        """First byte of each number."""
        starts = np.array(self.start)
        for count, stride in zip(self.shape, self.strides, strict=True):
            starts = starts[..., None] + np.arange(count) * stride
        return starts.ravel()


@dataclass(frozen=True, eq=False)
class MessageLayout:
    """Constant bytes, and columns (name, NumPy format, offset) for the values."""

    template: bytes
    columns: tuple[tuple[str, DTypeLike, int], ...] = ()

    @property
    def size(self) -> int:
        """Length in bytes."""
        return len(self.template)

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """The structured type of an item with this layout."""
        names, formats, offsets = zip(*self.columns, strict=True) if self.columns else ((), (), ())
        return np.dtype(
            {"names": names, "formats": formats, "offsets": offsets, "itemsize": self.size}
        )

    @cached_property
    def fields(self) -> Mapping[str, FieldPlace]:
        """Locations of values, by the path of their field."""
        return dict(_field_places("", FieldPlace(self.dtype, 0)))

    @cached_property
    def places(self) -> NDArray[np.int64]:
        """(fields, 6) places in records, as record_encoder.c describes them."""
        rows = list[tuple[int, ...]]()
        for field in self.fields.values():
            size, shape, strides, numbers = field.kind.itemsize, field.shape, field.strides, 1
            if shape and strides[-1] == size:
                numbers, shape, strides = shape[-1], shape[:-1], strides[:-1]
            items = *(strides or (0,)), *(shape or (1,))
            rows.append((field.start, *items, numbers, size, field.kind == np.float32))
        return np.array(rows, np.int64)

    @cached_property
    def constant(self) -> NDArray[np.bool_]:
        """(size,) mask of bytes that are the same in all items: template bytes without values."""
        constant = np.ones(self.size, np.bool_)
        for field in self.fields.values():
            for byte in range(field.kind.itemsize):
                constant[field.starts + byte] = False
        return constant

    @cached_property
    def template_bytes(self) -> NDArray[np.uint8]:
        """(size,) bytes of the template."""
        return np.frombuffer(self.template, np.uint8)

    @cached_property
    def mask(self) -> NDArray[np.uint8]:
        """(size,) bytes with all bits set where items are the same, otherwise none."""
        return np.where(self.constant, 0xFF, 0).astype(np.uint8)

    @cached_property
    def values(self) -> Sequence[tuple[int, NDArray[np.intp]]]:
        """Widths of values [bytes], each with the start indices; derived values are excluded."""
        starts = dict[int, list[NDArray[np.intp]]]()
        for path, field in self.fields.items():
            if path not in _DERIVED_FIELDS:
                starts.setdefault(field.kind.itemsize, []).append(field.starts)
        return [(width, np.sort(np.concatenate(places))) for width, places in starts.items()]

    @cached_property
    def packed(self) -> int:
        """Length of these values in bytes."""
        return sum(width * len(starts) for width, starts in self.values)

    def with_head(self, head: bytes) -> "MessageLayout":
        """Return this layout with constant bytes before it."""
        moved = tuple((name, form, offset + len(head)) for name, form, offset in self.columns)
        return MessageLayout(head + self.template, moved)

    def fill_items(self, memory: NDArray[np.uint8]) -> NDArray[np.void]:
        """Return memory as items that hold the template, with columns still to be filled."""
        form = f"V{self.size}"
        memory.view(form)[:] = np.frombuffer(self.template, form)
        return memory.view(self.dtype)


def _field_places(path: str, item: FieldPlace) -> Iterator[tuple[str, FieldPlace]]:
    """Yield the fields of an item of a structured type, by path."""
    for name, (kind, start, *_) in (item.kind.fields or {}).items():
        inner, shape = kind.subdtype or (kind, ())
        axes = item.shape + shape, item.strides + (inner.itemsize,) * len(shape)
        field = FieldPlace(inner, item.start + start, *axes)
        yield from (
            _field_places(f"{path}{name}.", field) if inner.fields else [(path + name, field)]
        )


HEAD = MessageLayout(
    bytes(HEADER_SIZE),
    (("opcode", "u1", 0), ("length", "<u8", 1), ("sequence", "<u4", 11), *_HEADER_COLUMNS),
).dtype
"""The start of any Message record, before its content."""


def message_record(body: MessageLayout) -> MessageLayout:
    """Return the layout of the Message record around a message; its sequence number is zero."""
    framed = body.with_head(message_head(body.size))
    return MessageLayout(framed.template, (*_HEADER_COLUMNS, *framed.columns))


def message_head(size: int, channel: int = 0, time: int = 0) -> bytes:
    """Return the start of a Message record with a content of `size` bytes."""
    frame_size = 9  # opcode and length, that the length does not count
    length = HEADER_SIZE - frame_size + size
    return _MESSAGE_HEAD.pack(Opcode.MESSAGE, length, channel, 0, time, time)


@cache
def state_record(nq: int, nv: int, momentum: int) -> MessageLayout:
    """Return the record of a state and the step that starts there; `momentum` is 3 or 0."""
    vectors = {"linear_momentum": momentum, "angular_momentum": momentum}
    return message_record(_message_layout(STATE, {"qpos": nq, "qvel": nv, **vectors}))


@cache
def last_state_record(nq: int, nv: int) -> MessageLayout:
    """Return the record of the last state, which has no step."""
    return message_record(_message_layout(LAST_STATE, {"qpos": nq, "qvel": nv}))


@cache
def contacts_record(points: int) -> MessageLayout:
    """Return the record of one pair's contacts in one step."""
    vectors = (field.name for field in POINT.fields if field.repeated)
    return message_record(_message_layout(CONTACTS, dict.fromkeys(vectors, 3) | {"points": points}))


def point_counts(sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number of contact points of messages, by the length of their records."""
    none = contacts_record(0).size
    counts, rest = np.divmod(sizes - none, contacts_record(1).size - none)
    if np.any(rest) or np.any(counts < 1):
        raise ValueError("a contact message has another layout")
    return counts


def _message_layout(message: MessageType, counts: Mapping[str, int]) -> MessageLayout:
    layout = MessageLayout(b"")
    for field in message.fields:
        part = _field_layout(field, counts).with_head(layout.template)
        layout = MessageLayout(part.template, (*layout.columns, *part.columns))
    return layout


def _field_layout(field: MessageField, counts: Mapping[str, int]) -> MessageLayout:
    if isinstance(field.kind, MessageType):
        inner = _message_layout(field.kind, counts)
        head = encode_tag(field.number, _LENGTH_DELIMITED) + encode_varint(inner.size)
        if not field.repeated:
            return MessageLayout(inner.template, ((field.name, inner.dtype, 0),)).with_head(head)
        item, count = inner.with_head(head), counts[field.name]
        return MessageLayout(item.template * count, ((field.name, (item.dtype, (count,)), 0),))
    if isinstance(field.kind, EnumType):
        return MessageLayout(b"\0", ((field.name, "u1", 0),)).with_head(
            encode_tag(field.number, _VARINT)
        )
    _, wire_type, form = field.kind.value
    width = np.dtype(form).itemsize
    if not field.repeated:
        scalar = MessageLayout(bytes(width), ((field.name, form, 0),))
        return scalar.with_head(encode_tag(field.number, wire_type))
    count = counts[field.name]
    head = encode_tag(field.number, _LENGTH_DELIMITED) + encode_varint(width * count)
    return MessageLayout(bytes(width * count), ((field.name, (form, (count,)), 0),)).with_head(head)


def encode_varint(value: int) -> bytes:
    """Return a non-negative integer as a base-128 varint."""
    groups = bytearray()
    while value > 127:
        groups.append(value & 127 | 128)
        value >>= 7
    groups.append(value)
    return bytes(groups)


def encode_tag(number: int, wire_type: int) -> bytes:
    """Return the bytes that introduce a field."""
    return encode_varint(number << 3 | wire_type)


def _encode_number(field: int, value: int) -> bytes:
    return encode_tag(field, _VARINT) + encode_varint(value)


def _encode_delimited(number: int, content: bytes) -> bytes:
    """Return a length-delimited field: a string, bytes, a message or packed values."""
    return encode_tag(number, _LENGTH_DELIMITED) + encode_varint(len(content)) + content
