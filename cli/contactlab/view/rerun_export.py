"""Writes a run as a Rerun recording: shapes, poses, contact arrows and time series.

Source: the archetypes at https://ref.rerun.io/docs/python; quaternions there are x, y, z, w.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from contactlab.contact.rotations import rotate_vectors
from contactlab.contact.trace_arrays import Floats
from contactlab.palette import MODE_COLOURS
from contactlab.store.atomic_files import atomic_write
from contactlab.store.mcap.trace_reader import StoredTrace
from contactlab.view.drawn_motion import BodyMotion, RunEvent
from contactlab.view.drawn_shapes import BodyShape
from contactlab.view.foxglove_files import PLOTS

_SPACE_ENTITY, _BODY_ENTITY, _FORCE_ENTITY = "space", "bodies", "contact_forces"
_EVENT_ENTITY, _JOINT_ENTITY = "events", "joints"
_XYZW_ORDER = [1, 2, 3, 0]


def write_rrd(
    path: Path, trace: StoredTrace, motion: BodyMotion, events: Sequence[RunEvent] = ()
) -> None:
    """Write a run as a Rerun recording with events and time series of the trace, a value per step.

    An OutputError says that the file cannot be written.
    """
    recording = rr.RecordingStream("contactlab", recording_id=trace.metadata["run_id"])
    # The recording goes through memory, so that a full disk is an error here, not a log line.
    memory = recording.memory_recording()
    recording.send_blueprint(_viewer_blueprint(motion))
    recording.log("record", rr.TextDocument(trace.record_json.decode()), static=True)
    index = _time_column(motion.time)
    for body, name in enumerate(motion.bodies):
        if body:
            poses = rr.Transform3D.columns(
                translation=motion.positions[:, body],
                quaternion=motion.rotations[:, body][:, _XYZW_ORDER],
            )
            recording.send_columns(_entity_path(_SPACE_ENTITY, _BODY_ENTITY, name), [index], poses)
    for shape in motion.shapes:
        place = _entity_path(_SPACE_ENTITY, _BODY_ENTITY, motion.bodies[shape.body], shape.name)
        recording.log(place, _shape_archetype(shape), static=True)

    forces = motion.forces
    lengths = np.bincount(forces.frame, minlength=len(motion.time))
    colours = np.array([MODE_COLOURS[mode] for mode in forces.mode.tolist()]).reshape(-1, 4)
    arrows = rr.Arrows3D.columns(
        vectors=motion.arrows,
        origins=forces.position,
        colors=(colours * 255).astype(np.uint8),
        radii=np.full(len(forces.frame), 0.01 * motion.radius),
    )
    columns = arrows.partition(lengths=lengths)
    recording.send_columns(
        _entity_path(_SPACE_ENTITY, _FORCE_ENTITY), [_time_column(motion.time)], columns
    )
    if events:
        levels = ["ERROR" if event.is_severe else "WARN" for event in events]
        texts = [f"{event.label}: {event.reason}" for event in events]
        index = _time_column(np.array([event.time for event in events]))
        recording.send_columns(_EVENT_ENTITY, [index], rr.TextLog.columns(text=texts, level=levels))
    for name, values in zip(motion.joints.names, motion.joints.position.T, strict=True):
        entity = _entity_path(_JOINT_ENTITY, name)
        recording.send_columns(
            entity, [_time_column(motion.time)], rr.Scalars.columns(scalars=values)
        )
    for name, values in _time_series(trace):
        index = _time_column(trace.time[: len(values)])
        recording.send_columns(name, [index], rr.Scalars.columns(scalars=values))
    with atomic_write(path) as temporary:
        temporary.write_bytes(memory.drain_as_bytes() or b"")
    recording.disconnect()


def _viewer_blueprint(motion: BodyMotion) -> rrb.Blueprint:
    plots = [
        rrb.TimeSeriesView(
            name=title,
            origin="/",
            contents=[f"/{_entity_path('pairs', pair, name)}" for pair in motion.pairs],
        )
        for title, name in PLOTS.items()
    ]
    if motion.joints.names:
        plots.append(rrb.TimeSeriesView(name="Joints [m, rad]", origin=f"/{_JOINT_ENTITY}"))
    space = rrb.Spatial3DView(name="Scene", origin=f"/{_SPACE_ENTITY}")
    below = rrb.Tabs(
        rrb.TextLogView(name="Events", origin=f"/{_EVENT_ENTITY}"),
        rrb.TextDocumentView(name="Record", origin="/record"),
    )
    left = rrb.Vertical(space, below, row_shares=[3, 1])
    return rrb.Blueprint(rrb.Horizontal(left, rrb.Vertical(*plots), column_shares=[3, 2]))


def _shape_archetype(shape: BodyShape) -> rr.AsComponents:
    if shape.form == "mesh":
        return rr.Mesh3D(
            vertex_positions=rotate_vectors(shape.rotation, shape.vertices) + shape.position,
            triangle_indices=shape.triangles,
            albedo_factor=shape.colour,
        )
    half = shape.size / 2
    look: dict[str, Any] = {
        "centers": [shape.position],
        "quaternions": [shape.rotation[_XYZW_ORDER]],
        "colors": [shape.colour],
        "fill_mode": rr.components.FillMode.Solid,
    }
    if shape.form == "cylinder":
        return rr.Cylinders3D(lengths=shape.size[2], radii=half[0], **look)
    kind = rr.Boxes3D if shape.form == "box" else rr.Ellipsoids3D
    return kind(half_sizes=[half], **look)


def _time_series(trace: StoredTrace) -> Iterator[tuple[str, Floats]]:
    yield "energy/kinetic", trace.kinetic
    yield "energy/potential", trace.potential
    yield "solver/contacts", trace.contacts.astype(np.float64)
    yield "solver/iterations", trace.iterations.astype(np.float64)
    for pair in trace.pairs:
        columns = {
            "normal_force": pair.normal,
            "tangential_force": pair.tangential,
            "penetration": np.maximum(-pair.distance, 0),
            "slip_speed": pair.slip,
            "mode": pair.mode.astype(np.float64),
        }
        for name, values in columns.items():
            yield (
                _entity_path("pairs", pair.name, name),
                pair.spread_over_steps(len(trace.kinetic), values),
            )


def _time_column(time: Floats) -> rr.TimeColumn:
    """Return times [s] in the nanoseconds of trace files."""
    return rr.TimeColumn("time", duration=np.rint(time * 1e9).astype("timedelta64[ns]"))


def _entity_path(*parts: str) -> str:
    return rr.new_entity_path(list(parts)).lstrip("/")
