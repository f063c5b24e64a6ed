"""Closes a hand: the closing end of each control range, the contact points, and the squeeze."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.studies.grip.fingers import (
    NO_HAND,
    control_ranges,
    fixed_bodies,
    geoms_of,
    pose_within_limits,
)
from contactlab.studies.grip.grip_fixture import GripFixture
from contactlab.studies.grip.gripped_object import DEFAULT_OBJECT, GrippedObject
from contactlab.studies.grip.rollouts import (
    body_frames,
    data_at,
    find_contacts,
    repeat_input,
    roll_out,
    start_row,
)


@dataclass(frozen=True)
class _ClosingProtocol:
    """How a hand closes on nothing, and then on its object.

    Times suit hands that close within half a second, as position servos of grippers do.

    Attributes:
        reach_seconds: time to drive every actuator to an end of its range.
        ramp_seconds: time to close the fingers.
        part_seconds: time between two looks at whether the fingers rest.
        most_seconds: time after which fingers that never rest are judged as they are.
        least_effect: share of the largest effect of an actuator that counts as closing.
        alike_approach: pairs of geoms are alike if they approach by this share of the most.
        most_split_fingers: with more fingers, only single fingers are tried as one side, because
            the number of splits doubles with each finger.
        path_samples: configurations of the closing path.
        approach_share: share of the opening that the direction of approach is measured over.
        travel_margin: share of the closing travel that the default object keeps from both ends.
        overhang: extent of the default object, over that of the fingers.
        steady_force: change of the total force per part, as a share, that counts as steady.
        arrived_share: motion of the fingers per part, over their travel, that counts as rest.
        resting_speed: speed of an object at rest [m/s]: a quarter of the creep limit.
        centered_share: offset of the object from the pads, over its largest half extent.
        on_axis_share: shorter directions out of the hand, over that extent, say nothing.
        pad_tilt: half the tilt of a pad that finds the middle of flat pads [rad].
        depths: places to try, in extents of the object toward the base, then away from it.
        overlap_share: largest overlap at the start, in half widths of the object.
        far_extents: distance of the unused object, in extents of the model.
        unmoved_mass: factor of the mass of an object that is held still, as on a table.
    """

    reach_seconds: float = 1.0
    ramp_seconds: float = 0.5
    part_seconds: float = 0.25
    most_seconds: float = 4.0
    least_effect: float = 0.1
    alike_approach: float = 0.9
    most_split_fingers: int = 12
    path_samples: int = 60
    approach_share: float = 0.1
    travel_margin: float = 0.2
    overhang: float = 1.25
    steady_force: float = 2e-3
    arrived_share: float = 1e-3
    resting_speed: float = 2.5e-5
    centered_share: float = 1e-3
    on_axis_share: float = 1e-3
    pad_tilt: float = 1e-3
    depths: tuple[float, ...] = (0.0, 0.5, 1.0, 1.5, -0.25, -0.5)
    overlap_share: float = 0.02
    far_extents: float = 1e3
    unmoved_mass: float = 1e6


_CLOSING = _ClosingProtocol()


@dataclass(frozen=True)
class Closing:
    """How a hand closes.

    Attributes:
        open_controls, closed_controls: (nu,) controls.
        opening: largest clearance of the facing surfaces [m].
        pairs: facing geoms, one of each side.
        path: (K, nq) configurations while the hand closes on nothing, the first opened.
        shares: (K,) share of the way from opened to closed controls.
        gaps: (K,) mean clearance of the pairs [m].
    """

    open_controls: Floats
    closed_controls: Floats
    opening: float
    pairs: tuple[tuple[int, int], ...]
    path: Floats
    shares: Floats
    gaps: Floats

    def control_at(self, share: float) -> Floats:
        """Return (nu,) controls at a share of the way from opened to closed."""
        return self.open_controls + share * (self.closed_controls - self.open_controls)


@dataclass(frozen=True)
class Approach:
    """How fingers approach an object.

    Attributes:
        point: (3,) middle of the object before they close, in the world frame [m].
        turn: (3, 3) rotation of the object; see `Squeeze`.
        place: index on the closing path where the fingers start; 0 is opened.
        is_still: whether the object is fixed until the fingers rest, as on a table.
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
        control: (nu,) holding control.
        turn: (3, 3) columns that point, in the world frame, from finger to finger, sideways, and
            out of the hand.
        path: (N, nq) configurations while the fingers closed.
        forces: normal force of each finger [N]; the base comes last.
        depth: of the deepest contact [m].
        points: (K, 3) contact points [m].
        geoms: geoms of the hand that touch it.
        approach: how the fingers approached; None in a keyframe.
        sucks: whether adhesion holds it, so that one side is enough.
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
    sucks: bool = False

    @property
    def is_held(self) -> bool:
        """True if two sides press on the object, or one that adheres to it."""
        return sum(force > 0 for force in self.forces) > (0 if self.sucks else 1)


def find_closing(fixture: GripFixture) -> Closing:
    """Drive a hand open and closed on nothing.

    The closing end of an actuator is the sign of its main effect on the distance of the fingers'
    outermost geoms, in a two-level design of all actuators (Hadamard, folded over). The distance is
    that between two sides, since a finger that curls alone moves away from its neighbors. Actuators
    with little effect keep their neutral control.

    Raises:
        SceneError: no actuator brings fingers together.
    """
    # The hand closes on nothing: its object touches no geom.
    model = fixture.model.__copy__()
    own = model.geom_bodyid == fixture.body
    model.geom_contype[own] = model.geom_conaffinity[own] = 0
    ends = control_ranges(model)
    signs, places = _run_design(fixture, model, ends)
    sides = _split_sides(_find_fingertips(fixture, model, places), signs, places)
    effects = _main_effects(signs, _mean_distances(places, list(product(*sides))))
    closing = np.abs(effects) > max(
        _CLOSING.least_effect * np.abs(effects).max(), SUM_ROUNDING * model.stat.extent
    )
    if not closing.any():
        raise SceneError(f"no actuator brings two fingers together; {NO_HAND}")
    low, high = ends.T
    neutral = np.clip(np.zeros(model.nu), low, high)
    closed = np.where(closing, np.where(effects < 0, high, low), neutral)
    opened = np.where(closing, np.where(effects < 0, low, high), neutral)
    there, row = _drive_between(
        model, start_row(model, _object_aside(fixture, model)), opened, opened
    )
    way, _ = _drive_between(model, row, opened, closed)
    looks = np.unique(np.linspace(0, len(way) - 1, _CLOSING.path_samples, dtype=int))
    path = np.concatenate([there[-1:], way[looks]])
    shares = np.minimum(1, np.append(0, looks / (_count_steps(model, _CLOSING.ramp_seconds) - 1)))
    pairs = _facing_pairs(fixture, model, sides, path)
    apart = [[_measure_clearance(model, qpos, pair)[0] for pair in pairs] for qpos in path]
    gaps: Floats = np.array(apart).mean(axis=1) if pairs else np.zeros(1)
    if not gaps.max() > 0:
        raise SceneError(f"the fingers never open; {NO_HAND}")
    return Closing(opened, closed, float(gaps.max()), pairs, path, shares, gaps)


def _object_aside(fixture: GripFixture, model: mujoco.MjModel) -> Floats:
    qpos = pose_within_limits(model)
    qpos[fixture.address : fixture.address + 3] = _CLOSING.far_extents * model.stat.extent
    return qpos


def _run_design(fixture: GripFixture, model: mujoco.MjModel, ends: Floats) -> tuple[Floats, Floats]:
    """Return (R, nu) signs of a design, and (R, ngeom, 3) final positions of geoms [m]."""
    count = 2 ** math.ceil(math.log2(model.nu + 1))
    design = np.ones((1, 1))
    while len(design) < count:
        design = np.block([[design, design], [design, -design]])
    signs = np.concatenate([design, -design])[:, 1 : model.nu + 1]
    controls = np.where(signs > 0, ends[:, 1], ends[:, 0])
    steps = max(2, round(_CLOSING.reach_seconds / model.opt.timestep))
    rows = repeat_input(start_row(model, _object_aside(fixture, model)), len(controls), 1)[:, 0]
    rolled = roll_out(model, rows, np.repeat(controls[:, None], steps, axis=1))
    data, places = mujoco.MjData(model), list[Floats]()
    for qpos in rolled.qpos[~rolled.failed, -1]:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        places.append(data.geom_xpos.copy())
    if not places:
        raise SceneError(f"the actuators make the hand unstable; {NO_HAND}")
    return signs[~rolled.failed], np.array(places)


def _mean_distances(places: Floats, pairs: Sequence[tuple[int, int]]) -> Floats:
    """Return (R,) mean distances of pairs of geoms [m]."""
    apart = [np.linalg.norm(places[:, one] - places[:, other], axis=1) for one, other in pairs]
    return np.mean(apart, axis=0)


def _main_effects(signs: Floats, values: Floats) -> Floats:
    """Return main effects (nu, ...): the mean of values where a control is high, less where low."""
    high = signs > 0
    effects = [values[each].mean(axis=0) - values[~each].mean(axis=0) for each in high.T]
    return np.nan_to_num(np.array(effects))


def _find_fingertips(fixture: GripFixture, model: mujoco.MjModel, places: Floats) -> list[int]:
    """Return the geom of each finger that is farthest from the base.

    A single finger is paired with the geom of the base that it comes nearest to.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    origin, tips = data.xpos[fixture.base], list[int]()
    for finger in fixture.fingers:
        geoms = geoms_of(model, list(finger))
        reach = np.linalg.norm(places[:, geoms] - origin, axis=2).mean(axis=0)
        tips.append(geoms[int(np.argmax(reach))])
    if len(tips) > 1:
        return tips
    fixed = geoms_of(model, fixed_bodies(model, fixture.base))
    near = np.linalg.norm(places[:, fixed] - places[:, tips], axis=2).min(axis=0)
    return [*tips, fixed[int(np.argmin(near))]]


def _split_sides(
    tips: Sequence[int], signs: Floats, places: Floats
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the tips of two sides: the split of the fingers that approaches most.

    The approach of a split is the sum of all effects on the mean distance of its sides. This finds
    a thumb opposite fingers that move side by side.
    """
    pairs = list(combinations(range(len(tips)), 2))
    between = np.zeros((signs.shape[1], len(tips), len(tips)))
    for one, other in pairs:
        effects = _main_effects(signs, _mean_distances(places, [(tips[one], tips[other])]))
        between[:, one, other] = between[:, other, one] = effects
    most = len(tips) // 2 if len(tips) <= _CLOSING.most_split_fingers else 1
    ways = [way for size in range(1, most + 1) for way in combinations(range(len(tips)), size)]
    rests = [tuple(tip for tip in range(len(tips)) if tip not in way) for way in ways]
    approach = [
        np.abs(between[:, way][:, :, rest].mean(axis=(1, 2))).sum()
        for way, rest in zip(ways, rests, strict=True)
    ]
    best = int(np.argmax(approach))
    one, other = (tuple(tips[tip] for tip in side[best]) for side in (ways, rests))
    return one, other


def _facing_pairs(
    fixture: GripFixture,
    model: mujoco.MjModel,
    sides: tuple[Sequence[int], Sequence[int]],
    path: Floats,
) -> tuple[tuple[int, int], ...]:
    """Return the geoms of both sides that face and approach each other most.

    Fingers with less than half of the largest approach are links of others, and are skipped.
    """
    owners = [[_finger_geoms(fixture, model, tip) for tip in side] for side in sides]
    approaches = list[tuple[float, tuple[int, int]]]()
    # The fingers are nearest where the mean distance of their tips is least.
    tips = list(product(*sides))
    distances = [_mean_distances(_geoms_at(model, qpos)[None], tips)[0] for qpos in path]
    nearest = path[int(np.argmin(distances))]
    before, after = (_geoms_at(model, qpos) for qpos in (path[0], nearest))
    for one, other in product(*owners):
        pairs = list(product(one, other))
        opened = np.array([_measure_clearance(model, path[0], pair)[0] for pair in pairs])
        closed = np.array([_measure_clearance(model, nearest, pair)[0] for pair in pairs])
        approach = opened - np.maximum(closed, 0)
        offsets = np.array([_lateral_offset(before, after, pair) for pair in pairs])
        alike = approach > _CLOSING.alike_approach * approach.max()
        best = int(np.argmin(np.where(alike, np.maximum(closed, 0) + offsets, np.inf)))
        approaches.append((float(approach[best]), pairs[best]))
    most = max(approach for approach, _ in approaches)
    return tuple(pair for approach, pair in approaches if approach > most / 2)


def _finger_geoms(fixture: GripFixture, model: mujoco.MjModel, tip: int) -> list[int]:
    """Return the geoms of the finger that a geom belongs to, or of the base."""
    body = int(model.geom_bodyid[tip])
    for finger in fixture.fingers:
        if body in finger:
            return geoms_of(model, list(finger))
    return geoms_of(model, fixed_bodies(model, fixture.base))


def _geoms_at(model: mujoco.MjModel, qpos: Floats) -> Floats:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    return data.geom_xpos.copy()


def _lateral_offset(before: Floats, after: Floats, pair: tuple[int, int]) -> float:
    """Return the lateral offset of the middles of two geoms, across their approach [m]."""
    apart, still = (places[pair[1]] - places[pair[0]] for places in (before, after))
    way = still - apart
    way /= max(float(np.linalg.norm(way)), 1e-12)
    return float(np.linalg.norm(apart - way * (apart @ way)))


def _drive_between(
    model: mujoco.MjModel, row: Floats, begin: Floats, end: Floats
) -> tuple[Floats, Floats]:
    """Drive from one control to another until the hand rests; return configurations and state."""
    path, row = _ramp_control(model, row, begin, end)
    paths = [path]
    while sum(map(len, paths)) * model.opt.timestep < _CLOSING.most_seconds:
        rolled = _hold_control(model, row, end)
        paths.append(rolled[0])
        moved = np.abs(rolled[0][-1] - rolled[0][0]).max()
        row = rolled[1]
        if moved < 1e-4 * max(1e-9, np.abs(paths[0][0] - rolled[0][-1]).max()):
            break
    return np.concatenate(paths), row


def _ramp_control(
    model: mujoco.MjModel, row: Floats, begin: Floats, end: Floats
) -> tuple[Floats, Floats]:
    """Ramp to a control within half a second; return configurations and state."""
    share = np.linspace(0, 1, _count_steps(model, _CLOSING.ramp_seconds))[:, None]
    controls = begin + share * (end - begin)
    return _roll_one(model, row, controls)


def _hold_control(model: mujoco.MjModel, row: Floats, control: Floats) -> tuple[Floats, Floats]:
    """Hold a control for a quarter of a second; return configurations and state."""
    return _roll_one(
        model, row, repeat_input(control, 1, _count_steps(model, _CLOSING.part_seconds))[0]
    )


def _count_steps(model: mujoco.MjModel, seconds: float) -> int:
    return max(2, round(seconds / model.opt.timestep))


def _roll_one(model: mujoco.MjModel, row: Floats, controls: Floats) -> tuple[Floats, Floats]:
    rolled = roll_out(model, row[None], controls[None])
    if rolled.failed[0] or not np.isfinite(rolled.qpos).all():
        raise SceneError("MuJoCo gives up while the fingers close: the hand itself is unstable")
    return rolled.qpos[0], rolled.rows[0]


def _measure_clearance(
    model: mujoco.MjModel, qpos: Floats, pair: tuple[int, int]
) -> tuple[float, Floats]:
    """Return the clearance of two geoms [m], and its end points (2, 3)."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    ends = np.zeros(6)
    gap = mujoco.mj_geomDistance(model, data, *pair, 10 * model.stat.extent, ends)
    return float(gap), ends.reshape(2, 3)


def _find_pad_ends(model: mujoco.MjModel, closing: Closing, at: int) -> Floats:
    # The nearest points (K, 2, 3) of each pair [m]: their means while a pad is tilted to each side.
    data = mujoco.MjData(model)
    data.qpos[:] = closing.path[at]
    mujoco.mj_kinematics(model, data)
    upright, turn, ends = data.geom_xmat.copy(), np.empty(9), np.zeros(6)
    tilts = np.array([*product((-_CLOSING.pad_tilt, _CLOSING.pad_tilt), repeat=3)])
    found = np.empty((len(closing.pairs), len(tilts), 2, 3))
    for place, pair in enumerate(closing.pairs):
        for number, tilt in enumerate(tilts):
            mujoco.mju_quat2Mat(turn, np.array([1.0, *tilt]) / math.hypot(1.0, *tilt))
            tilted = turn.reshape(3, 3) @ upright[pair[1]].reshape(3, 3)
            data.geom_xmat[pair[1]] = tilted.ravel()
            mujoco.mj_geomDistance(model, data, *pair, 10 * model.stat.extent, ends)
            found[place, number] = ends.reshape(2, 3)
        data.geom_xmat[pair[1]] = upright[pair[1]]
    return found.mean(axis=1)


def fit_object(fixture: GripFixture, closing: Closing, factor: float = 1.0) -> GrippedObject:
    """Return the default object, scaled to fit the hand.

    It keeps a margin of a fifth of the closing travel at both ends, and overhangs the fingers on
    either side. A factor scales it further if the fingers have no room.
    """
    least, most = max(float(closing.gaps.min()), 0.0), closing.opening
    across, side, out = DEFAULT_OBJECT.size
    margin = _CLOSING.travel_margin * (most - least)
    width = float(np.clip(across, least + margin, most - margin))
    shrunk = min(1.0, width / across)
    at = int(np.flatnonzero(closing.gaps >= width)[-1])
    ends = _find_pad_ends(fixture.model, closing, at)
    point, turn = _finger_contacts(fixture, closing, at)
    half_length = float(np.abs((ends - point) @ turn[:, 1]).max())
    size = (width, max(shrunk * side, _CLOSING.overhang * 2 * half_length), shrunk * out)
    fits = replace(DEFAULT_OBJECT, size=size).scale_extents(factor)
    return replace(fits, size=(max(fits.size[0], least + margin), *fits.size[1:]))


def pads_center(fixture: GripFixture, closing: Closing) -> Floats | None:
    """Return the center (3,) [m] of pads that press on a box; None if they do not hold it.

    A round object rolls out from between pads that it is not centered on.
    """
    try:
        squeeze = squeeze_object(fixture, closing)
    except SceneError:
        return None
    return squeeze.points.mean(axis=0) if squeeze.is_held else None


def contact_frame(fixture: GripFixture, closing: Closing) -> tuple[Floats, Floats]:
    """Return the contact center (3,) [m] for the object's width, and the rotation of `Squeeze`."""
    width = 2 * fixture.half[0]
    if not closing.gaps.min() < width < closing.opening:
        raise SceneError(
            f"the object is {1e3 * width:.3g} mm wide, but the fingers close from "
            f"{1e3 * closing.opening:.3g} to {1e3 * closing.gaps.min():.3g} mm; choose one in "
            "between with --object"
        )
    return _finger_contacts(fixture, closing, int(np.flatnonzero(closing.gaps >= width)[-1]))


def _finger_contacts(fixture: GripFixture, closing: Closing, at: int) -> tuple[Floats, Floats]:
    """Return the center of the pads in a configuration of the closing path, and a rotation.

    The first axis is the direction of approach. The direction between the nearest points may be off
    on flat or wedged pads, where these points are corners. The center is the mean over small tilts
    of a pad to all sides, so that it is the middle of flat pads.
    """
    earlier = closing.gaps > closing.gaps[at] + _CLOSING.approach_share * closing.opening
    before = int(np.flatnonzero(earlier)[-1]) if earlier.any() else 0
    ends: Floats = _find_pad_ends(fixture.model, closing, at).mean(axis=0)
    apart = [
        np.mean([places[other] - places[one] for one, other in closing.pairs], axis=0)
        for places in (_geoms_at(fixture.model, closing.path[each]) for each in (before, at))
    ]
    axis = apart[0] - apart[1] if before < at else ends[1] - ends[0]
    point = ends.mean(axis=0)
    return point, _object_frame(fixture, point, axis / np.linalg.norm(axis))


def _object_frame(fixture: GripFixture, point: Floats, axis: Floats) -> Floats:
    """Return a rotation of `Squeeze` with an outward axis that points away from the base."""
    data = mujoco.MjData(fixture.model)
    mujoco.mj_kinematics(fixture.model, data)
    out = point - data.xpos[fixture.base]
    out -= axis * (out @ axis)
    if np.linalg.norm(out) < _CLOSING.on_axis_share * fixture.half.max():
        out[:] = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    return squeeze_frame(axis, out)


def squeeze_frame(across: Floats, out: Floats) -> Floats:
    """Return a rotation (3, 3) of `Squeeze` from two orthogonal directions (3,)."""
    axes = np.empty((3, 3))
    axes[:, 0] = across / np.linalg.norm(across)
    axes[:, 2] = out / np.linalg.norm(out)
    axes[:, 1] = np.cross(axes[:, 2], axes[:, 0])
    return axes


def squeeze_object(fixture: GripFixture, closing: Closing, centre: Floats | None = None) -> Squeeze:
    """Close a hand on its object, which is centered on the pads first.

    If the object slips out between the outermost geoms, it is fixed until the fingers rest, and
    then tried nearer to the base. If opened fingers overlap it, they start further closed.

    Args:
        fixture: hand and object.
        closing: how the hand closes in this model.
        centre: (3,) center of the pads, if known [m].
    """
    point, turn = contact_frame(fixture, closing)
    if centre is not None:
        across = (centre - point) @ turn
        point = point + turn @ (across * [0, 1, 1])
        turn = _object_frame(fixture, point, turn[:, 0])
    reach = 2 * fixture.half[2]
    most_overlap = _CLOSING.overlap_share * fixture.half[0]
    deep, approaches = list[float](), list[Approach]()
    for depth in _CLOSING.depths:
        # The fingers start opened, or at the first place with room, such as curled around.
        depths = list[tuple[float, Approach]]()
        for start in (0, *np.flatnonzero(closing.gaps >= 2 * fixture.half[0]).tolist()):
            candidate = Approach(point - depth * reach * turn[:, 2], turn, start)
            data = data_at(
                fixture.model, start_row(fixture.model, _initial_pose(fixture, closing, candidate))
            )
            contacts = find_contacts(fixture.model, data, fixture.body)
            depths.append((max((contact.depth for contact in contacts), default=0.0), candidate))
            if depths[-1][0] <= most_overlap:
                break
        overlap, approach = min(depths, key=lambda one: one[0])
        deep.append(overlap)
        if overlap > most_overlap:
            continue
        approaches += [approach, replace(approach, is_still=True)]
    if not approaches:
        raise SceneError(
            f"the object does not fit between the opened fingers: it overlaps them by "
            f"{1e3 * min(deep):.3g} mm; give a smaller or flatter one with --object"
        )
    for approach in approaches:
        first = close_at(fixture, closing, approach, closing.closed_controls)
        if not first.is_held:
            continue
        # The nearest points of flat pads may be corners, so the pads' center is taken from the
        # contacts.
        across = (first.points.mean(axis=0) - approach.point) @ approach.turn
        if np.linalg.norm(across[1:]) < _CLOSING.centered_share * fixture.half.max():
            return first
        inner = approach.point + approach.turn @ (across * [0, 1, 1])
        centred = replace(
            approach, point=inner, turn=_object_frame(fixture, inner, approach.turn[:, 0])
        )
        second = close_at(fixture, closing, centred, closing.closed_controls)
        return second if second.is_held else first
    return close_at(fixture, closing, approaches[0], closing.closed_controls)


def _initial_pose(fixture: GripFixture, closing: Closing, approach: Approach) -> Floats:
    """Return the configuration of hand and object before the fingers close."""
    qpos = closing.path[approach.place].copy()
    qpos[fixture.address : fixture.address + 3] = approach.point - approach.turn @ fixture.middle
    mujoco.mju_mat2Quat(qpos[fixture.address + 3 : fixture.address + 7], approach.turn.ravel())
    return qpos


def close_at(
    fixture: GripFixture, closing: Closing, approach: Approach, control: Floats
) -> Squeeze:
    """Close a hand to a control on its object until it rests."""
    row = start_row(fixture.model, _initial_pose(fixture, closing, approach))
    begin = closing.control_at(float(closing.shares[approach.place]))
    if not approach.is_still:
        path, row = _ramp_control(fixture.model, row, begin, control)
        return replace(
            _wait_until_settled(fixture, row, control, approach.turn, [path]), approach=approach
        )
    # An object on a table is so heavy that fingers do not move it.
    model = fixture.model.__copy__()
    model.body_mass[fixture.body] *= _CLOSING.unmoved_mass
    model.body_inertia[fixture.body] *= _CLOSING.unmoved_mass
    mujoco.mj_setConst(model, mujoco.MjData(model))
    heavy = replace(fixture, model=model)
    path, row = _ramp_control(heavy.model, row, begin, control)
    before = _wait_until_settled(heavy, row, control, approach.turn, [path])
    squeeze = _wait_until_settled(fixture, before.row, control, approach.turn, [before.path])
    return replace(squeeze, approach=approach)


def _wait_until_settled(
    fixture: GripFixture, row: Floats, control: Floats, turn: Floats, paths: Sequence[Floats]
) -> Squeeze:
    """Hold a control until object, fingers and forces rest."""
    paths, before, first_path, seconds = list(paths), np.inf, paths[0], _CLOSING.ramp_seconds
    while True:
        part, row = _hold_control(fixture.model, row, control)
        paths.append(part)
        pressed = measure_squeeze(fixture, row, control, turn, np.concatenate(paths))
        total, seconds = sum(pressed.forces), seconds + _CLOSING.part_seconds
        # A held object rests, or fingers that do not hold it yet.
        if pressed.is_held:
            ends = body_frames(fixture.model, part[[0, -1]], fixture.body, fixture.base)
            rest = _CLOSING.resting_speed * _CLOSING.part_seconds
            still = float(np.linalg.norm(ends[1] - ends[0])) <= rest
        else:
            fingers = np.delete(
                np.arange(fixture.model.nq), np.arange(fixture.address, fixture.address + 7)
            )
            begin, previous, end = (pose[fingers] for pose in (first_path[0], part[0], part[-1]))
            rest = _CLOSING.arrived_share * np.abs(end - begin).max()
            still = bool(np.abs(end - previous).max() <= rest)
        steady = still and abs(total - before) <= _CLOSING.steady_force * total
        if steady or seconds > _CLOSING.most_seconds:
            return pressed
        before = total


def measure_squeeze(
    fixture: GripFixture, row: Floats, control: Floats, turn: Floats, path: Floats
) -> Squeeze:
    """Return the squeeze on the object in a state."""
    data = data_at(fixture.model, row)
    forces = np.zeros(len(fixture.fingers) + 1)
    contacts = find_contacts(fixture.model, data, fixture.body)
    for contact in contacts:
        body = int(fixture.model.geom_bodyid[contact.geom])
        side = next((n for n, finger in enumerate(fixture.fingers) if body in finger), -1)
        forces[side] += contact.force
    return Squeeze(
        row=row,
        control=control,
        turn=turn,
        path=path,
        forces=tuple(forces.tolist()),
        depth=max((contact.depth for contact in contacts), default=0.0),
        points=np.array([contact.point for contact in contacts]).reshape(-1, 3),
        geoms=tuple(sorted({contact.geom for contact in contacts})),
        approach=None,
    )
