"""The parts of protobuf that a trace needs: varints, tags, and messages described as tables.

Every field has a fixed width once its count is known, so that NumPy can lay out a whole run at
once. Source: https://protobuf.dev/programming-guides/encoding/
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from functools import cache
from urllib.parse import quote, unquote

LENGTH_DELIMITED = 2


class Scalar(Enum):
    """A scalar kind: its number in descriptor.proto, its wire type, its NumPy format."""

    DOUBLE = (1, 1, "<f8")
    FLOAT = (2, 5, "<f4")
    FIXED32 = (7, 5, "<u4")


@dataclass(frozen=True)
class EnumType:
    """A protobuf enum; its values must lie in 0..127, one byte on the wire."""

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
    """A protobuf message."""

    name: str
    fields: tuple[MessageField, ...]


def varint(value: int) -> bytes:
    """Return a non-negative integer as a base-128 varint."""
    groups = bytearray()
    while value > 127:
        groups.append(value & 127 | 128)
        value >>= 7
    groups.append(value)
    return bytes(groups)


def tag(number: int, wire_type: int) -> bytes:
    """Return the bytes that announce a field."""
    return varint(number << 3 | wire_type)


def delimited(number: int, content: bytes) -> bytes:
    """Return a length-delimited field: a string, bytes, a message or packed values."""
    return tag(number, LENGTH_DELIMITED) + varint(len(content)) + content


PACKAGE = "contactlab"

STEP = MessageType(
    "Step",
    (
        MessageField(1, "kinetic_energy", Scalar.DOUBLE),
        MessageField(2, "potential_energy", Scalar.DOUBLE),
        MessageField(3, "contacts", Scalar.FIXED32),
        MessageField(4, "least_distance", Scalar.DOUBLE),
        MessageField(5, "solver_iterations", Scalar.FIXED32),
        MessageField(6, "solver_iterations_most", Scalar.FIXED32),
        MessageField(7, "linear_momentum", Scalar.DOUBLE, repeated=True),
        MessageField(8, "angular_momentum", Scalar.DOUBLE, repeated=True),
    ),
)

STATE_FIELDS = (
    MessageField(1, "time", Scalar.DOUBLE),
    MessageField(2, "qpos", Scalar.DOUBLE, repeated=True),
    MessageField(3, "qvel", Scalar.DOUBLE, repeated=True),
)
STATE = MessageType("State", (*STATE_FIELDS, MessageField(4, "step", STEP)))
LAST_STATE = MessageType("State", STATE_FIELDS)

MODE = EnumType("Mode", ("NO_CONTACT", "STICK", "SLIDE"))

POINT = MessageType(
    "ContactPoint",
    (
        MessageField(1, "position", Scalar.FLOAT, repeated=True),
        MessageField(2, "normal", Scalar.FLOAT, repeated=True),
        MessageField(3, "tangent", Scalar.FLOAT, repeated=True),
        MessageField(4, "distance", Scalar.FLOAT),
        MessageField(5, "force", Scalar.FLOAT, repeated=True),
        MessageField(6, "torque", Scalar.FLOAT, repeated=True),
        MessageField(7, "linear_velocity", Scalar.FLOAT, repeated=True),
        MessageField(8, "angular_velocity", Scalar.FLOAT, repeated=True),
    ),
)

CONTACTS = MessageType(
    "Contacts",
    (
        MessageField(1, "count", Scalar.FIXED32),
        MessageField(2, "found", Scalar.FIXED32),
        MessageField(3, "mode", MODE),
        MessageField(4, "normal_force", Scalar.DOUBLE),
        MessageField(5, "tangential_force", Scalar.DOUBLE),
        MessageField(6, "friction_usage", Scalar.DOUBLE),
        MessageField(7, "normal_impulse", Scalar.DOUBLE),
        MessageField(8, "tangential_impulse", Scalar.DOUBLE),
        MessageField(9, "slip_speed", Scalar.DOUBLE),
        MessageField(10, "distance", Scalar.DOUBLE),
        MessageField(11, "penetration", Scalar.DOUBLE),
        MessageField(12, "points", POINT, repeated=True),
    ),
)


STATE_TOPIC = "/state"
EVIDENCE_TOPIC = "/evidence"
_CONTACTS = "/contacts/"


def contacts_topic(pair: str) -> str:
    """Return a pair's topic: bytes other than letters, digits and `_.-~` become %XX."""
    return _CONTACTS + quote(pair, safe="")


def pair_of_topic(topic: str) -> str | None:
    """Return the pair whose contacts a topic holds, or None for another topic."""
    return unquote(topic.removeprefix(_CONTACTS)) if topic.startswith(_CONTACTS) else None


_VARINT = 0
_OPTIONAL, _REPEATED = 1, 3
_TYPE_MESSAGE, _TYPE_ENUM = 11, 14


@cache
def file_descriptor_set(message: MessageType) -> bytes:
    """Return a serialized FileDescriptorSet that defines `message` and all that it uses."""
    types = list(dict.fromkeys(_types(message)))
    file = delimited(1, f"{PACKAGE}/{message.name}.proto".encode()) + delimited(2, PACKAGE.encode())
    for kind in types:
        if isinstance(kind, MessageType):
            file += delimited(4, _message(kind))
    for kind in types:
        if isinstance(kind, EnumType):
            file += delimited(5, _enum(kind))
    return delimited(1, file + delimited(12, b"proto3"))


def _types(kind: MessageType | EnumType) -> Iterator[MessageType | EnumType]:
    yield kind
    if isinstance(kind, MessageType):
        for field in kind.fields:
            if isinstance(field.kind, MessageType | EnumType):
                yield from _types(field.kind)


def _message(message: MessageType) -> bytes:
    fields = b"".join(delimited(2, _field(field)) for field in message.fields)
    return delimited(1, message.name.encode()) + fields


def _field(field: MessageField) -> bytes:
    label = _REPEATED if field.repeated else _OPTIONAL
    head = delimited(1, field.name.encode()) + _number(3, field.number) + _number(4, label)
    if isinstance(field.kind, MessageType | EnumType):
        number = _TYPE_MESSAGE if isinstance(field.kind, MessageType) else _TYPE_ENUM
        type_name = f".{PACKAGE}.{field.kind.name}"
        return head + _number(5, number) + delimited(6, type_name.encode())
    return head + _number(5, field.kind.value[0])


def _enum(enum: EnumType) -> bytes:
    values = b"".join(
        delimited(2, delimited(1, name.encode()) + _number(2, number))
        for number, name in enumerate(enum.values)
    )
    return delimited(1, enum.name.encode()) + values


def _number(field: int, value: int) -> bytes:
    return tag(field, _VARINT) + varint(value)
