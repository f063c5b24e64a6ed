"""The descriptors in a file, the published .proto file and protobuf's own reading agree."""

import re
from typing import Any

import pytest
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from hypothesis import given
from hypothesis import strategies as st

from contactlab.resources import SCHEMAS
from contactlab.store.mcap.trace_messages import (
    CONTACTS,
    HEADER_SIZE,
    STATE,
    MessageType,
    contacts_record,
    contacts_topic,
    encode_tag,
    encode_varint,
    file_descriptor_set,
    pair_of_topic,
    state_record,
)

BLOCK = re.compile(r"^(message|enum) (\w+) \{\n(.*?)^\}", re.MULTILINE | re.DOTALL)
FIELD = re.compile(r"^  (repeated )?(\w+) (\w+) = (\d+);", re.MULTILINE)
VALUE = re.compile(r"^  (\w+) = (\d+);", re.MULTILINE)


def published() -> dict[str, list[tuple[str, ...]]]:
    """Return each type of the .proto file with its lines."""
    text = (SCHEMAS / "contactlab.proto").read_text(encoding="utf-8")
    return {
        name: (FIELD if kind == "message" else VALUE).findall(body)
        for kind, name, body in BLOCK.findall(text)
    }


def shipped(message: MessageType) -> dict[str, list[tuple[str, ...]]]:
    """Return each type of a descriptor set in the same form."""
    [file] = FileDescriptorSet.FromString(file_descriptor_set(message)).file
    assert (file.package, file.syntax) == ("contactlab", "proto3")
    types = {
        each.name: [
            (
                "repeated " if field.label == FieldDescriptorProto.LABEL_REPEATED else "",
                field.type_name.removeprefix(".contactlab.")
                or FieldDescriptorProto.Type.Name(field.type).removeprefix("TYPE_").lower(),
                field.name,
                str(field.number),
            )
            for field in each.field
        ]
        for each in file.message_type
    }
    return types | {
        each.name: [(value.name, str(value.number)) for value in each.value]
        for each in file.enum_type
    }


def test_the_proto_file_says_what_the_descriptors_say() -> None:
    assert published() == shipped(STATE) | shipped(CONTACTS)


@pytest.mark.parametrize("message", [STATE, CONTACTS], ids=lambda message: message.name)
def test_a_descriptor_set_is_as_protobuf_would_write_it(message: MessageType) -> None:
    data = file_descriptor_set(message)
    assert FileDescriptorSet.FromString(data).SerializeToString() == data


def message_class(message: MessageType) -> Any:
    """Return protobuf's own class for a message."""
    pool = DescriptorPool()
    [file] = FileDescriptorSet.FromString(file_descriptor_set(message)).file
    pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(f"contactlab.{message.name}"))


@given(nq=st.integers(0, 300), nv=st.integers(0, 300), momentum=st.sampled_from([0, 3]))
def test_a_state_template_is_a_message_of_zeros(nq: int, nv: int, momentum: int) -> None:
    template = state_record(nq, nv, momentum).template
    message = message_class(STATE).FromString(template[HEADER_SIZE:])
    assert list(message.qpos) == [0.0] * nq
    assert list(message.qvel) == [0.0] * nv
    assert list(message.step.angular_momentum) == [0.0] * momentum
    assert int.from_bytes(template[1:9], "little") == len(template) - 9


@given(points=st.integers(0, 50))
def test_a_contacts_template_has_that_many_points(points: int) -> None:
    template = contacts_record(points).template
    message = message_class(CONTACTS).FromString(template[HEADER_SIZE:])
    assert [list(point.force) for point in message.points] == [[0.0] * 3] * points


@given(value=st.integers(0, 2**40))
def test_varints_and_tags_are_protobufs(value: int) -> None:
    data, decoded = encode_varint(value), 0
    for place, byte in enumerate(data):
        assert (byte > 127) == (place < len(data) - 1)
        decoded |= (byte & 127) << (7 * place)
    assert decoded == value
    assert len(data) == max(1, -(-value.bit_length() // 7))
    assert encode_tag(value, 2) == encode_varint(value * 8 + 2)


@given(pair=st.text(st.characters(exclude_categories=["Cs"])))
def test_topics_name_their_pair(pair: str) -> None:
    topic = contacts_topic(pair)
    assert re.fullmatch(r"/contacts/[A-Za-z0-9_.~%-]*", topic)
    assert pair_of_topic(topic) == pair
    assert pair_of_topic("/state") is None
