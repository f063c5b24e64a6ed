"""What is drawn of a stored run: poses by kinematics, forces from the trace."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import FORCE, NORMAL, POSITION, TANGENT, Floats
from contactlab.errors import StoreError
from contactlab.measure import LABELS
from contactlab.scene.compiled_scene import PreparedModel
from contactlab.schema.evidence import LabelEntry
from contactlab.store.mcap.trace_reader import StoredPair, StoredTrace
from contactlab_view.drawn_shapes import BodyShape, poses, shapes

Rows = NDArray[np.intp]

# The sphere is at most so many radii of the largest moving body: beyond, that body would be a dot.
_MOST_RADII = 25.0
# Nine in ten arrows are at most about as long as the first fraction of the sphere's radius; arrows
# are cut at the second.
_USUAL_ARROW, _LONGEST_ARROW = 0.5, 1.0
_USUAL_PERCENTILE = 90
_SCALAR_JOINTS = (mujoco.mjtJoint.mjJNT_HINGE.value, mujoco.mjtJoint.mjJNT_SLIDE.value)


class ContactForces(NamedTuple):
    """K contact forces, each drawn in one frame, in the order of the frames."""

    frame: NDArray[np.intp]  # (K,) index of the frame
    pair: NDArray[np.intp]  # (K,) index of the monitored pair
    mode: NDArray[np.int8]  # (K,) STICK or SLIDE, of the pair
    position: Floats  # (K, 3) contact point, world frame [m]
    force: Floats  # (K, 3) force on the pair's second side, world frame [N]

    def of(self, frame: int) -> slice:
        """Return where the forces of a frame are."""
        start, stop = np.searchsorted(self.frame, (frame, frame + 1))
        return slice(int(start), int(stop))


class JointMotion(NamedTuple):
    """J hinge and slide joints in F frames."""

    names: tuple[str, ...]  # (J,)
    position: Floats  # (F, J) [rad or m]
    velocity: Floats  # (F, J) [rad/s or m/s]


class RunEvent(NamedTuple):
    """A label that begins to apply, or applies to the whole run."""

    row: int  # the state row, the last one for the whole run
    time: float  # of that row [s]
    label: str
    reason: str
    is_severe: bool


@dataclass(frozen=True)
class BodyMotion:
    """F frames of a run with B bodies, the first of which is the world."""

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
    centre: Floats  # (3,) of the sphere that the camera sees, world frame [m]
    radius: float  # of that sphere [m]
    scale: float  # length of an arrow per newton [m/N]
    longest: float  # length at which arrows are cut [m]

    @property
    def arrows(self) -> Floats:
        """(K, 3) the contact forces as arrows, world frame [m]."""
        arrows = self.forces.force * self.scale
        lengths = np.linalg.norm(arrows, axis=1, keepdims=True)
        return arrows * np.minimum(1.0, self.longest / np.maximum(lengths, np.finfo(float).tiny))


def read_motion(
    prepared: PreparedModel, trace: StoredTrace, rate: float, times: Sequence[float] = ()
) -> BodyMotion:
    """Return what is drawn of a run, up to its first state that is not finite.

    The trace holds every configuration, so that nothing is simulated again. There are `rate` frames
    per simulated second; `times` [s] get frames of their own. A StoreError says that not even the
    start state is finite.
    """
    model = prepared.model
    broken = np.flatnonzero(~np.isfinite(trace.qpos).all(axis=1))
    sound = int(broken[0]) if len(broken) else len(trace.qpos)
    if not sound:
        raise StoreError(f"run {trace.metadata['run_id']} has no finite state to draw")
    rows = frame_rows(trace.time[:sound], rate, times)
    positions, rotations = poses(model, trace.qpos[rows])
    parts, moving = shapes(model), model.body_weldid != 0
    forces = peak_forces(trace.pairs, rows)
    centre, radius = scene_sphere(parts, moving, positions, forces.position)
    scale, longest = arrow_scale(forces.force, radius)
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
        centre=centre,
        radius=radius,
        scale=scale,
        longest=longest,
    )


def joint_motion(model: mujoco.MjModel, qpos: Floats, qvel: Floats) -> JointMotion:
    """Return the hinge and slide joints of configurations (F, nq) and velocities (F, nv)."""
    joints = np.flatnonzero(np.isin(model.jnt_type, _SCALAR_JOINTS)).tolist()
    return JointMotion(
        tuple(model.joint(each).name or f"joint {each}" for each in joints),
        qpos[:, model.jnt_qposadr[joints]],
        qvel[:, model.jnt_dofadr[joints]],
    )


def run_events(labels: Sequence[LabelEntry], time: Floats) -> tuple[RunEvent, ...]:
    """Return where each label but `stable` begins, in order of the times (N + 1,) of states [s]."""
    events: list[RunEvent] = []
    for each in labels:
        known = LABELS.get(each.label)
        if known is None or known.severity:
            row = len(time) - 1 if each.step is None else min(each.step, len(time) - 1)
            severe = known is not None and known.is_severe
            events.append(RunEvent(row, float(time[row]), each.label, each.reason, severe))
    return tuple(sorted(events, key=lambda each: each.row))


def scene_sphere(
    shapes: Sequence[BodyShape], moving: NDArray[np.bool_], positions: Floats, contacts: Floats
) -> tuple[Floats, float]:
    """Return centre and radius [m] of a sphere around all that moves, or around the contacts.

    Of bodies (B,) the positions are (F, B, 3) [m]; contact points are (K, 3) [m].
    """
    reach = _reach(shapes, len(moving))
    seen = (moving if moving.any() else np.ones_like(moving)) & (reach > 0)
    if not seen.any():
        return np.zeros(3), 1.0
    low = (positions[:, seen] - reach[seen, None]).min(axis=(0, 1))
    high = (positions[:, seen] + reach[seen, None]).max(axis=(0, 1))
    centre = (low + high) / 2
    far = np.linalg.norm(positions[:, seen] - centre, axis=2) + reach[seen]
    radius = float(far.max())
    widest = _MOST_RADII * float(reach[seen].max())
    if radius <= widest:
        return centre, radius
    middle = contacts if len(contacts) else positions[0, seen]
    return np.median(middle, axis=0), widest


def arrow_scale(force: Floats, radius: float) -> tuple[float, float]:
    """Return the length of arrows per newton [m/N], 1, 2 or 5 times 10^k, and the longest [m].

    The forces are (K, 3) [N], and the radius [m] is that of the sphere that the camera sees.
    """
    strength = np.linalg.norm(force, axis=1)
    pushing = strength[strength > 0]
    usual = float(np.percentile(pushing, _USUAL_PERCENTILE)) if len(pushing) else 1.0
    wanted = _USUAL_ARROW * radius / usual
    decade = 10.0 ** np.floor(np.log10(wanted))
    digit = min((1, 2, 5, 10), key=lambda each: abs(np.log10(each * decade / wanted)))
    return float(digit * decade), _LONGEST_ARROW * radius


def _reach(shapes: Sequence[BodyShape], bodies: int) -> Floats:
    """Return (B,) the radius around each body's origin that holds its shapes [m]."""
    reach = np.zeros(bodies)
    for shape in shapes:
        far = np.linalg.norm(shape.size) / 2
        if shape.form == "mesh":
            far = np.linalg.norm(shape.vertices, axis=1).max(initial=0)
        elif shape.form == "ellipsoid":
            far = shape.size.max() / 2
        reach[shape.body] = max(reach[shape.body], np.linalg.norm(shape.position) + far)
    return reach


def frame_rows(time: Floats, rate: float, times: Sequence[float] = ()) -> Rows:
    """Return the state rows nearest to frames at a rate and to further times, and the last row.

    The times [s] of the N + 1 states grow; the rate is in frames per simulated second.
    """
    wanted = np.append(frame_times(time, rate), times)
    return np.unique(np.append(nearest(time, wanted), len(time) - 1))


def frame_times(time: Floats, rate: float) -> Floats:
    """Return the times of frames at a rate, from the first state to the last at most [s]."""
    # Rounding must not cost the frame of the last state.
    count = int((time[-1] - time[0]) * rate * (1 + 1e-9)) + 1
    return time[0] + np.arange(count) / rate


def nearest(time: Floats, wanted: Floats) -> Rows:
    """Return the index of the time nearest to each wanted one, the earlier of two."""
    return np.searchsorted((time[1:] + time[:-1]) / 2, wanted)


def peak_forces(pairs: Sequence[StoredPair], rows: Rows) -> ContactForces:
    """Return, for each frame and pair, the contact forces of the step with the largest net force.

    A frame covers the steps from its state to the next frame's, so that an impact of a single step
    is seen at any rate; the last frame covers the step before it.
    """
    parts = [_forces_of_pair(pair, index, rows) for index, pair in enumerate(pairs)]
    none = np.empty(0, np.intp)
    empty = ContactForces(none, none, np.empty(0, np.int8), np.empty((0, 3)), np.empty((0, 3)))
    columns = [np.concatenate(each) for each in zip(empty, *parts, strict=True)]
    order = np.argsort(columns[0], kind="stable")
    return ContactForces(*(column[order] for column in columns))


def _forces_of_pair(pair: StoredPair, index: int, rows: Rows) -> ContactForces:
    entries, frames = _strongest(pair, rows)
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


def _strongest(pair: StoredPair, rows: Rows) -> tuple[Rows, Rows]:
    """Return the entry of the step with the largest net force in each frame, and the frames."""
    final = np.flatnonzero(pair.steps == rows[-1] - 1)
    entries = np.append(np.arange(len(pair.steps)), final)
    frames = np.searchsorted(rows, pair.steps, side="right") - 1
    frames = np.append(frames, np.full(len(final), len(rows) - 1))
    strength = np.nan_to_num(np.hypot(pair.normal, pair.tangential))[entries]
    order = np.lexsort((strength, frames))
    last = np.flatnonzero(np.diff(frames[order], append=len(rows)))
    chosen = order[last]
    return entries[chosen], frames[chosen]


def world_force(points: Floats) -> Floats:
    """Return (K, 3) forces on the second side [N], world frame, of (K, 23) contact slots."""
    normal, tangent = points[:, NORMAL], points[:, TANGENT]
    axes = np.stack([normal, tangent, np.cross(normal, tangent)], axis=1)
    return np.einsum("ki,kij->kj", points[:, FORCE], axes)
