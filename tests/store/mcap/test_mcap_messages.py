"""Every value of every message, read by readers that are not ours, is the array's value."""

import json
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from tests.written_traces import TraceExtras, write_trace

from contactlab.contact.trace_arrays import PairSeries, Trace
from contactlab.store.mcap import file_parts

MakeTrace = Callable[..., tuple[Trace, list[PairSeries]]]
ExpectedMessages = Callable[..., Iterator[tuple[str, int, dict[str, Any]]]]
Exactly = Callable[[Any], Any]
Found = list[tuple[str, int, dict[str, Any]]]

NAMES = ("floor-ball", "a b/c", "größe%2F")
TOPICS = {
    "/state": "/state",
    "floor-ball": "/contacts/floor-ball",
    "a b/c": "/contacts/a%20b%2Fc",
    "größe%2F": "/contacts/gr%C3%B6%C3%9Fe%252F",
}


def plain(message: Any) -> dict[str, Any]:
    """Return a decoded protobuf message as plain values, fields in the descriptor's order."""
    values: dict[str, Any] = {}
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        if field.message_type is not None and field.is_repeated:
            values[field.name] = [plain(each) for each in value]
        elif field.message_type is not None:
            if message.HasField(field.name):
                values[field.name] = plain(value)
        elif field.enum_type is not None:
            values[field.name] = field.enum_type.values_by_number[value].name
        else:
            values[field.name] = list(value) if field.is_repeated else value
    return values


def read_in_python(path: Path) -> tuple[Found, bytes]:
    """Return the protobuf messages and the evidence."""
    found: Found = []
    evidence = b""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        decoder = DecoderFactory()
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert message.publish_time == message.log_time
            decode = decoder.decoder_for(channel.message_encoding, schema)
            if decode is None:
                evidence = message.data
            else:
                assert evidence == b"", "the evidence is not the last message"
                found.append((channel.topic, message.log_time, plain(decode(message.data))))
    return found, evidence


def with_topics(expected: Iterator[tuple[str, int, dict[str, Any]]]) -> Found:
    return [(TOPICS[name], time, message) for name, time, message in expected]


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(
    sizes=st.fixed_dictionaries(
        {
            "nq": st.integers(0, 9),
            "nv": st.integers(0, 20),
            "pairs": st.lists(st.sampled_from(NAMES), unique=True).map(tuple),
            "slots": st.integers(0, 4),
            "steps": st.integers(0, 8),
            "runs": st.integers(1, 2),
            "momentum": st.booleans(),
            "seed": st.integers(0, 2**32 - 1),
        }
    ),
    chunk_size=st.sampled_from([1, 700, file_parts.CHUNK_SIZE]),
)
def test_python_reads_what_was_recorded(
    *,
    tmp_path_factory: pytest.TempPathFactory,
    make_trace: MakeTrace,
    expected_messages: ExpectedMessages,
    exactly: Exactly,
    extras: TraceExtras,
    sizes: dict[str, Any],
    chunk_size: int,
) -> None:
    trace, series = make_trace(**sizes)
    run = sizes["runs"] - 1
    path = tmp_path_factory.getbasetemp() / "read_in_python.mcap"
    with patch.object(file_parts, "CHUNK_SIZE", chunk_size):
        summary = write_trace(path, trace, run, series, extras)
    found, evidence = read_in_python(path)
    expected = with_topics(expected_messages(trace, run, series))
    assert exactly(found) == exactly(expected)
    assert evidence == extras.record_json
    for topic, count in summary.messages.items():
        said = [each for each in expected if each[0] == topic]
        assert count == (1 if topic == "/evidence" else len(said))
    assert sum(summary.messages.values()) == len(expected) + 1


@pytest.mark.parametrize("momentum", [False, True])
def test_rerun_reads_what_was_recorded(
    *,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    make_trace: MakeTrace,
    expected_messages: ExpectedMessages,
    exactly: Exactly,
    extras: TraceExtras,
    momentum: bool,
) -> None:
    monkeypatch.setenv("RERUN_ANALYTICS", "0")
    rerun = pytest.importorskip("rerun.chunk")
    trace, series = make_trace(pairs=NAMES, steps=60, momentum=momentum)
    path = tmp_path / "trace.mcap"
    with patch.object(file_parts, "CHUNK_SIZE", 5000):
        write_trace(path, trace, 0, series, extras)
    found: Found = []
    for chunk in rerun.McapReader(path, timeline_type="duration_ns").stream():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name.endswith(":message"):
                topic = chunk.entity_path.replace("\\", "")
                times = batch.column("message_log_time").cast("int64").to_pylist()
                messages = [message for [message] in batch.column(name).to_pylist()]
                found += zip([topic] * len(times), times, messages, strict=True)
    expected = with_topics(expected_messages(trace, 0, series))
    by_topic = sorted(columnar(expected), key=lambda each: each[:2])
    assert exactly(sorted(columnar(found), key=lambda each: each[:2])) == exactly(by_topic)


def columnar(value: Any) -> Any:
    """Return a value as Rerun's importer allows it to be compared.

    Absent and empty fields are left out, an enum is its name alone, and zeros have no sign: to the
    importer a negative zero is the default value.
    """
    if isinstance(value, dict):
        if value.keys() == {"name", "value"}:
            return value["name"]
        present = {name: columnar(each) for name, each in value.items() if each is not None}
        return {name: each for name, each in present.items() if each != []}
    if isinstance(value, list | tuple):
        return [columnar(each) for each in value]
    return value if isinstance(value, str) else float(value) + 0


NODE = Path(__file__).parent / "node"


@pytest.mark.long
@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
@pytest.mark.skipif(
    not (NODE / "node_modules").is_dir(), reason=f"`npm install` was not run in {NODE}"
)
@pytest.mark.parametrize("steps", [0, 1, 60])
def test_javascript_reads_what_was_recorded(
    tmp_path: Path,
    make_trace: MakeTrace,
    expected_messages: ExpectedMessages,
    exactly: Exactly,
    extras: TraceExtras,
    steps: int,
) -> None:
    trace, series = make_trace(pairs=NAMES, steps=steps, momentum=True)
    path = tmp_path / "trace.mcap"
    with patch.object(file_parts, "CHUNK_SIZE", 5000):
        write_trace(path, trace, 0, series, extras)
    done = subprocess.run(
        ["node", NODE / "read.mjs", path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    *found, evidence = [
        (each["topic"], int(each["time"]), each["message"]) for each in output["messages"]
    ]
    expected = with_topics(expected_messages(trace, 0, series))
    assert exactly(numbered(found)) == exactly(expected)
    assert evidence[0] == "/evidence"
    assert evidence[2] == json.loads(extras.record_json)
    assert output["attachments"] == {"model.xml": extras.model_xml.decode()}
    assert output["metadata"] == {"contactlab.run": extras.metadata}


def numbered(value: Any) -> Any:
    """Return a value with numbers for the names of those that JSON lacks, and no absent field."""
    if isinstance(value, dict):
        return {name: numbered(each) for name, each in value.items() if each is not None}
    if isinstance(value, list | tuple):
        return [numbered(each) for each in value]
    return float(value) if value in ("NaN", "Infinity", "-Infinity", "-0") else value
