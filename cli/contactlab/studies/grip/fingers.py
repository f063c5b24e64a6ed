"""Finds the hand of a robot by driving each actuator; names are not used."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.model_names import require_id
from contactlab.scene.part_bodies import AT_JOINT, bodies_of_actuator, bodies_of_equality
from contactlab.studies.grip.rollouts import repeat_input, roll_out, start_row

_FREE, _PLANE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtGeom.mjGEOM_PLANE)
_SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
_LINKS = frozenset({int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)})
_COUPLED = _LINKS | {int(mujoco.mjtEq.mjEQ_JOINT), int(mujoco.mjtEq.mjEQ_TENDON)}
NO_HAND = (
    "name a keyframe in which something is held (--keyframe), or the body that carries the fingers "
    "(--base)"
)


@dataclass(frozen=True)
class Hand:
    """Fingers that close.

    Attributes:
        base: the body that carries them.
        fingers: the bodies of each finger; a single finger closes on the base.
        actuators: ids of the actuators that move the fingers.
    """

    base: int
    fingers: tuple[tuple[int, ...], ...]
    actuators: tuple[int, ...]


def control_ranges(model: mujoco.MjModel) -> Floats:
    """Return (nu, 2) the least and largest control of each actuator.

    Without a control range, the range of its joint or force is used; otherwise -1 and 1.
    """
    ends = np.tile([-1.0, 1.0], (model.nu, 1))
    for actuator in range(model.nu):
        joint = int(model.actuator_trnid[actuator, 0])
        on_joint = model.actuator_trntype[actuator] in AT_JOINT
        servo = model.actuator_biasprm[actuator, 1] != 0
        if model.actuator_ctrllimited[actuator]:
            ends[actuator] = model.actuator_ctrlrange[actuator]
        elif servo and on_joint and model.jnt_limited[joint]:
            ends[actuator] = model.jnt_range[joint]
        elif model.actuator_forcelimited[actuator] and model.actuator_gainprm[actuator, 0]:
            gain = model.actuator_gainprm[actuator, 0]
            ends[actuator] = np.sort(model.actuator_forcerange[actuator] / gain)
    return ends


def pose_within_limits(model: mujoco.MjModel) -> Floats:
    """Return qpos0 (nq,) with slides and hinges within their ranges.

    Out of range, fingers may overlap and stay caught.
    """
    qpos = model.qpos0.copy()
    for joint in np.flatnonzero(model.jnt_limited).tolist():
        if int(model.jnt_type[joint]) in _SCALAR:
            place = int(model.jnt_qposadr[joint])
            qpos[place] = np.clip(qpos[place], *model.jnt_range[joint])
    return qpos


def loose_bodies(model: mujoco.MjModel) -> set[int]:
    """Return the roots of free bodies that no actuator drives: objects, not robots."""
    driven = {int(model.body_rootid[body]) for body in _driven_bodies(model)}
    return {
        int(model.jnt_bodyid[joint])
        for joint in np.flatnonzero(model.jnt_type == _FREE)
        if int(model.jnt_bodyid[joint]) not in driven
    }


def _driven_bodies(model: mujoco.MjModel) -> set[int]:
    """Return the bodies that actuators act on, directly or by a tendon."""
    names = {name for each in range(model.nu) for name in bodies_of_actuator(model, each)}
    return {require_id(model, "body", name) for name in names}


def list_subtree(model: mujoco.MjModel, body: int) -> list[int]:
    """Return a body and all bodies that it carries."""
    subtree = {body}
    for each in range(body + 1, model.nbody):
        if int(model.body_parentid[each]) in subtree:
            subtree.add(each)
    return sorted(subtree)


def find_hand(model: mujoco.MjModel, base: str | None = None) -> Hand:
    """Return the most distal body with fingers that actuators move against each other.

    Each actuator is driven to both ends of its range, without gravity and contacts; the moving
    bodies show which body carries it. If no body carries two moving fingers, one finger may close
    on the body that carries it.

    Raises:
        SceneError: there is no actuator, no such body, or no finger closes.
    """
    if not model.nu:
        raise SceneError(
            "the model has no actuators, so that nothing closes; add them in MJCF, since URDF has "
            "none, or name a keyframe in which something is held (--keyframe)"
        )
    carriers = _find_carriers(model)
    if base is not None:
        bodies = [require_id(model, "body", base)]
    else:
        above = {body for carrier, _ in carriers.values() for body in _walk_up(model, carrier)}
        weight = {body: float(model.body_subtreemass[body]) for body in above}
        # If two bodies have the same mass, the more distal one comes first.
        bodies = sorted(above, key=lambda body: (weight[body], -body))
    for least in (2, 1):
        for body in bodies:
            hand = _hand_at(model, body, carriers)
            if hand is not None and len(hand.fingers) >= least:
                return hand
    raise SceneError(f"no actuator moves two bodies towards each other; {NO_HAND}")


_Carriers = Mapping[int, tuple[int, frozenset[int]]]


def _find_carriers(model: mujoco.MjModel) -> _Carriers:
    """Return, for each actuator, the body that carries its moving bodies, and these bodies."""
    probe = model.__copy__()
    probe.opt.gravity[:] = 0
    probe.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    ends = control_ranges(model)
    neutral = np.clip(np.zeros(model.nu), ends[:, 0], ends[:, 1])
    controls = np.tile(neutral, (3 * model.nu, 1))
    for actuator in range(model.nu):
        # The middle is needed as well, since both ends of a full turn are one pose.
        levels = ends[actuator, 0], ends[actuator].mean(), ends[actuator, 1]
        controls[3 * actuator : 3 * actuator + 3, actuator] = levels
    probe_seconds = 0.5  # to drive an actuator to each end of its range, and to its middle
    steps = max(2, round(probe_seconds / model.opt.timestep))
    rows = repeat_input(start_row(probe, pose_within_limits(probe)), len(controls), 1)[:, 0]
    rolled = roll_out(probe, rows, np.repeat(controls[:, None], steps, axis=1))
    loose = {body for root in loose_bodies(model) for body in list_subtree(model, root)}
    carriers = dict[int, tuple[int, frozenset[int]]]()
    # A body moves with an actuator if it travels at least this share of the farthest one.
    moved_share = 0.1
    for actuator in range(model.nu):
        poses = [_body_points(model, qpos) for qpos in rolled.qpos[3 * actuator :][:3, -1]]
        apart = [np.linalg.norm(one - other, axis=1) for one, other in combinations(poses, 2)]
        way = np.max(apart, axis=0).reshape(-1, model.nbody).max(axis=0)
        way[list(loose)] = 0
        least = COARSE_ROUNDING * max(model.stat.extent, 1e-9)
        if not np.isfinite(way).all() or way.max() < least:
            continue
        moved = np.flatnonzero(way > moved_share * way.max())
        # The carrier is the nearest common ancestor at rest of the moving bodies.
        ways = [set(_walk_up(model, int(body))) for body in moved]
        shared = set.intersection(*ways) - set(map(int, moved))
        carriers[actuator] = max(shared, default=0), frozenset(map(int, moved))
    return carriers


def _body_points(model: mujoco.MjModel, qpos: Floats) -> Floats:
    """Return the origin, center of mass and axis ends of the frame of each body [m]."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    size = 0.1 * model.stat.extent
    turn = data.xmat.reshape(-1, 3, 3)
    ends = [data.xpos + size * turn[:, :, axis] for axis in range(3)]
    return np.concatenate([data.xpos, data.xipos, *ends])


def _walk_up(model: mujoco.MjModel, body: int) -> Iterator[int]:
    """Yield a body and its ancestors, up to the world."""
    yield body
    while body:
        body = int(model.body_parentid[body])
        yield body


def is_colliding(model: mujoco.MjModel, geom: int) -> bool:
    """Return whether a geom takes part in collisions."""
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


def geoms_of(model: mujoco.MjModel, bodies: tuple[int, ...] | list[int]) -> list[int]:
    """Return the geoms of bodies that take part in collisions."""
    geom_ids = np.flatnonzero(np.isin(model.geom_bodyid, bodies))
    return [int(geom) for geom in geom_ids if is_colliding(model, int(geom))]


def _hand_at(model: mujoco.MjModel, base: int, carriers: _Carriers) -> Hand | None:
    """Return the hand of a base, from the fingers that actuators move within it."""
    own = list_subtree(model, base)
    actuators = [actuator for actuator, (carrier, _) in carriers.items() if carrier in own]
    moved = {body for actuator in actuators for body in carriers[actuator][1]}
    fixed = {body for body in own if _fixed_to(model, body, base)}
    roots = [
        body
        for body in own
        if body not in fixed and int(model.body_parentid[body]) in fixed and body != base
    ]
    driven, couplings = _driven_bodies(model), list(_find_couplings(model, _COUPLED))
    while joined := [each for each in couplings if each & driven and not each <= driven]:
        driven |= set[int]().union(*joined)
    fingers = [
        each
        for each in _linked_fingers(model, [list_subtree(model, root) for root in roots])
        if moved & driven & set(each) and geoms_of(model, each)
    ]
    if not actuators or not fingers:
        return None
    jaws = [geom for geom in geoms_of(model, sorted(fixed)) if model.geom_type[geom] != _PLANE]
    if len(fingers) == 1 and not jaws:
        return None
    return Hand(base, tuple(fingers), tuple(actuators))


def _linked_fingers(
    model: mujoco.MjModel, chains: Sequence[Sequence[int]]
) -> Iterator[tuple[int, ...]]:
    """Yield the bodies of each finger; chains that connects or welds join are one finger."""
    groups = [set(chain) for chain in chains]
    for coupling in _find_couplings(model, _LINKS):
        joined = [group for group in groups if group & coupling]
        if len(joined) > 1:
            groups = [group for group in groups if group not in joined]
            groups.append(set[int]().union(*joined))
    yield from (tuple(sorted(group)) for group in sorted(groups, key=min))


def _find_couplings(model: mujoco.MjModel, kinds: frozenset[int]) -> Iterator[set[int]]:
    """Yield the bodies that each equality of the given kinds couples."""
    for equality in range(model.neq):
        if int(model.eq_type[equality]) in kinds:
            yield {require_id(model, "body", name) for name in bodies_of_equality(model, equality)}


def _fixed_to(model: mujoco.MjModel, body: int, base: int) -> bool:
    """Return whether no joint is between a body and its base."""
    while body != base:
        if model.body_jntnum[body]:
            return False
        body = int(model.body_parentid[body])
    return True


def fixed_bodies(model: mujoco.MjModel, base: int) -> list[int]:
    """Return a base and the bodies that are fixed to it."""
    return [body for body in list_subtree(model, base) if _fixed_to(model, body, base)]
