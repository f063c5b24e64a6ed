"""Writes files that Foxglove and Lichtblick need with a trace: a layout, a schema of `/evidence`.

Source: layouts as the apps export them; message paths at
https://docs.foxglove.dev/docs/visualization/message-path-syntax.
"""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.atomic_files import atomic_write
from contactlab.store.mcap.trace_messages import EVIDENCE_TOPIC, contacts_topic
from contactlab.view.drawn_motion import BodyMotion

Node = dict[str, Any]

EVENTS, JOINTS = "/events", "/joints"
SCENE, FORCES = "/scene", "/contact_forces"
_PLAIN_TOPIC = re.compile(r"[\w/-]+", re.ASCII)
PLOTS = {
    "Normal force [N]": "normal_force",
    "Tangential force [N]": "tangential_force",
    "Penetration [m]": "penetration",
    "Slip speed [m/s]": "slip_speed",
}
# Types of a schema that viewers read: https://docs.foxglove.dev/docs/sdk/schemas.
_VIEWED_TYPES = ("boolean", "string", "number", "integer")


def layout_file(target: Path) -> Path:
    """Return the path of the layout of a trace file, in the same folder."""
    return target.with_suffix(".layout.json")


def write_layout(path: Path, motion: BodyMotion) -> None:
    """Write a layout that shows the scene, its events, and plots of its pairs and joints."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(viewer_layout(motion), indent=2) + "\n")


def viewer_layout(motion: BodyMotion) -> Node:
    """Return the layout that Foxglove and Lichtblick import for a motion with its layer."""
    topics = {pair: contacts_topic(pair) for pair in motion.pairs}
    plots: Node = {}
    for title, field in PLOTS.items() if topics else ():
        paths = {pair: message_path(topic, field) for pair, topic in topics.items()}
        plots[f"Plot!{field}"] = _plot_panel(title, paths)
    most_joints = 8
    joints = motion.joints.names[:most_joints]
    if joints:
        paths = {
            name: f"{JOINTS}.joints[:]{{name=={json.dumps(name)}}}.position" for name in joints
        }
        plots["Plot!joints"] = _plot_panel("Joints [m, rad]", paths)
    x, y, z = motion.centre.tolist()
    panels = {
        "3D!scene": {
            "followTf": motion.bodies[0],
            "followMode": "follow-none",
            "cameraState": {
                "distance": 2.7 * motion.radius,
                "perspective": True,
                "phi": 72,
                "thetaOffset": 30,
                "target": [x, y, z],
                "targetOffset": [0, 0, 0],
                "targetOrientation": [0, 0, 0, 1],
                "fovy": 45,
                "near": motion.radius / 100,
                "far": 1000 * motion.radius,
            },
            "topics": {SCENE: {"visible": True}, FORCES: {"visible": True}},
        },
        "Log!events": {"topicToRender": EVENTS, "minLogLevel": 1},
        "RawMessages!evidence": {"topicPath": EVIDENCE_TOPIC},
        **plots,
    }
    below = _split_panels("row", "Log!events", "RawMessages!evidence", 50)
    left = _split_panels("column", "3D!scene", below, 70)
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split_panels("row", left, _stack_panels(list(plots)), 58) if plots else left,
    }


def _plot_panel(title: str, paths: Mapping[str, str]) -> Node:
    series = [
        {"value": path, "label": name, "enabled": True, "timestampMethod": "receiveTime"}
        for name, path in paths.items()
    ]
    return {"title": title, "paths": series, "xAxisVal": "timestamp", "showLegend": True}


def message_path(topic: str, field: str) -> str:
    """Return the path of a topic's field; topics with other than plain characters are quoted."""
    return f"{topic if _PLAIN_TOPIC.fullmatch(topic) else json.dumps(topic)}.{field}"


def _stack_panels(panels: list[str]) -> str | Node:
    """Return panels below each other, all of the same height."""
    first, *others = panels
    return (
        _split_panels("column", first, _stack_panels(others), 100 / len(panels))
        if others
        else first
    )


def _split_panels(direction: str, first: str | Node, second: str | Node, share: float) -> Node:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": share}


def evidence_schema() -> bytes:
    """Return the JSON Schema of `/evidence` as viewers read it: no references, unions or null.

    A property with values of several types is omitted; viewers show it nevertheless. A record has
    null for a missing value.
    """
    schema = EvidenceRecord.model_json_schema(mode="serialization")
    plain = _viewed_schema(schema, schema.get("$defs", {}))
    assert plain is not None, "a record is an object"
    return json.dumps(plain).encode()


def _viewed_schema(node: Node, definitions: Mapping[str, Node]) -> Node | None:
    """Return a schema without references and null; None if its values are of several types."""
    if "$ref" in node:
        return _viewed_schema(definitions[node["$ref"].rpartition("/")[2]], definitions)
    if "anyOf" in node:
        some = [option for option in node["anyOf"] if option.get("type") != "null"]
        return _viewed_schema(some[0], definitions) if len(some) == 1 else None
    kind = node.get("type", "string" if "const" in node or "enum" in node else None)
    typed = {"type": kind, **{key: node[key] for key in ("description",) if key in node}}
    if kind == "object":
        parts = {
            n: _viewed_schema(part, definitions) for n, part in node.get("properties", {}).items()
        }
        return {**typed, "properties": {n: part for n, part in parts.items() if part is not None}}
    if kind == "array":
        first = node.get("items") or next(iter(node.get("prefixItems", [])), {})
        items = _viewed_schema(first, definitions) if isinstance(first, dict) else None
        return None if items is None else {**typed, "items": items}
    return typed if kind in _VIEWED_TYPES else None
