"""Messages described in protobuf's own terms, as MCAP wants them in a schema record.

The field numbers are those of google/protobuf/descriptor.proto.
"""

from collections.abc import Iterator
from functools import cache

from contactlab.store.mcap.messages import PACKAGE
from contactlab.store.mcap.wire import EnumType, Field, MessageType, delimited, tag, varint

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


def _field(field: Field) -> bytes:
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
