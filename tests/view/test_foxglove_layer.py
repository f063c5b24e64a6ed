"""The 3D layer, read by readers that are not ours, says what the motion says."""

import json
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from tests.written_traces import TraceExtras, assert_viewable, write_trace

from contactlab.contact.trace_arrays import PairSeries, Trace
from contactlab.palette import MODE_COLOURS
from contactlab.store.mcap.trace_reader import read_trace
from contactlab.view.drawn_motion import BodyMotion
from contactlab.view.drawn_shapes import BodyShape
from contactlab.view.foxglove_layer import write_with_layer

MakeTrace = Callable[..., tuple[Trace, list[PairSeries]]]
MakeMotion = Callable[..., BodyMotion]
Found = dict[str, list[tuple[int, Any]]]

LAYER = {"/scene", "/tf", "/contact_forces", "/joints", "/events"}
NODE = Path(__file__).parents[1] / "store" / "mcap" / "node"


def read(path: Path) -> Found:
    """Return time and decoded message of every message, by topic."""
    found: Found = {}
    with path.open("rb") as file:
        decoder = DecoderFactory()
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            decode = decoder.decoder_for(channel.message_encoding, schema)
            said = decode(message.data) if decode else message.data
            found.setdefault(channel.topic, []).append((message.log_time, said))
    return found


def raw(path: Path) -> list[tuple[str, int, bytes]]:
    """Return topic, time and bytes of every message that is not of the layer."""
    with path.open("rb") as file:
        messages = make_reader(file).iter_messages()
        return [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in messages
            if channel.topic not in LAYER
        ]


def vector(message: Any) -> list[float]:
    return [message.x, message.y, message.z]


def wxyz(message: Any) -> list[float]:
    return [message.w, message.x, message.y, message.z]


def turned(quaternion: Any, point: Any) -> Any:
    """Return a point turned by a unit quaternion w, x, y, z, by its rotation matrix."""
    w, x, y, z = quaternion
    matrix = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(matrix) @ np.array(point)


def assert_transforms(found: Found, motion: BodyMotion) -> None:
    assert len(found["/tf"]) == len(motion.rows)
    for frame, (time, message) in enumerate(found["/tf"]):
        assert time == round(motion.time[frame] * 1e9)
        for body, each in enumerate(message.transforms, start=1):
            assert (each.parent_frame_id, each.child_frame_id) == ("world", motion.bodies[body])
            assert each.timestamp.seconds * 10**9 + each.timestamp.nanos == time
            assert vector(each.translation) == motion.positions[frame, body].tolist()
            assert wxyz(each.rotation) == motion.rotations[frame, body].tolist()
        assert len(message.transforms) == len(motion.bodies) - 1


def assert_primitive(primitive: Any, shape: BodyShape) -> None:
    colour = primitive.color
    assert vector(primitive.pose.position) == shape.position.tolist()
    assert wxyz(primitive.pose.orientation) == shape.rotation.tolist()
    assert [colour.r, colour.g, colour.b, colour.a] == shape.colour.tolist()
    if shape.form == "mesh":
        corners = [vector(point) for point in primitive.points]
        assert corners == shape.vertices.tolist()
        assert list(primitive.indices) == shape.triangles.ravel().tolist()
    else:
        assert vector(primitive.size) == shape.size.tolist()
    if shape.form == "cylinder":
        assert (primitive.bottom_scale, primitive.top_scale) == (1, 1)


def assert_scene(found: Found, motion: BodyMotion) -> None:
    [(time, message)] = found["/scene"]
    assert time == round(motion.time[0] * 1e9)
    assert [each.id for each in message.entities] == list(motion.bodies)
    for body, entity in enumerate(message.entities):
        assert entity.frame_id == motion.bodies[body]
        assert entity.frame_locked
        primitives = {
            "box": entity.cubes,
            "ellipsoid": entity.spheres,
            "cylinder": entity.cylinders,
            "mesh": entity.triangles,
        }
        for form, found_ones in primitives.items():
            shapes = [each for each in motion.shapes if each.body == body and each.form == form]
            for primitive, shape in zip(found_ones, shapes, strict=True):
                assert_primitive(primitive, shape)


def assert_forces(found: Found, motion: BodyMotion) -> None:
    """An arrow's tail is the contact; its head lies where the force, scaled and cut, points."""
    assert len(found["/contact_forces"]) == len(motion.rows)
    for frame, (time, message) in enumerate(found["/contact_forces"]):
        assert time == round(motion.time[frame] * 1e9)
        [entity] = message.entities
        told = {each.key: float(each.value) for each in entity.metadata}
        assert told == {"metres_per_newton": motion.scale, "longest_metres": motion.longest}
        assert (entity.frame_id, entity.frame_locked) == ("world", False)
        mine = np.flatnonzero(motion.forces.frame == frame)
        for arrow, index in zip(entity.arrows, mine, strict=True):
            force = motion.forces.force[index]
            length = min(float(np.linalg.norm(force)) * motion.scale, motion.longest)
            drawn = turned(wxyz(arrow.pose.orientation), [1, 0, 0])
            drawn *= arrow.shaft_length + arrow.head_length
            # Rounding of a dozen operations on numbers of the arrow's length.
            expected = force / np.linalg.norm(force) * length
            np.testing.assert_allclose(drawn, expected, rtol=0, atol=1e-14 * length)
            assert vector(arrow.pose.position) == motion.forces.position[index].tolist()
            colour = MODE_COLOURS[int(motion.forces.mode[index])]
            assert (arrow.color.r, arrow.color.g, arrow.color.b, arrow.color.a) == colour


def assert_joints(found: Found, motion: BodyMotion) -> None:
    assert len(found["/joints"]) == len(motion.rows)
    for frame, (time, message) in enumerate(found["/joints"]):
        assert time == round(motion.time[frame] * 1e9)
        assert tuple(each.name for each in message.joints) == motion.joints.names
        for index, each in enumerate(message.joints):
            assert each.position == motion.joints.position[frame, index]
            assert each.velocity == motion.joints.velocity[frame, index]


@pytest.mark.long
@settings(max_examples=25, deadline=None)
@given(steps=st.integers(0, 12), seed=st.integers(0, 2**32 - 1), data=st.data())
def test_python_reads_the_motion_and_all_that_was_there(
    *,
    tmp_path_factory: pytest.TempPathFactory,
    make_trace: MakeTrace,
    make_motion: MakeMotion,
    extras: TraceExtras,
    steps: int,
    seed: int,
    data: st.DataObject,
) -> None:
    folder = tmp_path_factory.getbasetemp()
    source, target = folder / "plain.mcap", folder / "layered.mcap"
    trace, series = make_trace(pairs=("a-b", "c/d"), steps=steps, seed=seed)
    write_trace(source, trace, 0, series, extras)
    rows = sorted(data.draw(st.sets(st.integers(0, steps), min_size=1)))
    motion = make_motion(trace, rows, seed=seed)
    write_with_layer(source, target, motion)
    assert_viewable(target)
    found = read(target)
    assert_transforms(found, motion)
    assert_scene(found, motion)
    assert_forces(found, motion)
    assert_joints(found, motion)
    assert raw(target) == raw(source)
    again = read_trace(target)
    assert again.record_json == extras.record_json
    assert (again.metadata, again.model_xml) == (extras.metadata, extras.model_xml)


def small(
    tmp_path: Path, make_trace: MakeTrace, make_motion: MakeMotion, extras: TraceExtras
) -> tuple[Path, BodyMotion]:
    trace, series = make_trace(pairs=("a-b",), steps=40)
    write_trace(tmp_path / "plain.mcap", trace, 0, series, extras)
    motion = make_motion(trace, [0, 7, 8, 30, 40])
    write_with_layer(tmp_path / "plain.mcap", tmp_path / "layered.mcap", motion)
    return tmp_path / "layered.mcap", motion


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
@pytest.mark.skipif(
    not (NODE / "node_modules").is_dir(), reason=f"`npm install` was not run in {NODE}"
)
def test_javascript_reads_the_motion(
    tmp_path: Path, make_trace: MakeTrace, make_motion: MakeMotion, extras: TraceExtras
) -> None:
    path, motion = small(tmp_path, make_trace, make_motion, extras)
    done = subprocess.run(
        ["node", NODE / "read.mjs", path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    messages: dict[str, list[Any]] = {}
    for each in json.loads(done.stdout)["messages"]:
        messages.setdefault(each["topic"], []).append((int(each["time"]), each["message"]))
    for frame, (time, message) in enumerate(messages["/tf"]):
        assert time == round(motion.time[frame] * 1e9)
        for body, each in enumerate(message["transforms"], start=1):
            assert list(each["translation"].values()) == motion.positions[frame, body].tolist()
            x, y, z, w = each["rotation"].values()
            assert [w, x, y, z] == motion.rotations[frame, body].tolist()
    [(_, scene)] = messages["/scene"]
    assert [each["id"] for each in scene["entities"]] == list(motion.bodies)
    arrows = [len(each["entities"][0]["arrows"]) for _, each in messages["/contact_forces"]]
    assert arrows == np.bincount(motion.forces.frame, minlength=len(motion.rows)).tolist()


def batches(path: Path) -> Iterator[tuple[str, Any]]:
    rerun = pytest.importorskip("rerun.chunk")
    for chunk in rerun.McapReader(path, timeline_type="duration_ns").stream():
        yield chunk.entity_path.replace("\\", ""), chunk.to_record_batch()


def test_rerun_reads_the_motion(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    make_trace: MakeTrace,
    make_motion: MakeMotion,
    extras: TraceExtras,
) -> None:
    """Rerun turns transforms into its own, in single precision in some versions."""
    monkeypatch.setenv("RERUN_ANALYTICS", "0")
    path, motion = small(tmp_path, make_trace, make_motion, extras)
    found: dict[str, list[Any]] = {}
    for topic, batch in batches(path):
        for name in batch.schema.names:
            if name.startswith("Transform3D:translation") and topic == "/tf":
                found.setdefault("translation", []).extend(batch.column(name).to_pylist())
            if name.startswith("Transform3D:child_frame") and topic == "/tf":
                found.setdefault("frame", []).extend(batch.column(name).to_pylist())
    frames = np.array(found["frame"]).ravel()
    places = np.array(found["translation"]).reshape(-1, 3)
    for body, name in enumerate(motion.bodies[1:], start=1):
        expected = motion.positions[:, body]
        np.testing.assert_allclose(places[frames == name], expected, rtol=2**-23)
