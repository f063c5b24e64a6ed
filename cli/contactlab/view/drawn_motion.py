"""The drawn motion of a stored run: poses by kinematics, forces from the trace."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.rotations import rotate_vectors
from contactlab.contact.trace_arrays import FORCE, NORMAL, POSITION, TANGENT, Floats
from contactlab.errors import StoreError
from contactlab.measure import LABELS
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.scene.compiled_scene import PreparedModel
from contactlab.schema.evidence import EvidenceRecord, LabelEntry
from contactlab.store.mcap.trace_reader import StoredPair, StoredTrace
from contactlab.view.drawn_shapes import BodyShape, body_poses, body_shapes

Rows = NDArray[np.intp]

_SCALAR_JOINTS = (mujoco.mjtJoint.mjJNT_HINGE.value, mujoco.mjtJoint.mjJNT_SLIDE.value)


class ContactForces(NamedTuple):
    """K contact forces, each drawn in one frame, in the order of the frames."""

    frame: NDArray[np.intp]  # (K,) index of the frame
    pair: NDArray[np.intp]  # (K,) index of the monitored pair
    mode: NDArray[np.int8]  # (K,) STICK or SLIDE, of the pair
    position: Floats  # (K, 3) contact point, world frame [m]
    force: Floats  # (K, 3) force on the pair's second side, world frame [N]

    def of(self, frame: int) -> slice:
        """Return the slice of the forces of a frame."""
        start, stop = np.searchsorted(self.frame, (frame, frame + 1))
        return slice(int(start), int(stop))


class JointMotion(NamedTuple):
    """J hinge and slide joints in F frames."""

    names: tuple[str, ...]  # (J,)
    position: Floats  # (F, J) [rad or m]
    velocity: Floats  # (F, J) [rad/s or m/s]


class Stage(NamedTuple):
    """The sphere in the view of a camera."""

    centre: Floats  # (3,) world frame [m]
    radius: float  # [m]


class RunEvent(NamedTuple):
    """The start of a label, or a label of the whole run."""

    row: int  # the state row, the last one for the whole run
    time: float  # of that row [s]
    label: str
    reason: str
    is_severe: bool


@dataclass(frozen=True)
class BodyMotion:
    """F frames of a run with B bodies, the first of them the world."""

    bodies: tuple[str, ...]  # (B) their names
    moving: NDArray[np.bool_]  # (B,) whether each can move
    shapes: tuple[BodyShape, ...]
    rows: NDArray[np.intp]  # (F,) the state row of each frame
    time: Floats  # (F,) simulated time [s]
    positions: Floats  # (F, B, 3) of the bodies' frames, world frame [m]
    rotations: Floats  # (F, B, 4) unit quaternions w, x, y, z to the world frame
    joints: JointMotion
    pairs: tuple[str, ...]  # names of the monitored pairs
    forces: ContactForces
    """Contact forces; of each pair and frame, those of the step with the largest net force up to
    the next frame."""
    stage: Stage  # sphere in the camera's view
    scale: float  # length of an arrow per newton [m/N]
    longest: float  # length at which arrows are cut [m]
    followed: int | None = None  # the body that the camera follows; None if it sees the whole
    closeness: float = 0.0  # radius of the sphere around that body in the camera's view [m]

    def view(self, frame: int) -> Stage:
        """Return the sphere in the camera's view in a frame."""
        if self.followed is None:
            return self.stage
        return Stage(self.positions[frame, self.followed], self.closeness)

    @property
    def centre(self) -> Floats:
        """(3,) center of the sphere in the camera's view, world frame [m]."""
        return self.stage.centre

    @property
    def radius(self) -> float:
        """Radius of the sphere in the camera's view [m]."""
        return self.stage.radius

    @property
    def arrows(self) -> Floats:
        """(K, 3) the contact forces as arrows, world frame [m]."""
        arrows = self.forces.force * self.scale
        lengths = np.linalg.norm(arrows, axis=1, keepdims=True)
        return arrows * (self.longest / np.maximum(lengths, self.longest))


def read_motion(
    prepared: PreparedModel, trace: StoredTrace, rate: float, times: Sequence[float] = ()
) -> BodyMotion:
    """Return the drawn motion of a run, up to its first state that is not finite.

    The trace holds every configuration, so that nothing is simulated again. There are `rate` frames
    per simulated second; `times` [s] get their own frames. A StoreError says that not even the
    start state is finite.
    """
    model = prepared.model
    broken = np.flatnonzero(~np.isfinite(trace.qpos).all(axis=1))
    sound = int(broken[0]) if len(broken) else len(trace.qpos)
    if not sound:
        raise StoreError(f"run {trace.metadata['run_id']} has no finite state to draw")
    rows = frame_rows(trace.time[:sound], rate, times)
    positions, rotations = body_poses(model, trace.qpos[rows])
    parts, moving = body_shapes(model), model.body_weldid != 0
    forces = peak_forces(trace.pairs, rows)
    stage = scene_sphere(parts, moving, positions, rotations, forces.position)
    scale, longest = arrow_scale(forces.force, stage.radius)
    return BodyMotion(
        bodies=tuple(model.body(index).name for index in range(model.nbody)),
        moving=moving,
        shapes=parts,
        rows=rows,
        time=trace.time[rows],
        positions=positions,
        rotations=rotations,
        joints=joint_motion(model, trace.qpos[rows], trace.qvel[rows]),
        pairs=tuple(pair.name for pair in trace.pairs),
        forces=forces,
        stage=stage,
        scale=scale,
        longest=longest,
    )


def joint_motion(model: mujoco.MjModel, qpos: Floats, qvel: Floats) -> JointMotion:
    """Return the hinge and slide joints of configurations (F, nq) and velocities (F, nv)."""
    joints = np.flatnonzero(np.isin(model.jnt_type, _SCALAR_JOINTS)).tolist()
    return JointMotion(
        tuple(model.joint(joint).name or f"joint {joint}" for joint in joints),
        qpos[:, model.jnt_qposadr[joints]],
        qvel[:, model.jnt_dofadr[joints]],
    )


def run_events(labels: Sequence[LabelEntry], time: Floats) -> tuple[RunEvent, ...]:
    """Return the start of each label except `stable`, in order of time (N + 1,) of states [s]."""
    events: list[RunEvent] = []
    for label in labels:
        definition = LABELS.get(label.label)
        if definition is None or not definition.is_good:
            row = len(time) - 1 if label.step is None else min(label.step, len(time) - 1)
            severe = definition is not None and definition.is_severe
            events.append(RunEvent(row, float(time[row]), label.label, label.reason, severe))
    return tuple(sorted(events, key=lambda event: event.row))


def follow_body(motion: BodyMotion, bodies: Sequence[int]) -> BodyMotion | None:
    """Return a motion with arrows and a stage for a camera that follows the smaller moving body.

    The bodies are the indices of a pair's two. None if neither moves, or if a camera that follows
    one would show little less than the whole.
    """
    sizes = {body: _body_radius(motion, body) for body in bodies if motion.moving[body]}
    sizes = {body: size for body, size in sizes.items() if size > 0}
    if not sizes:
        return None
    body = min(sizes, key=lambda index: sizes[index])
    # Radius of the view of a camera that follows a body, in radii of the body, and its smallest
    # and largest share of the whole view.
    focus_radii, smallest_focus, largest_focus = 3.0, 0.1, 0.75
    radius = max(focus_radii * sizes[body], smallest_focus * motion.radius)
    if radius > largest_focus * motion.radius:
        return None
    scale, longest = arrow_scale(motion.forces.force, radius)
    return replace(motion, followed=body, closeness=radius, scale=scale, longest=longest)


def _body_radius(motion: BodyMotion, body: int) -> float:
    """Return the radius of a sphere around a body's origin that contains its shapes [m]."""
    own = [shape for shape in motion.shapes if shape.body == body]
    return max((float(np.linalg.norm(e.position)) + _shape_radius(e) for e in own), default=0.0)


def failing_pair(record: EvidenceRecord, pairs: Sequence[StoredPair]) -> str | None:
    """Return the pair in the worst label's reason, or the one with the largest force."""
    reason = record.labels[0].reason if record.labels else ""
    failing_names = [
        pair.name for pair in pairs if re.search(rf"(?<!\w){re.escape(pair.name)}(?!\w)", reason)
    ]
    touching = [pair for pair in pairs if len(pair.steps)]
    strongest = max(
        touching, key=lambda pair: float(np.nan_to_num(pair.normal).max()), default=None
    )
    return failing_names[0] if failing_names else strongest.name if strongest else None


def widen_stage(motion: BodyMotion, positions: Floats, rotations: Floats) -> BodyMotion:
    """Return a motion with a stage that also contains other poses (F, B, 3) [m], (F, B, 4)."""
    both = [
        np.concatenate(parts)
        for parts in ((motion.positions, positions), (motion.rotations, rotations))
    ]
    contacts = motion.forces.position
    return replace(
        motion, stage=scene_sphere(motion.shapes, motion.moving, both[0], both[1], contacts)
    )


def picture_times(
    motion: BodyMotion, trace: StoredTrace, events: Sequence[RunEvent], pair: str | None, most: int
) -> list[float]:
    """Return up to `most` informative times [s] for pictures, in order.

    They are the starts of labels, the times of each pair's largest force, first that of the failing
    `pair`, start and end of the visible motion, and then the middle of the longest gap.
    """
    time = trace.time[: motion.rows[-1] + 1]
    far = np.linalg.norm(motion.positions[:, motion.moving] - motion.centre, axis=2)
    in_view = motion.time[(far <= motion.radius).any(axis=1)]
    start, end = (in_view if len(in_view) else motion.time)[[0, -1]].tolist()
    pairs = sorted(trace.pairs, key=lambda series: series.name != pair)
    peaks = [
        float(time[row]) for series in pairs if (row := _peak_step(series, len(time))) is not None
    ]
    begins = [event.time for event in events]
    instants = [start, *begins[:2], *peaks[:1], end, *begins[2:], *peaks[1:]]
    chosen = sorted(
        [*dict.fromkeys(instant for instant in instants if start <= instant <= end)][:most]
    )
    while len(chosen) < most and end > start:
        at = int(np.argmax(np.diff(chosen)))
        chosen.insert(at + 1, (chosen[at] + chosen[at + 1]) / 2)
    return chosen


def _peak_step(pair: StoredPair, rows: int) -> int | None:
    """Return the step with a pair's largest force before a state row."""
    force = np.nan_to_num(np.hypot(pair.normal, pair.tangential))[pair.steps < rows]
    return int(pair.steps[np.argmax(force)]) if len(force) and force.max() > 0 else None


def scene_sphere(
    shapes: Sequence[BodyShape],
    moving: NDArray[np.bool_],
    positions: Floats,
    rotations: Floats,
    contacts: Floats,
) -> Stage:
    """Return a sphere around all moving shapes, or around the contacts.

    The poses of bodies (B,) are (F, B, 3) [m] and (F, B, 4); contact points are (K, 3) [m].
    """
    visible_shapes = [shape for shape in shapes if moving[shape.body] or not moving.any()]
    if not visible_shapes:
        return Stage(np.zeros(3), 1.0)
    centres = [
        positions[:, shape.body] + rotate_vectors(rotations[:, shape.body], shape.position)
        for shape in visible_shapes
    ]
    middles = np.stack(centres, axis=1)
    sizes = np.array([_shape_radius(shape) for shape in visible_shapes])
    low = (middles - sizes[:, None]).min(axis=(0, 1))
    high = (middles + sizes[:, None]).max(axis=(0, 1))
    centre = (low + high) / 2
    radius = float((np.linalg.norm(middles - centre, axis=2) + sizes).max())
    # Largest radius of the sphere in radii of the largest moving body, so that it is not a dot.
    most_body_radii = 25.0
    widest = most_body_radii * float(sizes.max())
    if radius <= widest:
        return Stage(centre, radius)
    middle = contacts if len(contacts) else middles[0]
    return Stage(np.median(middle, axis=0), widest)


def _shape_radius(shape: BodyShape) -> float:
    """Return the radius of a sphere around a shape's center that contains it [m]."""
    if shape.form == "mesh":
        return float(np.linalg.norm(shape.vertices, axis=1).max(initial=0))
    return float(shape.size.max() if shape.form == "ellipsoid" else np.linalg.norm(shape.size)) / 2


def arrow_scale(force: Floats, radius: float) -> tuple[float, float]:
    """Return the length of arrows per newton [m/N], 1, 2 or 5 times 10^k, and the longest [m].

    The forces are (K, 3) [N], and the radius [m] is that of the sphere in the camera's view.
    """
    strength = np.linalg.norm(force, axis=1)
    pushing = strength[strength > 0]
    usual_percentile = 90
    usual = float(np.percentile(pushing, usual_percentile)) if len(pushing) else 1.0
    # Nine in ten arrows are at most about as long as the first fraction of the sphere's radius.
    # Longer arrows are cut at the second fraction.
    usual_arrow, longest_arrow = 0.5, 1.0
    exact_scale = usual_arrow * radius / usual
    decade = 10.0 ** np.floor(np.log10(exact_scale))
    digit = min(
        (1, 2, 5, 10), key=lambda candidate: abs(np.log10(candidate * decade / exact_scale))
    )
    return float(digit * decade), longest_arrow * radius


def frame_rows(time: Floats, rate: float, times: Sequence[float] = ()) -> Rows:
    """Return the state rows nearest to frames at a rate and to further times, and the last row.

    The times [s] of the N + 1 states grow; the rate is in frames per simulated second.
    """
    instants = np.append(frame_times(time, rate), times)
    return np.unique(np.append(nearest_indices(time, instants), len(time) - 1))


def frame_times(time: Floats, rate: float) -> Floats:
    """Return the times of frames at a rate, between the first and the last state [s]."""
    # Rounding must not remove the frame of the last state.
    count = int((time[-1] - time[0]) * rate * (1 + SUM_ROUNDING)) + 1
    return time[0] + np.arange(count) / rate


def nearest_indices(time: Floats, instants: Floats) -> Rows:
    """Return the index of the time nearest to each wanted one, the earlier of two."""
    return np.searchsorted((time[1:] + time[:-1]) / 2, instants)


def peak_forces(pairs: Sequence[StoredPair], rows: Rows) -> ContactForces:
    """Return, for each frame and pair, the contact forces of the step with the largest net force.

    A frame covers the steps from its state to the next frame's, so that an impact of a single step
    is visible at any rate; the last frame covers the step before it.
    """
    parts = [_forces_of_pair(pair, index, rows) for index, pair in enumerate(pairs)]
    none = np.empty(0, np.intp)
    empty = ContactForces(none, none, np.empty(0, np.int8), np.empty((0, 3)), np.empty((0, 3)))
    columns = [
        np.concatenate(columns_of_parts) for columns_of_parts in zip(empty, *parts, strict=True)
    ]
    order = np.argsort(columns[0], kind="stable")
    return ContactForces(*(column[order] for column in columns))


def _forces_of_pair(pair: StoredPair, index: int, rows: Rows) -> ContactForces:
    # In each frame, the entry of the step with the largest net force.
    final = np.flatnonzero(pair.steps == rows[-1] - 1)
    entries = np.append(np.arange(len(pair.steps)), final)
    frames = np.searchsorted(rows, pair.steps, side="right") - 1
    frames = np.append(frames, np.full(len(final), len(rows) - 1))
    strength = np.nan_to_num(np.hypot(pair.normal, pair.tangential))[entries]
    order = np.lexsort((strength, frames))
    chosen = order[np.flatnonzero(np.diff(frames[order], append=len(rows)))]
    entries, frames = entries[chosen], frames[chosen]

    counts = pair.contacts[entries]
    ends = np.cumsum(pair.contacts)[entries]
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    points = pair.points[np.repeat(ends - counts, counts) + within]
    force = world_force(points)
    sound = np.isfinite(force).all(axis=1) & np.isfinite(points[:, POSITION]).all(axis=1)
    return ContactForces(
        frame=np.repeat(frames, counts)[sound],
        pair=np.full(int(sound.sum()), index),
        mode=np.repeat(pair.mode[entries], counts)[sound],
        position=points[sound, POSITION],
        force=force[sound],
    )


def world_force(points: Floats) -> Floats:
    """Return (K, 3) forces on the second side [N], world frame, of (K, 23) contact slots."""
    normal, tangent = points[:, NORMAL], points[:, TANGENT]
    axes = np.stack([normal, tangent, np.cross(normal, tangent)], axis=1)
    return np.einsum("ki,kij->kj", points[:, FORCE], axes)
