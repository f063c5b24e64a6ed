"""The parts of protobuf that a trace needs: varints, tags, and messages described as tables.

Every field has a fixed width once its count is known, so that NumPy can lay out a whole run at
once. Source: https://protobuf.dev/programming-guides/encoding/
"""

from dataclasses import dataclass
from enum import Enum

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
class Field:
    """A field of a message; repeated scalars are packed."""

    number: int
    name: str
    kind: "Scalar | EnumType | MessageType"
    repeated: bool = False


@dataclass(frozen=True)
class MessageType:
    """A protobuf message."""

    name: str
    fields: tuple[Field, ...]


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
