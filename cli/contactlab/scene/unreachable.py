"""Finds pairs of geoms that provably never touch, wherever their joints are within their ranges.

Between two geoms are the joints of either body up to their common ancestor. While one of them turns
by an angle, no point that it carries moves farther than that angle times its greatest distance from
the joint. So the distance at the center of a box of joint positions bounds the distances in the
whole box. Boxes are halved until the geoms are separated in each of them.
"""

import copy
from collections.abc import Iterable, Iterator, Sequence

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.contact_pairs import touch_pairs
from contactlab.scene.model_edits import read_flag

GeomPair = tuple[int, int]
_JOINT_TYPES, _GEOM_TYPES, _DISABLE_FLAGS = mujoco.mjtJoint, mujoco.mjtGeom, mujoco.mjtDisableBit
_UNMEASURED_SHAPES = {int(_GEOM_TYPES.mjGEOM_HFIELD), int(_GEOM_TYPES.mjGEOM_SDF)}
"""Shapes without distances in MuJoCo."""


def filtered_pairs(model: mujoco.MjModel) -> list[GeomPair]:
    """Return the pairs of geoms, lower id first, that may touch because of their masks."""
    return touch_pairs(model, listed=False)


class Clearance:
    """Distances between geoms, and bounds of how far joints bring them together."""

    def __init__(self, model: mujoco.MjModel, runs: Sequence[Floats]) -> None:
        # Only the native functions compute distances of all shapes.
        self.model = copy.copy(model)
        self.model.opt.disableflags &= ~int(_DISABLE_FLAGS.mjDSBL_NATIVECCD)
        self.data = mujoco.MjData(self.model)
        self.ranges = joint_ranges(model, runs)
        self._joint_extents = _joint_extents(model, self.ranges)

    def set_configuration(self, qpos: Floats) -> None:
        """Put all bodies where a configuration (nq,) has them."""
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)

    def measure_distance(self, first: int, second: int, most: float) -> float:
        """Return the distance of two placed geoms to contact, up to `most` [m]; below 0 inside."""
        model = self.model
        own = model.geom_margin[first] + model.geom_margin[second]
        # Geoms count as touching up to this distance [m] beyond their margins.
        margin = 1e-6 + float(model.opt.o_margin if read_flag(model, "override") else own)
        limit = most + margin
        gap = mujoco.mj_geomDistance(self.model, self.data, first, second, limit, None)
        return most if gap >= limit else gap - margin

    def touching_pairs(self, qpos: Floats) -> set[GeomPair]:
        """Return the pairs of geoms that touch in a configuration (nq,), lower id first."""
        self.set_configuration(qpos)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        pairs: list[list[int]] = np.sort(self.data.contact.geom, axis=1).tolist()
        return {(first, second) for first, second in pairs}

    def motion_bounds(self, pair: GeomPair) -> Floats | None:
        """Return (njnt,) how far each joint moves two geoms against each other at most.

        In meters per radian, or per meter; 0 for joints that are not between them. The result is
        None if there is no bound: between them is a free or mocap body, a ball joint or a slide
        without limits, a plane turns, MuJoCo cannot measure their distance, or it creates
        speculative contacts for geoms that would pass within a step.
        """
        model, bounds = self.model, np.zeros(self.model.njnt)
        bodies = [int(model.geom_bodyid[geom]) for geom in pair]
        above = [set(_body_and_ancestors(model, body)) for body in bodies]
        for geom, body, others in zip(pair, bodies, reversed(above), strict=True):
            is_plane = model.geom_type[geom] == _GEOM_TYPES.mjGEOM_PLANE
            reach = np.inf if is_plane else float(model.geom_rbound[geom])
            reach += float(np.linalg.norm(model.geom_pos[geom]))
            for parent in (
                ancestor for ancestor in _body_and_ancestors(model, body) if ancestor not in others
            ):
                if model.body_mocapid[parent] >= 0:
                    return None
                reach += self._joint_extents[parent]
                bounds[model.jnt_bodyid == parent] = reach
                reach += float(np.linalg.norm(model.body_pos[parent]))
        between = bounds > 0
        bounded = np.isfinite(bounds).all() and np.isfinite(self.ranges[between]).all()
        is_measurable = not _UNMEASURED_SHAPES & set(model.geom_type[[*pair]].tolist())
        if not bounded or not is_measurable or read_flag(model, "speculative"):
            return None
        return np.where(between & (model.jnt_type == _JOINT_TYPES.mjJNT_SLIDE), 1.0, bounds)


def _joint_extents(model: mujoco.MjModel, ranges: Floats) -> Floats:
    """Return (nbody,) the largest distance that the joints of each body add to its reach [m]."""
    slides, extents = model.jnt_type == _JOINT_TYPES.mjJNT_SLIDE, np.zeros(model.nbody)
    ways = np.abs(ranges - model.qpos0[model.jnt_qposadr][:, None]).max(axis=1, initial=0.0)
    anchors = 2 * np.linalg.norm(model.jnt_pos, axis=1)
    np.add.at(extents, model.jnt_bodyid, anchors + np.where(slides, ways, 0.0))
    return extents


def _body_and_ancestors(model: mujoco.MjModel, body: int) -> Iterator[int]:
    """Yield a body and all of its ancestors except the world."""
    while body:
        yield body
        body = int(model.body_parentid[body])


def joint_ranges(model: mujoco.MjModel, runs: Sequence[Floats]) -> Floats:
    """Return (njnt, 2) the positions that hinges and slides may have, somewhat beyond their limits.

    A hinge without a limit covers a full turn, a slide without one everything; other joints have
    NaN. A limit that is violated in the default pose, a keyframe or a run (T, nq) is ignored.
    """
    ends = np.full((model.njnt, 2), np.nan)
    hinges, slides = (
        model.jnt_type == kind for kind in (_JOINT_TYPES.mjJNT_HINGE, _JOINT_TYPES.mjJNT_SLIDE)
    )
    ends[hinges], ends[slides] = (-np.pi, np.pi), (-np.inf, np.inf)
    if read_flag(model, "limit") and read_flag(model, "constraint"):
        limited = np.asarray(model.jnt_limited, bool) & (hinges | slides)
        # Allowed excess of a joint over a limit, because limits are soft; as a share of its range.
        spread = 0.1 * np.ptp(model.jnt_range, axis=1, keepdims=True)
        allowed = model.jnt_range + spread * [-1, 1]
        places = np.concatenate([model.qpos0[None], model.key_qpos, *runs])[:, model.jnt_qposadr]
        limited &= ((places >= allowed[:, 0]) & (places <= allowed[:, 1])).all(axis=0)
        ends[limited] = allowed[limited]
    return ends


def unreachable_pairs(
    model: mujoco.MjModel, pairs: Iterable[GeomPair], runs: Sequence[Floats] = ()
) -> set[GeomPair]:
    """Return the pairs that cannot touch while joints stay within a tenth beyond their ranges.

    Runs (T, nq) show which limits do not hold their joints. Other pairs may be unable to touch as
    well, because the number of boxes is limited.
    """
    clearance = Clearance(model, runs)
    levers = {pair: each for pair in pairs if (each := clearance.motion_bounds(pair)) is not None}
    is_limited, generator = np.isfinite(clearance.ranges).all(axis=1), np.random.default_rng(0)
    random_samples = 64
    # Random postures quickly discard most of the pairs that can touch.
    for _ in range(random_samples):
        qpos = model.qpos0.copy()
        qpos[model.jnt_qposadr[is_limited]] = generator.uniform(*clearance.ranges[is_limited].T)
        for pair in clearance.touching_pairs(qpos) & levers.keys():
            del levers[pair]
    # Boxes of postures of a pair before it must have proved a share of them, and of all pairs.
    first_boxes, all_first_boxes = 128, 1 << 16
    first = min(first_boxes, all_first_boxes // max(1, len(levers)))
    return {pair for pair, lever in levers.items() if _is_separated(clearance, pair, lever, first)}


def _is_separated(clearance: Clearance, pair: GeomPair, levers: Floats, first: int) -> bool:
    """Return whether a pair is separated in all boxes of joint positions.

    The search stops if it would take too many boxes at the pace of its first ones.
    """
    model, between = clearance.model, np.flatnonzero(levers)
    places, levers, ranges = model.jnt_qposadr[between], levers[between], clearance.ranges[between]
    boxes, qpos = [(ranges.mean(axis=1), np.ptp(ranges, axis=1) / 2, 1.0)], model.qpos0.copy()
    box_count, proved_share = 0, 0.0
    max_boxes = 4096  # of a whole proof; fewer must have proved their share of it
    while boxes:
        box_count += 1
        middle, half, share = boxes.pop()
        qpos[places] = middle
        clearance.set_configuration(qpos)
        slack = float(levers @ half)
        distance = clearance.measure_distance(*pair, slack)
        if distance <= 0 or (box_count > first and box_count > proved_share * max_boxes):
            return False
        if distance >= slack:
            proved_share += share
        else:
            shift = np.where(np.arange(len(half)) == (levers * half).argmax(), half / 2, 0.0)
            boxes += [(middle + way * shift, half - shift, share / 2) for way in (-1, 1)]
    return True
