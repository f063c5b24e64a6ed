"""A rendered trace, read back: its events, its layout, and the schema of its record."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from contactlab.schema.evidence import LabelEntry
from contactlab.view.drawn_motion import run_events
from contactlab.view.foxglove_files import evidence_schema, message_path
from contactlab.view.render import render_run

Read = Callable[[str], Any]
# What the importers of Foxglove and Lichtblick read of a JSON Schema.
PLAIN = {"boolean", "string", "number", "integer", "object", "array"}


@pytest.fixture
def rendered(drawn: Read, tmp_path: Path) -> Callable[[str], Path]:
    def write(name: str) -> Path:
        run = drawn(name)
        render_run(run.store, run.run, tmp_path / "run.mcap")
        return tmp_path / "run.mcap"

    return write


def said(path: Path) -> dict[str, Any]:
    """Return the last message of each topic that can be decoded."""
    decoder, found = DecoderFactory(), dict[str, Any]()
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            decode = decoder.decoder_for(channel.message_encoding, schema)
            found[channel.topic] = decode(message.data) if decode else json.loads(message.data)
    return found


def panels(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    else:
        assert 0 < node["splitPercentage"] < 100
        yield from panels(node["first"])
        yield from panels(node["second"])


def follow(path: str, messages: dict[str, Any]) -> Any:
    """Return what a message path leads to, by a reader of the few forms that layouts use."""
    topic = next(each for each in messages if path.removeprefix('"').startswith(each))
    field = path.replace(json.dumps(topic), "").removeprefix(topic).removeprefix(".")
    listed, _, rest = field.partition("[:]{name==")
    if not rest:
        return getattr(messages[topic], field)
    name, end = json.JSONDecoder().raw_decode(rest)
    [found] = [each for each in getattr(messages[topic], listed) if each.name == name]
    return getattr(found, rest[end:].removeprefix("}."))


@pytest.mark.parametrize("name", ["ball", "slide", "stack"])
def test_every_panel_of_a_layout_shows_what_the_trace_holds(
    rendered: Callable[[str], Path], name: str
) -> None:
    path = rendered(name)
    layout = json.loads(path.with_suffix(".layout.json").read_text())
    configured, messages = layout["configById"], said(path)
    assert sorted(panels(layout["layout"])) == sorted(configured)
    assert configured["3D!scene"]["topics"].keys() <= messages.keys()
    assert configured["RawMessages!evidence"]["topicPath"] in messages
    plotted = [each["value"] for panel in configured.values() for each in panel.get("paths", ())]
    assert plotted
    for value in plotted:
        assert isinstance(follow(value, messages), float)


def test_topics_of_other_than_plain_characters_are_quoted() -> None:
    assert message_path("/contacts/a-b", "distance") == "/contacts/a-b.distance"
    assert message_path("/contacts/a.b", "distance") == '"/contacts/a.b".distance'


def test_labels_are_events_at_their_steps() -> None:
    entries = [
        LabelEntry(label="tunneling", reason="through", step=3),
        LabelEntry(label="oracle_miss", reason="far off", step=None),
        LabelEntry(label="chatter", reason="often", step=1),
        LabelEntry(label="of_a_plugin", reason="so it says", step=99),
        LabelEntry(label="stable", reason="no other label applies", step=None),
    ]
    time = np.arange(5) / 10
    found = run_events(entries, time)
    assert [(each.row, each.label) for each in found] == [
        *((1, "chatter"), (3, "tunneling")),
        *((4, "oracle_miss"), (4, "of_a_plugin")),
    ]
    assert [each.time for each in found] == time[[1, 3, 4, 4]].tolist()
    assert [each.is_severe for each in found][1]


def test_the_log_holds_the_labels_of_a_run(drawn: Read, rendered: Callable[[str], Path]) -> None:
    run, found = drawn("slide"), []
    failed = [each for each in run.start.record.labels if each.label != "stable"]
    with rendered("slide").open("rb") as file:
        for schema, _, message in make_reader(file).iter_messages(topics=["/events"]):
            assert schema is not None
            decode = DecoderFactory().decoder_for("protobuf", schema)
            assert decode is not None
            found.append((message.log_time, decode(message.data).message))
    events = run_events(run.start.record.labels, run.trace.time)
    assert found == [(round(e.time * 1e9), f"{e.label}: {e.reason}") for e in events]
    assert len(events) == len(failed)


def nodes(node: dict[str, Any]) -> Iterator[dict[str, Any]]:
    yield node
    for each in node.get("properties", {}).values():
        yield from nodes(each)
    if "items" in node:
        yield from nodes(node["items"])


def without_null(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: without_null(each) for key, each in value.items() if each is not None}
    return value


@pytest.mark.long
def test_the_schema_of_a_record_is_read_by_viewers_and_true(
    rendered: Callable[[str], Path],
) -> None:
    path = rendered("ball")
    with path.open("rb") as file:
        [(schema, _, message)] = make_reader(file).iter_messages(topics=["/evidence"])
    assert schema is not None
    assert schema.data == evidence_schema()
    told = json.loads(schema.data)
    for node in nodes(told):
        assert node["type"] in PLAIN
        assert node.keys() <= {"type", "description", "properties", "items"}
    assert {"run_id", "label", "labels", "metrics", "engine"} <= told["properties"].keys()
    jsonschema.validate(without_null(json.loads(message.data)), told)
