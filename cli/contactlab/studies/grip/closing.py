"""Closing a hand: which end of each actuator's range closes, where fingers meet, the squeeze."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError
from contactlab.studies.grip.bench import Rig
from contactlab.studies.grip.fingers import (
    NO_HAND,
    control_ends,
    fixed_bodies,
    geoms_of,
    within_limits,
)
from contactlab.studies.grip.gripped_object import USUAL, GrippedObject
from contactlab.studies.grip.rollouts import (
    body_frames,
    constant,
    contacts_of,
    placed,
    roll,
    start_row,
)

# Fingers have so long to reach an end, are closed in so long, and settle in parts of so long [s].
_REACH, _RAMP, _PART, _MOST = 1.0, 0.5, 0.25, 4.0
# An actuator closes if its effect is this share of the largest; pairs of geoms are alike if they
# approach by this share of the most.
_EFFECT, _ALIKE = 0.1, 0.9
_PARTED = 12  # fingers, up to which all ways to part them are tried
_LOOKS = 60  # configurations of a path
_WAY = 0.1  # of the opening, on which the fingers' way is seen
# Of the way that fingers close, what an object leaves at both ends; of their breadth, its own.
_INSIDE, _PAST = 0.2, 1.25
# A force is steady if it changes by less than this share in a part.
_STEADY = 2e-3
_ARRIVED = 1e-3  # of the way that fingers went
_RESTING = 2.5e-5  # m/s of the object, a quarter of the speed from which it creeps
_CENTRED, _ON_AXIS = 1e-3, 1e-3  # of the object's largest half extent
# Of the object's extent, nearer to the base, and then farther; of half its width.
_DEPTHS = (0.0, 0.5, 1.0, 1.5, -0.25, -0.5)
_OVERLAP = 0.02
_FAR = 1e3  # where the object is put aside, in extents
_UNMOVED = 1e6  # times the mass of an object that is held still


@dataclass(frozen=True)
class Closing:
    """How a hand closes.

    Attributes:
        opened, closed: (nu,) controls.
        opening: largest clearance of the surfaces that meet [m].
        pairs: of geoms that meet, the first of one side, the second of the other.
        path: (K, nq) configurations as they close on nothing, the first opened.
        shares: (K,) of the way from opened to closed controls there.
        gaps: (K,) mean clearance of the pairs there [m].
    """

    opened: Floats
    closed: Floats
    opening: float
    pairs: tuple[tuple[int, int], ...]
    path: Floats
    shares: Floats
    gaps: Floats

    def control(self, share: float) -> Floats:
        """Return (nu,) controls at a share of the way from opened to closed."""
        return self.opened + share * (self.closed - self.opened)


@dataclass(frozen=True)
class Approach:
    """How fingers come to an object.

    Attributes:
        point: (3,) the object's middle before they close, in the world's frame [m].
        turn: (3, 3) of the object, as Squeeze has it.
        place: on the path of closing where they begin; 0 is opened.
        is_still: whether the object stays there until they rest, as on a table or in another hand.
    """

    point: Floats
    turn: Floats
    place: int = 0
    is_still: bool = False


@dataclass(frozen=True)
class Squeeze:
    """An object in closed fingers, without gravity.

    Attributes:
        row: state of mjSTATE_INTEGRATION.
        control: (nu,) that holds it.
        turn: (3, 3) whose columns are, in the world's frame, from finger to finger, sideways, and
            out of the hand.
        path: (N, nq) configurations while the fingers closed.
        forces: normal force of each finger [N]; what is fixed to the base comes last.
        depth: of the deepest contact [m].
        points: (K, 3) contact points [m].
        geoms: of the hand, which touch it.
        approach: how the fingers came to it; None in a keyframe.
    """

    row: Floats
    control: Floats
    turn: Floats
    path: Floats
    forces: tuple[float, ...]
    depth: float
    points: Floats
    geoms: tuple[int, ...]
    approach: Approach | None

    @property
    def is_held(self) -> bool:
        """True if two sides press on the object."""
        return sum(force > 0 for force in self.forces) > 1


def find_closing(rig: Rig) -> Closing:
    """Drive a hand open and closed on nothing.

    Which end of an actuator closes is its main effect on the distance of the fingers' outermost
    geoms, in a two-level design of all actuators (Hadamard, folded over). The distance is that
    between two sides, since a finger that curls alone goes away from its neighbours; what does
    little to it stays where it is.

    Raises:
        SceneError: no actuator brings fingers together.
    """
    model = _without(rig)
    ends = control_ends(model)
    signs, places = _designed(rig, model, ends)
    sides = _sides(_tips(rig, model, places), signs, places)
    effects = _effects(signs, _spreads(places, list(product(*sides))))
    closing = np.abs(effects) > max(_EFFECT * np.abs(effects).max(), 1e-9 * model.stat.extent)
    if not closing.any():
        raise SceneError(f"no actuator brings two fingers together; {NO_HAND}")
    low, high = ends.T
    neutral = np.clip(np.zeros(model.nu), low, high)
    closed = np.where(closing, np.where(effects < 0, high, low), neutral)
    opened = np.where(closing, np.where(effects < 0, low, high), neutral)
    there, row = _driven(model, start_row(model, _aside(rig, model)), opened, opened)
    way, _ = _driven(model, row, opened, closed)
    looks = np.unique(np.linspace(0, len(way) - 1, _LOOKS, dtype=int))
    path = np.concatenate([there[-1:], way[looks]])
    shares = np.minimum(1, np.append(0, looks / (_steps(model, _RAMP) - 1)))
    pairs = _meeting(rig, model, sides, path)
    apart = [[_gap(model, qpos, pair)[0] for pair in pairs] for qpos in path]
    gaps: Floats = np.array(apart).mean(axis=1) if pairs else np.zeros(1)
    if not gaps.max() > 0:
        raise SceneError(f"the fingers never come apart; {NO_HAND}")
    return Closing(opened, closed, float(gaps.max()), pairs, path, shares, gaps)


def _without(rig: Rig) -> mujoco.MjModel:
    """Return the model with an object that nothing touches."""
    model = rig.model.__copy__()
    own = model.geom_bodyid == rig.body
    model.geom_contype[own] = model.geom_conaffinity[own] = 0
    return model


def _aside(rig: Rig, model: mujoco.MjModel) -> Floats:
    qpos = within_limits(model)
    qpos[rig.address : rig.address + 3] = _FAR * model.stat.extent
    return qpos


def _designed(rig: Rig, model: mujoco.MjModel, ends: Floats) -> tuple[Floats, Floats]:
    """Return (R, nu) signs of a design, and (R, ngeom, 3) where geoms came to be [m]."""
    count = 2 ** math.ceil(math.log2(model.nu + 1))
    design = np.ones((1, 1))
    while len(design) < count:
        design = np.block([[design, design], [design, -design]])
    signs = np.concatenate([design, -design])[:, 1 : model.nu + 1]
    controls = np.where(signs > 0, ends[:, 1], ends[:, 0])
    steps = max(2, round(_REACH / model.opt.timestep))
    rows = constant(start_row(model, _aside(rig, model)), len(controls), 1)[:, 0]
    rolled = roll(model, rows, np.repeat(controls[:, None], steps, axis=1))
    data, places = mujoco.MjData(model), list[Floats]()
    for qpos in rolled.qpos[~rolled.failed, -1]:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        places.append(data.geom_xpos.copy())
    if not places:
        raise SceneError(f"the actuators throw the hand apart; {NO_HAND}")
    return signs[~rolled.failed], np.array(places)


def _spreads(places: Floats, pairs: Sequence[tuple[int, int]]) -> Floats:
    """Return (R,) mean distances of pairs of geoms [m]."""
    apart = [np.linalg.norm(places[:, one] - places[:, other], axis=1) for one, other in pairs]
    return np.mean(apart, axis=0)


def _effects(signs: Floats, values: Floats) -> Floats:
    """Return main effects (nu, ...): the mean of values where a control is high, less where low."""
    high = signs > 0
    found = [values[each].mean(axis=0) - values[~each].mean(axis=0) for each in high.T]
    return np.nan_to_num(np.array(found))


def _tips(rig: Rig, model: mujoco.MjModel, places: Floats) -> list[int]:
    """Return the geom of each finger that is farthest from the base.

    One finger alone has the geom of the base beside it that it comes nearest.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    origin, tips = data.xpos[rig.base], list[int]()
    for finger in rig.fingers:
        geoms = geoms_of(model, list(finger))
        reach = np.linalg.norm(places[:, geoms] - origin, axis=2).mean(axis=0)
        tips.append(geoms[int(np.argmax(reach))])
    if len(tips) > 1:
        return tips
    fixed = geoms_of(model, fixed_bodies(model, rig.base))
    near = np.linalg.norm(places[:, fixed] - places[:, tips], axis=2).min(axis=0)
    return [*tips, fixed[int(np.argmin(near))]]


def _sides(
    tips: Sequence[int], signs: Floats, places: Floats
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the tips of both sides: of all ways to part them, the one that approaches most.

    A way's approach is the sum of all effects on the mean distance of its two sides. So a thumb is
    found against fingers, which move beside each other.
    """
    pairs = list(combinations(range(len(tips)), 2))
    between = np.zeros((signs.shape[1], len(tips), len(tips)))
    for one, other in pairs:
        effects = _effects(signs, _spreads(places, [(tips[one], tips[other])]))
        between[:, one, other] = between[:, other, one] = effects
    most = len(tips) // 2 if len(tips) <= _PARTED else 1
    ways = [way for size in range(1, most + 1) for way in combinations(range(len(tips)), size)]
    rests = [tuple(tip for tip in range(len(tips)) if tip not in way) for way in ways]
    approach = [
        np.abs(between[:, way][:, :, rest].mean(axis=(1, 2))).sum()
        for way, rest in zip(ways, rests, strict=True)
    ]
    best = int(np.argmax(approach))
    one, other = (tuple(tips[tip] for tip in side[best]) for side in (ways, rests))
    return one, other


def _meeting(
    rig: Rig, model: mujoco.MjModel, sides: tuple[Sequence[int], Sequence[int]], path: Floats
) -> tuple[tuple[int, int], ...]:
    """Return, for fingers of both sides, the geoms that face and approach each other most.

    Fingers that approach half as much as the most are links of others, and left out.
    """
    owners = [[_finger_of(rig, model, tip) for tip in side] for side in sides]
    found = list[tuple[float, tuple[int, int]]]()
    nearest = path[int(np.argmin([_spread_at(model, qpos, sides) for qpos in path]))]
    before, after = (_geoms_at(model, qpos) for qpos in (path[0], nearest))
    for one, other in product(*owners):
        pairs = list(product(one, other))
        opened = np.array([_gap(model, path[0], pair)[0] for pair in pairs])
        closed = np.array([_gap(model, nearest, pair)[0] for pair in pairs])
        approach = opened - np.maximum(closed, 0)
        beside = np.array([_beside(before, after, pair) for pair in pairs])
        alike = approach > _ALIKE * approach.max()
        best = int(np.argmin(np.where(alike, np.maximum(closed, 0) + beside, np.inf)))
        found.append((float(approach[best]), pairs[best]))
    most = max(approach for approach, _ in found)
    return tuple(pair for approach, pair in found if approach > most / 2)


def _finger_of(rig: Rig, model: mujoco.MjModel, tip: int) -> list[int]:
    """Return the geoms of the finger that a geom belongs to, or of the base."""
    body = int(model.geom_bodyid[tip])
    for finger in rig.fingers:
        if body in finger:
            return geoms_of(model, list(finger))
    return geoms_of(model, fixed_bodies(model, rig.base))


def _geoms_at(model: mujoco.MjModel, qpos: Floats) -> Floats:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    return data.geom_xpos.copy()


def _spread_at(
    model: mujoco.MjModel, qpos: Floats, sides: tuple[Sequence[int], Sequence[int]]
) -> float:
    return float(_spreads(_geoms_at(model, qpos)[None], list(product(*sides)))[0])


def _beside(before: Floats, after: Floats, pair: tuple[int, int]) -> float:
    """Return how far geoms' middles are beside each other, across the way that they come [m]."""
    apart, still = (places[pair[1]] - places[pair[0]] for places in (before, after))
    way = still - apart
    way /= max(float(np.linalg.norm(way)), 1e-12)
    return float(np.linalg.norm(apart - way * (apart @ way)))


def _driven(
    model: mujoco.MjModel, row: Floats, begin: Floats, end: Floats
) -> tuple[Floats, Floats]:
    """Return the configurations from one control to another until they rest, and the state."""
    path, row = _ramp(model, row, begin, end)
    paths = [path]
    while sum(map(len, paths)) * model.opt.timestep < _MOST:
        rolled = _rest(model, row, end)
        paths.append(rolled[0])
        moved = np.abs(rolled[0][-1] - rolled[0][0]).max()
        row = rolled[1]
        if moved < 1e-4 * max(1e-9, np.abs(paths[0][0] - rolled[0][-1]).max()):
            break
    return np.concatenate(paths), row


def _ramp(model: mujoco.MjModel, row: Floats, begin: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Return the configurations on the way to a control within half a second, and the state."""
    share = np.linspace(0, 1, _steps(model, _RAMP))[:, None]
    controls = begin + share * (end - begin)
    return _rolled(model, row, controls)


def _rest(model: mujoco.MjModel, row: Floats, control: Floats) -> tuple[Floats, Floats]:
    """Return the configurations of a quarter of a second with a control, and the state."""
    return _rolled(model, row, constant(control, 1, _steps(model, _PART))[0])


def _steps(model: mujoco.MjModel, seconds: float) -> int:
    return max(2, round(seconds / model.opt.timestep))


def _rolled(model: mujoco.MjModel, row: Floats, controls: Floats) -> tuple[Floats, Floats]:
    rolled = roll(model, row[None], controls[None])
    if rolled.failed[0] or not np.isfinite(rolled.qpos).all():
        raise SceneError("MuJoCo gives up as the fingers close: the hand itself is unstable")
    return rolled.qpos[0], rolled.rows[0]


def _gap(model: mujoco.MjModel, qpos: Floats, pair: tuple[int, int]) -> tuple[float, Floats]:
    """Return the clearance of two geoms [m], and the points (2, 3) between which it is."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    ends = np.zeros(6)
    gap = mujoco.mj_geomDistance(model, data, *pair, 10 * model.stat.extent, ends)
    return float(gap), ends.reshape(2, 3)


def fitted(rig: Rig, closing: Closing, factor: float = 1.0) -> GrippedObject:
    """Return the usual object as a hand can hold it: no smaller than it closes, nor too large.

    It keeps a fifth of the way from both ends, and reaches past the fingers on either side; by a
    factor less where they have no room for it.
    """
    least, most = max(float(closing.gaps.min()), 0.0), closing.opening
    across, side, out = USUAL.size
    kept = _INSIDE * (most - least)
    width = float(np.clip(across, least + kept, most - kept))
    shrunk = min(1.0, width / across)
    at = int(np.flatnonzero(closing.gaps >= width)[-1])
    ends = np.array([_gap(rig.model, closing.path[at], pair)[1] for pair in closing.pairs])
    point, turn = _met(rig, closing, at)
    beside = float(np.abs((ends - point) @ turn[:, 1]).max())
    size = (width, max(shrunk * side, _PAST * 2 * beside), shrunk * out)
    fits = replace(USUAL, size=size).scaled(factor)
    return replace(fits, size=(max(fits.size[0], least + kept), *fits.size[1:]))


def pads_centre(rig: Rig, closing: Closing) -> Floats | None:
    """Return where pads press on a box (3,) [m], whose faces are theirs; None if they hold none.

    Nearest points of flat pads may be their corners, between which what is round rolls out.
    """
    try:
        held = squeeze(rig, closing)
    except SceneError:
        return None
    return held.points.mean(axis=0) if held.is_held else None


def place(rig: Rig, closing: Closing) -> tuple[Floats, Floats]:
    """Return where an object of the rig's width is met (3,) [m], and a turn as Squeeze has it."""
    width = 2 * rig.half[0]
    if not closing.gaps.min() < width < closing.opening:
        raise SceneError(
            f"the object is {1e3 * width:.3g} mm wide, and the fingers close from "
            f"{1e3 * closing.opening:.3g} to {1e3 * closing.gaps.min():.3g} mm; give one in "
            "between with --object"
        )
    return _met(rig, closing, int(np.flatnonzero(closing.gaps >= width)[-1]))


def _met(rig: Rig, closing: Closing, at: int) -> tuple[Floats, Floats]:
    """Return the middle of the pads in a configuration of their path, and a turn there.

    Its first axis is the way on which the geoms come, not that between their nearest points, which
    on flat or wedged pads may be corners.
    """
    earlier = closing.gaps > closing.gaps[at] + _WAY * closing.opening
    before = int(np.flatnonzero(earlier)[-1]) if earlier.any() else 0
    found = [_gap(rig.model, closing.path[at], pair)[1] for pair in closing.pairs]
    ends: Floats = np.array(found).mean(axis=0)
    apart = [
        np.mean([places[other] - places[one] for one, other in closing.pairs], axis=0)
        for places in (_geoms_at(rig.model, closing.path[each]) for each in (before, at))
    ]
    axis = apart[0] - apart[1] if before < at else ends[1] - ends[0]
    point = ends.mean(axis=0)
    return point, _turn(rig, point, axis / np.linalg.norm(axis))


def _turn(rig: Rig, point: Floats, axis: Floats) -> Floats:
    """Return a turn as Squeeze has it, out of the hand being away from the base."""
    data = mujoco.MjData(rig.model)
    mujoco.mj_kinematics(rig.model, data)
    out = point - data.xpos[rig.base]
    out -= axis * (out @ axis)
    if np.linalg.norm(out) < _ON_AXIS * rig.half.max():
        out[:] = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    return frame(axis, out)


def frame(across: Floats, out: Floats) -> Floats:
    """Return a turn (3, 3) as Squeeze has it, of two directions (3,) at right angles."""
    axes = np.empty((3, 3))
    axes[:, 0] = across / np.linalg.norm(across)
    axes[:, 2] = out / np.linalg.norm(out)
    axes[:, 1] = np.cross(axes[:, 2], axes[:, 0])
    return axes


def squeeze(rig: Rig, closing: Closing, centre: Floats | None = None) -> Squeeze:
    """Close a hand on its object, which is centred on the pads first.

    Where it slips out between the outermost geoms, it is held still until the fingers rest, and
    then tried nearer to the base. Where opened fingers lie in its place, they begin further on.

    Args:
        rig: hand and object.
        closing: of the hand, for this model.
        centre: (3,) of the pads, if that is known [m].
    """
    point, turn = place(rig, closing)
    if centre is not None:
        across = (centre - point) @ turn
        point = point + turn @ (across * [0, 1, 1])
        turn = _turn(rig, point, turn[:, 0])
    reach = 2 * rig.half[2]
    deep, tried = list[float](), list[Approach]()
    for depth in _DEPTHS:
        overlap, approach = _with_room(rig, closing, point - depth * reach * turn[:, 2], turn)
        deep.append(overlap)
        if overlap > _OVERLAP * rig.half[0]:
            continue
        tried += [approach, replace(approach, is_still=True)]
    if not tried:
        raise SceneError(
            f"the object does not fit between the opened fingers: it begins {1e3 * min(deep):.3g} "
            "mm deep in them; give a smaller or flatter one with --object"
        )
    for approach in tried:
        first = close_at(rig, closing, approach, closing.closed)
        if not first.is_held:
            continue
        # Nearest points of flat pads may be their corners: the pads' centre is where they press.
        across = (first.points.mean(axis=0) - approach.point) @ approach.turn
        if np.linalg.norm(across[1:]) < _CENTRED * rig.half.max():
            return first
        inner = approach.point + approach.turn @ (across * [0, 1, 1])
        centred = replace(approach, point=inner, turn=_turn(rig, inner, approach.turn[:, 0]))
        second = close_at(rig, closing, centred, closing.closed)
        return second if second.is_held else first
    return close_at(rig, closing, tried[0], closing.closed)


def _with_room(rig: Rig, closing: Closing, point: Floats, turn: Floats) -> tuple[float, Approach]:
    """Return how deep an object begins in the hand [m], and where on their path fingers begin.

    That is opened, or else where it first has room, as between fingers that curl around it.
    """
    found = list[tuple[float, Approach]]()
    for start in (0, *np.flatnonzero(closing.gaps >= 2 * rig.half[0]).tolist()):
        approach = Approach(point, turn, start)
        found.append((_overlap(rig, closing, approach), approach))
        if found[-1][0] <= _OVERLAP * rig.half[0]:
            break
    return min(found, key=lambda one: one[0])


def _overlap(rig: Rig, closing: Closing, approach: Approach) -> float:
    """Return how deep an object begins in the hand [m]."""
    data = placed(rig.model, start_row(rig.model, _begin(rig, closing, approach)))
    return max((contact.depth for contact in contacts_of(rig.model, data, rig.body)), default=0.0)


def _begin(rig: Rig, closing: Closing, approach: Approach) -> Floats:
    """Return the configuration of a hand and its object before the fingers close."""
    qpos = closing.path[approach.place].copy()
    qpos[rig.address : rig.address + 3] = approach.point - approach.turn @ rig.middle
    mujoco.mju_mat2Quat(qpos[rig.address + 3 : rig.address + 7], approach.turn.ravel())
    return qpos


def close_at(rig: Rig, closing: Closing, approach: Approach, control: Floats) -> Squeeze:
    """Close a hand to a control on its object until it rests."""
    row = start_row(rig.model, _begin(rig, closing, approach))
    begin = closing.control(float(closing.shares[approach.place]))
    if not approach.is_still:
        path, row = _ramp(rig.model, row, begin, control)
        return replace(_settled(rig, row, control, approach.turn, [path]), approach=approach)
    heavy = _held_still(rig)
    path, row = _ramp(heavy.model, row, begin, control)
    before = _settled(heavy, row, control, approach.turn, [path])
    found = _settled(rig, before.row, control, approach.turn, [before.path])
    return replace(found, approach=approach)


def _held_still(rig: Rig) -> Rig:
    """Return a rig whose object weighs so much that fingers do not move it."""
    model = rig.model.__copy__()
    model.body_mass[rig.body] *= _UNMOVED
    model.body_inertia[rig.body] *= _UNMOVED
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return replace(rig, model=model)


def _settled(
    rig: Rig, row: Floats, control: Floats, turn: Floats, paths: Sequence[Floats]
) -> Squeeze:
    """Go on with a control after some paths until object, fingers and forces rest."""
    paths, before, begun, lasted = list(paths), np.inf, paths[0], _RAMP
    while True:
        part, row = _rest(rig.model, row, control)
        paths.append(part)
        pressed = pressing(rig, row, control, turn, np.concatenate(paths))
        total, lasted = sum(pressed.forces), lasted + _PART
        still = _is_still(rig, begun, part, held=pressed.is_held)
        if (still and abs(total - before) <= _STEADY * total) or lasted > _MOST:
            return pressed
        before = total


def _is_still(rig: Rig, path: Floats, part: Floats, *, held: bool) -> bool:
    """Return whether a held object rests at the end of a path; or fingers that are yet to meet."""
    if held:
        ends = body_frames(rig.model, part[[0, -1]], rig.body, rig.base)
        return float(np.linalg.norm(ends[1] - ends[0])) <= _RESTING * _PART
    fingers = np.delete(np.arange(rig.model.nq), np.arange(rig.address, rig.address + 7))
    begin, before, end = (pose[fingers] for pose in (path[0], part[0], part[-1]))
    return bool(np.abs(end - before).max() <= _ARRIVED * np.abs(end - begin).max())


def pressing(rig: Rig, row: Floats, control: Floats, turn: Floats, path: Floats) -> Squeeze:
    """Return what presses on the object in a state."""
    data = placed(rig.model, row)
    forces = np.zeros(len(rig.fingers) + 1)
    found = contacts_of(rig.model, data, rig.body)
    for contact in found:
        body = int(rig.model.geom_bodyid[contact.geom])
        side = next((n for n, finger in enumerate(rig.fingers) if body in finger), -1)
        forces[side] += contact.force
    return Squeeze(
        row=row,
        control=control,
        turn=turn,
        path=path,
        forces=tuple(forces.tolist()),
        depth=max((contact.depth for contact in found), default=0.0),
        points=np.array([contact.point for contact in found]).reshape(-1, 3),
        geoms=tuple(sorted({contact.geom for contact in found})),
        approach=None,
    )
