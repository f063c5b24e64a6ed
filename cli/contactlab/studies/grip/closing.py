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


@dataclass(frozen=True)
class Closing:
    """How a hand closes.

    Attributes:
        opened, closed: (nu,) controls.
        start: (nq,) configuration with fingers opened, without an object.
        opening: largest clearance of the surfaces that meet [m].
        pairs: of geoms that meet, the first of one side, the second of the other.
        path: (K, nq) configurations as they close on nothing, the first opened.
        gaps: (K,) mean clearance of the pairs there [m].
    """

    opened: Floats
    closed: Floats
    start: Floats
    opening: float
    pairs: tuple[tuple[int, int], ...]
    path: Floats
    gaps: Floats


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
        begun: (3,) where the object was before the fingers closed, in the world's frame [m].
    """

    row: Floats
    control: Floats
    turn: Floats
    path: Floats
    forces: tuple[float, ...]
    depth: float
    points: Floats
    geoms: tuple[int, ...]
    begun: Floats

    @property
    def is_held(self) -> bool:
        """True if two sides press on the object."""
        return sum(force > 0 for force in self.forces) > 1


def find_closing(rig: Rig) -> Closing:
    """Drive a hand open and closed on nothing.

    Which end of an actuator closes is its main effect on the distance of the fingers' outermost
    geoms, in a two-level design of all actuators (Hadamard, folded over), since a finger that
    curls alone goes away from its neighbours. Sides are those that then move against each other;
    what does little to the distance between sides stays where it is.

    Raises:
        SceneError: no actuator brings fingers together.
    """
    model = _without(rig)
    ends = control_ends(model)
    signs, places = _designed(rig, model, ends)
    tips = _tips(rig, model, places)
    effects = _effects(signs, _spreads(places, list(combinations(tips, 2))))
    sides = _sides(tips, signs, places, effects)
    across = list(product(*sides))
    effects = _effects(signs, _spreads(places, across))
    closing = np.abs(effects) > max(_EFFECT * np.abs(effects).max(), 1e-9 * model.stat.extent)
    if not closing.any():
        raise SceneError(f"no actuator brings two fingers together; {NO_HAND}")
    low, high = ends.T
    neutral = np.clip(np.zeros(model.nu), low, high)
    closed = np.where(closing, np.where(effects < 0, high, low), neutral)
    opened = np.where(closing, np.where(effects < 0, low, high), neutral)
    there, row = _driven(model, start_row(model, _aside(rig, model)), opened, opened)
    way, _ = _driven(model, row, opened, closed)
    path = np.concatenate(
        [there[-1:], way[np.unique(np.linspace(0, len(way) - 1, _LOOKS, dtype=int))]]
    )
    pairs = _meeting(rig, model, sides, path)
    apart = [[_gap(model, qpos, pair)[0] for pair in pairs] for qpos in path]
    gaps: Floats = np.array(apart).mean(axis=1) if pairs else np.zeros(1)
    if not gaps.max() > 0:
        raise SceneError(f"the fingers never come apart; {NO_HAND}")
    # Fingers that curl may first go apart.
    begin = int(gaps.argmax())
    return Closing(opened, closed, path[0], float(gaps.max()), pairs, path[begin:], gaps[begin:])


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
    tips: Sequence[int], signs: Floats, places: Floats, effects: Floats
) -> tuple[list[int], list[int]]:
    """Return the tips that move one way as the hand closes, and those that move the other way.

    The way is the principal direction of what the effects of all actuators sum up to; with one
    that moves, the other stays.
    """
    closes = -np.sign(effects)
    moved = np.array([closes @ _effects(signs, places[:, tip]) for tip in tips])
    away = moved - moved.mean(axis=0)
    direction = np.linalg.svd(away)[2][0]
    along = away @ direction
    one = [tip for tip, way in zip(tips, along, strict=True) if way > 0]
    other = [tip for tip, way in zip(tips, along, strict=True) if way <= 0]
    if not one or not other:
        raise SceneError(f"the fingers move alike and never against each other; {NO_HAND}")
    return one, other


def _meeting(
    rig: Rig, model: mujoco.MjModel, sides: tuple[list[int], list[int]], path: Floats
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


def _spread_at(model: mujoco.MjModel, qpos: Floats, sides: tuple[list[int], list[int]]) -> float:
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
    steps = max(2, round(_RAMP / model.opt.timestep))
    share = np.linspace(0, 1, steps)[:, None]
    controls = begin + share * (end - begin)
    return _rolled(model, row, controls)


def _rest(model: mujoco.MjModel, row: Floats, control: Floats) -> tuple[Floats, Floats]:
    """Return the configurations of a quarter of a second with a control, and the state."""
    steps = max(2, round(_PART / model.opt.timestep))
    return _rolled(model, row, constant(control, 1, steps)[0])


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


def fitted(rig: Rig, closing: Closing) -> GrippedObject:
    """Return the usual object as a hand can hold it: no smaller than it closes, nor too large.

    It keeps a fifth of the way from both ends, and reaches past the fingers on either side.
    """
    least, most = max(float(closing.gaps.min()), 0.0), closing.opening
    across, side, out = USUAL.size
    width = float(
        np.clip(across, least + _INSIDE * (most - least), most - _INSIDE * (most - least))
    )
    factor = min(1.0, width / across)
    at = int(np.flatnonzero(closing.gaps >= width)[-1])
    ends = np.array([_gap(rig.model, closing.path[at], pair)[1] for pair in closing.pairs])
    point, turn = _met(rig, closing, at)
    beside = float(np.abs((ends - point) @ turn[:, 1]).max())
    return replace(USUAL, size=(width, max(factor * side, _PAST * 2 * beside), factor * out))


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

    Where it slips out between the outermost geoms, it is tried nearer to the base.

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
    control = closing.closed
    reach, deep = 2 * rig.half[2], list[float]()
    for depth in _DEPTHS:
        inner = point - depth * reach * turn[:, 2]
        deep.append(_overlap(rig, closing, inner, turn))
        if deep[-1] > _OVERLAP * rig.half[0]:
            continue
        first = close_at(rig, closing, inner, turn, control)
        if not first.is_held:
            continue
        # Nearest points of flat pads may be their corners: the pads' centre is where they press.
        across = (first.points.mean(axis=0) - inner) @ turn
        if np.linalg.norm(across[1:]) < _CENTRED * rig.half.max():
            return first
        inner = inner + turn @ (across * [0, 1, 1])
        second = close_at(rig, closing, inner, _turn(rig, inner, turn[:, 0]), control)
        return second if second.is_held else first
    if min(deep) > _OVERLAP * rig.half[0]:
        raise SceneError(
            f"the object does not fit between the opened fingers: it begins {1e3 * min(deep):.3g} "
            "mm deep in them; give a smaller or flatter one with --object"
        )
    return close_at(rig, closing, point, turn, control)


def _overlap(rig: Rig, closing: Closing, point: Floats, turn: Floats) -> float:
    """Return how deep an object begins in the opened hand [m]."""
    data = placed(rig.model, start_row(rig.model, _begin(rig, closing, point, turn)))
    return max((contact.depth for contact in contacts_of(rig.model, data, rig.body)), default=0.0)


def _begin(rig: Rig, closing: Closing, point: Floats, turn: Floats) -> Floats:
    """Return the configuration of an opened hand with the object's middle at a point."""
    qpos = closing.start.copy()
    qpos[rig.address : rig.address + 3] = point - turn @ rig.middle
    mujoco.mju_mat2Quat(qpos[rig.address + 3 : rig.address + 7], turn.ravel())
    return qpos


def close_at(rig: Rig, closing: Closing, point: Floats, turn: Floats, control: Floats) -> Squeeze:
    """Close a hand to a control on its object, which begins at a point and turn, until it rests."""
    row, model = start_row(rig.model, _begin(rig, closing, point, turn)), rig.model
    path, row = _ramp(model, row, closing.opened, control)
    paths, before = [path], np.inf
    while True:
        rolled = _rest(model, row, control)
        paths.append(rolled[0])
        row = rolled[1]
        pressed = pressing(rig, row, control, turn, np.concatenate(paths))
        total = sum(pressed.forces)
        lasted = sum(map(len, paths)) * model.opt.timestep
        still = _is_still(rig, path, rolled[0], held=pressed.is_held)
        if (still and abs(total - before) <= _STEADY * total) or lasted > _MOST:
            return replace(pressed, begun=point)
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
        begun=data.xipos[rig.body].copy(),
    )
