"""Writes a trace file with a 3D layer of Foxglove's own messages: poses, shapes, contact arrows.

Source: the message schemas at https://docs.foxglove.dev/docs/sdk/schemas; quaternions there are
x, y, z, w, and an arrow points along +x of its pose.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.KeyValuePair_pb2 import KeyValuePair
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp

from contactlab.contact.rotations import rotation_from_x
from contactlab.contact.trace_arrays import Floats
from contactlab.palette import MODE_COLOURS
from contactlab.store.mcap.trace_writer import RECORD_SCHEMA_NAME, AddedChannel, copy_trace
from contactlab.view.drawn_motion import BodyMotion, RunEvent
from contactlab.view.foxglove_files import (
    EVENTS,
    FORCES,
    JOINTS,
    SCENE,
    evidence_schema,
    layout_file,
    write_layout,
)

_WORLD_BODY = 0


def write_with_layer(
    source: Path, target: Path, motion: BodyMotion, events: Sequence[RunEvent] = ()
) -> None:
    """Write a trace file again with the 3D layer and events added, and a layout in the same folder.

    An OutputError says that a file cannot be written.
    """
    rows = motion.rows.tolist()
    poses = [(row, frame_transforms(motion, frame)) for frame, row in enumerate(rows)]
    forces = [(row, contact_forces(motion, frame)) for frame, row in enumerate(rows)]
    joints = [(row, joint_states(motion, frame)) for frame, row in enumerate(rows)]
    channels = (
        _added_channel(SCENE, SceneUpdate, [(rows[0], scene_update(motion))]),
        _added_channel("/tf", FrameTransforms, poses),
        _added_channel(FORCES, SceneUpdate, forces),
        _added_channel(JOINTS, JointStates, joints if motion.joints.names else []),
        _added_channel(EVENTS, Log, [(event.row, event_log(event)) for event in events]),
    )
    copy_trace(source, target, channels, {RECORD_SCHEMA_NAME: evidence_schema()})
    write_layout(layout_file(target), motion)


def _added_channel(
    topic: str, kind: type[Message], messages: Iterable[tuple[int, Message]]
) -> AddedChannel:
    encoded = [(row, message.SerializeToString(deterministic=True)) for row, message in messages]
    return AddedChannel(topic, kind.DESCRIPTOR.full_name, message_descriptors(kind), encoded)


def message_descriptors(message: type[Message]) -> bytes:
    """Return a FileDescriptorSet that defines a message and all its dependencies."""
    pending, files = [message.DESCRIPTOR.file], {}
    while pending:
        file = pending.pop()
        # A file that is needed again moves to the end, after all its users.
        files.pop(file.name, None)
        files[file.name] = file
        pending += file.dependencies
    descriptor_set = FileDescriptorSet()
    for file in reversed(files.values()):
        file.CopyToProto(descriptor_set.file.add())
    return descriptor_set.SerializeToString(deterministic=True)


def frame_transforms(motion: BodyMotion, frame: int) -> FrameTransforms:
    """Return the poses of all bodies except the world in a frame."""
    time = _timestamp_message(motion.time[frame])
    return FrameTransforms(
        transforms=[
            FrameTransform(
                timestamp=time,
                parent_frame_id=motion.bodies[_WORLD_BODY],
                child_frame_id=motion.bodies[body],
                translation=_vector_message(motion.positions[frame, body]),
                rotation=_quaternion_message(motion.rotations[frame, body]),
            )
            for body in range(1, len(motion.bodies))
        ]
    )


def scene_update(motion: BodyMotion) -> SceneUpdate:
    """Return the shapes of the bodies, each as an entity that moves with its body's frame."""
    time, entities = _timestamp_message(motion.time[0]), dict[str, SceneEntity]()
    for shape in sorted(motion.shapes, key=lambda body_shape: body_shape.body):
        name = motion.bodies[shape.body]
        entity = entities.setdefault(
            name, SceneEntity(timestamp=time, frame_id=name, id=name, frame_locked=True)
        )
        pose, colour = _pose_message(shape.position, shape.rotation), _colour_message(shape.colour)
        size = _vector_message(shape.size)
        if shape.form == "box":
            entity.cubes.append(CubePrimitive(pose=pose, size=size, color=colour))
        elif shape.form == "ellipsoid":
            entity.spheres.append(SpherePrimitive(pose=pose, size=size, color=colour))
        elif shape.form == "cylinder":
            ends = {"bottom_scale": 1, "top_scale": 1}
            entity.cylinders.append(CylinderPrimitive(pose=pose, size=size, color=colour, **ends))
        else:
            points = [Point3(x=x, y=y, z=z) for x, y, z in shape.vertices.tolist()]
            mesh = TriangleListPrimitive(pose=pose, points=points, color=colour)
            mesh.indices.extend(shape.triangles.ravel().tolist())
            entity.triangles.append(mesh)
    return SceneUpdate(entities=entities.values())


def contact_forces(motion: BodyMotion, frame: int) -> SceneUpdate:
    """Return the arrows of a frame; they replace those of the frame before."""
    chosen, forces = motion.forces.of(frame), motion.forces
    points, modes = forces.position[chosen], forces.mode[chosen].tolist()
    arrows = zip(points, motion.arrows[chosen], modes, strict=True)
    scale = {"metres_per_newton": motion.scale, "longest_metres": motion.longest}
    diameter = 0.02 * motion.radius
    return SceneUpdate(
        entities=[
            SceneEntity(
                timestamp=_timestamp_message(motion.time[frame]),
                frame_id=motion.bodies[_WORLD_BODY],
                id=FORCES.lstrip("/"),
                metadata=[
                    KeyValuePair(key=key, value=f"{value:g}") for key, value in scale.items()
                ],
                arrows=[_arrow_message(*arrow, diameter) for arrow in arrows],
            )
        ]
    )


def joint_states(motion: BodyMotion, frame: int) -> JointStates:
    """Return the hinge and slide joints of a frame by name."""
    names, positions, velocities = motion.joints
    parts = zip(names, positions[frame].tolist(), velocities[frame].tolist(), strict=True)
    joints = [JointState(name=name, position=at, velocity=speed) for name, at, speed in parts]
    return JointStates(timestamp=_timestamp_message(motion.time[frame]), joints=joints)


def event_log(event: RunEvent) -> Log:
    """Return a label as a line of the log; a severe one as an error."""
    return Log(
        timestamp=_timestamp_message(event.time),
        level=Log.ERROR if event.is_severe else Log.WARNING,
        message=f"{event.label}: {event.reason}",
        name="contactlab",
    )


def _arrow_message(point: Floats, arrow: Floats, mode: int, diameter: float) -> ArrowPrimitive:
    length = float(np.linalg.norm(arrow))
    thickness = min(diameter, 0.15 * length)  # a short arrow stays slender
    head_share = 0.25  # of the length
    return ArrowPrimitive(
        pose=_pose_message(point, rotation_from_x(arrow)),
        shaft_length=(1 - head_share) * length,
        shaft_diameter=thickness,
        head_length=head_share * length,
        head_diameter=2 * thickness,
        color=_colour_message(np.array(MODE_COLOURS[mode])),
    )


def _timestamp_message(time: float) -> Timestamp:
    seconds, nanos = divmod(round(time * 1e9), 10**9)
    return Timestamp(seconds=seconds, nanos=nanos)


def _pose_message(position: Floats, rotation: Floats) -> Pose:
    return Pose(position=_vector_message(position), orientation=_quaternion_message(rotation))


def _vector_message(values: Floats) -> Vector3:
    x, y, z = values.tolist()
    return Vector3(x=x, y=y, z=z)


def _quaternion_message(values: Floats) -> Quaternion:
    w, x, y, z = values.tolist()
    return Quaternion(x=x, y=y, z=z, w=w)


def _colour_message(values: Floats) -> Color:
    red, green, blue, opacity = values.tolist()
    return Color(r=red, g=green, b=blue, a=opacity)
