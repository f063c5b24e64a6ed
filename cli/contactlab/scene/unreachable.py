"""Pairs of geoms that can never touch, by proof: wherever their joints are within their ranges.

Between two geoms are the joints of either body up to the body from which both hang. While one of
them turns by an angle, no point that it carries moves further than that angle times its greatest
distance from the joint. So a distance in the middle of a box of joint positions bounds those in all
of it. Boxes are halved until the geoms are apart in each of them.
"""

import copy
from collections.abc import Iterable, Iterator, Sequence

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.contact_pairs import geom_pairs, may_touch
from contactlab.scene.model_edits import read_flag

GeomPair = tuple[int, int]
_JOINT, _GEOM, _OFF = mujoco.mjtJoint, mujoco.mjtGeom, mujoco.mjtDisableBit
_UNMEASURED = {int(_GEOM.mjGEOM_HFIELD), int(_GEOM.mjGEOM_SDF)}
"""Shapes of which MuJoCo computes no distances."""
_BEYOND = 0.1
"""How far a joint may get beyond either limit, since limits are soft; as a share of its range."""
_TOUCH = 1e-6  # distance [m] up to which geoms count as touching, beyond their margins
_SAMPLES, _MOST_BOXES = 64, 4096
_FIRST_BOXES, _ALL_FIRST_BOXES = 128, 1 << 16


def filtered_pairs(model: mujoco.MjModel) -> list[GeomPair]:
    """Return the pairs of geoms, the lower id first, that may touch because their masks say so."""
    return geom_pairs(may_touch(model, listed=False))


class Clearance:
    """How far apart geoms are, and how far joints bring them together."""

    def __init__(self, model: mujoco.MjModel, runs: Sequence[Floats]) -> None:
        # Only the native functions compute distances of all shapes.
        self.model = copy.copy(model)
        self.model.opt.disableflags &= ~int(_OFF.mjDSBL_NATIVECCD)
        self.data = mujoco.MjData(self.model)
        self.ranges = joint_ranges(model, runs)
        self._extents = _extents(model, self.ranges)

    def place(self, qpos: Floats) -> None:
        """Put all bodies where a configuration (nq,) has them."""
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)

    def distance(self, first: int, second: int, most: float) -> float:
        """Return how far two placed geoms are from contact, up to `most` [m]; below 0 in it."""
        model = self.model
        own = model.geom_margin[first] + model.geom_margin[second]
        margin = _TOUCH + float(model.opt.o_margin if read_flag(model, "override") else own)
        limit = most + margin
        apart = mujoco.mj_geomDistance(self.model, self.data, first, second, limit, None)
        return most if apart >= limit else apart - margin

    def touching(self, qpos: Floats) -> set[GeomPair]:
        """Return the pairs of geoms that touch in a configuration (nq,), the lower id first."""
        self.place(qpos)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        pairs: list[list[int]] = np.sort(self.data.contact.geom, axis=1).tolist()
        return {(first, second) for first, second in pairs}

    def levers(self, pair: GeomPair) -> Floats | None:
        """Return (njnt,) how far each joint moves two geoms against each other at most.

        In metres a radian, or a metre; 0 for joints that are not between them. None where there is
        no bound: between them is a free or mocap body, a ball joint or a slide without limits, a
        plane turns, MuJoCo cannot measure their distance, or it makes contacts with what would pass
        within a step.
        """
        model, found = self.model, np.zeros(self.model.njnt)
        bodies = [int(model.geom_bodyid[geom]) for geom in pair]
        above = [set(_upward(model, body)) for body in bodies]
        for geom, body, others in zip(pair, bodies, reversed(above), strict=True):
            is_plane = model.geom_type[geom] == _GEOM.mjGEOM_PLANE
            reach = np.inf if is_plane else float(model.geom_rbound[geom])
            reach += float(np.linalg.norm(model.geom_pos[geom]))
            for parent in (ancestor for ancestor in _upward(model, body) if ancestor not in others):
                if model.body_mocapid[parent] >= 0:
                    return None
                reach += self._extents[parent]
                found[model.jnt_bodyid == parent] = reach
                reach += float(np.linalg.norm(model.body_pos[parent]))
        between = found > 0
        bounded = np.isfinite(found).all() and np.isfinite(self.ranges[between]).all()
        measured = not _UNMEASURED & set(model.geom_type[[*pair]].tolist())
        if not bounded or not measured or read_flag(model, "speculative"):
            return None
        return np.where(between & (model.jnt_type == _JOINT.mjJNT_SLIDE), 1.0, found)


def _extents(model: mujoco.MjModel, ranges: Floats) -> Floats:
    """Return (nbody,) what the joints of each body add to the reach from its frame at most [m]."""
    slides, extents = model.jnt_type == _JOINT.mjJNT_SLIDE, np.zeros(model.nbody)
    ways = np.abs(ranges - model.qpos0[model.jnt_qposadr][:, None]).max(axis=1, initial=0.0)
    anchors = 2 * np.linalg.norm(model.jnt_pos, axis=1)
    np.add.at(extents, model.jnt_bodyid, anchors + np.where(slides, ways, 0.0))
    return extents


def _upward(model: mujoco.MjModel, body: int) -> Iterator[int]:
    """Yield a body and all from which it hangs, but for the world."""
    while body:
        yield body
        body = int(model.body_parentid[body])


def joint_ranges(model: mujoco.MjModel, runs: Sequence[Floats]) -> Floats:
    """Return (njnt, 2) where hinges and slides may be, somewhat beyond their limits.

    A hinge without a limit goes once round, a slide without one anywhere; of others, NaN. A limit
    counts as none that does not hold in the default pose, a keyframe or a run (T, nq).
    """
    ends = np.full((model.njnt, 2), np.nan)
    hinges, slides = (model.jnt_type == kind for kind in (_JOINT.mjJNT_HINGE, _JOINT.mjJNT_SLIDE))
    ends[hinges], ends[slides] = (-np.pi, np.pi), (-np.inf, np.inf)
    if read_flag(model, "limit") and read_flag(model, "constraint"):
        limited = np.asarray(model.jnt_limited, bool) & (hinges | slides)
        spread = _BEYOND * np.ptp(model.jnt_range, axis=1, keepdims=True)
        allowed = model.jnt_range + spread * [-1, 1]
        places = np.concatenate([model.qpos0[None], model.key_qpos, *runs])[:, model.jnt_qposadr]
        limited &= ((places >= allowed[:, 0]) & (places <= allowed[:, 1])).all(axis=0)
        ends[limited] = allowed[limited]
    return ends


def unreachable_pairs(
    model: mujoco.MjModel, pairs: Iterable[GeomPair], runs: Sequence[Floats] = ()
) -> set[GeomPair]:
    """Return the pairs that cannot touch, whatever joints do within a tenth beyond their ranges.

    Runs (T, nq) show which joints their limits do not hold. Other pairs may be unable to touch as
    well: only so many boxes are tried.
    """
    clearance = Clearance(model, runs)
    levers = {pair: each for pair in pairs if (each := clearance.levers(pair)) is not None}
    known, generator = np.isfinite(clearance.ranges).all(axis=1), np.random.default_rng(0)
    for _ in range(_SAMPLES):
        qpos = model.qpos0.copy()
        qpos[model.jnt_qposadr[known]] = generator.uniform(*clearance.ranges[known].T)
        for pair in clearance.touching(qpos) & levers.keys():
            del levers[pair]
    first = min(_FIRST_BOXES, _ALL_FIRST_BOXES // max(1, len(levers)))
    return {pair for pair, lever in levers.items() if _is_apart(clearance, pair, lever, first)}


def _is_apart(clearance: Clearance, pair: GeomPair, levers: Floats, first: int) -> bool:
    """Return whether a pair is apart in all boxes of joint positions.

    A search is given up that would take too many boxes at the pace of its first ones.
    """
    model, between = clearance.model, np.flatnonzero(levers)
    places, levers, ranges = model.jnt_qposadr[between], levers[between], clearance.ranges[between]
    boxes, qpos = [(ranges.mean(axis=1), np.ptp(ranges, axis=1) / 2, 1.0)], model.qpos0.copy()
    tried, done = 0, 0.0
    while boxes:
        tried += 1
        middle, half, share = boxes.pop()
        qpos[places] = middle
        clearance.place(qpos)
        slack = float(levers @ half)
        distance = clearance.distance(*pair, slack)
        if distance <= 0 or (tried > first and tried > done * _MOST_BOXES):
            return False
        if distance >= slack:
            done += share
        else:
            shift = np.where(np.arange(len(half)) == (levers * half).argmax(), half / 2, 0.0)
            boxes += [(middle + way * shift, half - shift, share / 2) for way in (-1, 1)]
    return True
