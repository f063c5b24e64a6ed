"""A hand removed from its robot: its base fixed, everything else deleted, with an object."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError
from contactlab.studies.grip.fingers import (
    Hand,
    fixed_bodies,
    geoms_of,
    is_colliding,
    list_subtree,
    loose_bodies,
)
from contactlab.studies.grip.gripped_object import GrippedObject

_NAME = "contactlab/object"
_WRAPPED = {
    int(mujoco.mjtWrap.mjWRAP_JOINT): "joint",
    int(mujoco.mjtWrap.mjWRAP_SITE): "site",
}
_KINDS = {"box": mujoco.mjtGeom.mjGEOM_BOX, "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER}


@dataclass(frozen=True)
class MountedHand:
    """A hand with its base fixed to the world.

    Attributes:
        spec: of the model, without an object; parts keep their names.
        base: name of the fixed body that carries the fingers.
        fingers: names of the bodies of each finger.
    """

    spec: mujoco.MjSpec
    base: str
    fingers: tuple[tuple[str, ...], ...]


def mount_hand(
    spec: mujoco.MjSpec, model: mujoco.MjModel, hand: Hand, kept_body: str = ""
) -> MountedHand:
    """Return a hand with its base fixed in its pose at qpos0.

    Joints outside the hand are deleted, not stiffened: a huge armature spoils the scale of the
    solver. MuJoCo does not filter contacts with a body that is fixed to the world, so contacts that
    it filtered between base and fingers are excluded. A body to keep is the object, not a part of
    the robot.
    """
    cut, own = spec.copy(), set(list_subtree(model, hand.base))
    # Delete joints of the base, and all parts that move or couple other bodies.
    bodies = sorted(own)
    carried = np.flatnonzero(
        np.isin(model.jnt_bodyid, [each for each in bodies if each != hand.base])
    )
    joints = set(map(int, carried))
    sites = {int(site) for site in np.flatnonzero(np.isin(model.site_bodyid, bodies))}
    tendons = _tendons_of(model, joints, sites)
    parts: list[Any] = [*cut.keys, *cut.sensors]
    parts += [
        actuator
        for actuator in cut.actuators
        if not _acts_within(model, model.actuator(actuator.name).id, joints, tendons, sites, own)
    ]
    parts += [
        equality
        for equality in cut.equalities
        if not _is_within(model, model.equality(equality.name).id, joints, tendons, own)
    ]
    parts += [pair for pair in (*cut.pairs, *cut.excludes) if not _names_within(model, pair, own)]
    parts += [tendon for tendon in cut.tendons if model.tendon(tendon.name).id not in tendons]
    parts += [joint for joint in cut.joints if model.joint(joint.name).id not in joints]
    for part in parts:
        cut.delete(part)
    loose_parts = {body for root in loose_bodies(model) for body in list_subtree(model, root)} - own
    for body in list(cut.bodies):
        number = model.body(body.name).id
        if (
            number in loose_parts
            and int(model.body_parentid[number]) not in loose_parts
            and body.name != kept_body
        ):
            cut.delete(body)
    # Fix lights and cameras that target a deleted body.
    remaining_bodies = {body.name for body in cut.bodies}
    for view in (*cut.lights, *cut.cameras):
        if view.targetbody and view.targetbody not in remaining_bodies:
            view.targetbody = ""
            view.mode = mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    colliding = {*(model.body(body).name for body in own), kept_body}
    for geom in cut.geoms:
        if geom.parent.name not in colliding:
            geom.contype = geom.conaffinity = 0
    cut.compiler.discardvisual = False
    cut.compiler.fusestatic = False
    cut.option.gravity = np.zeros(3)
    # Exclude contacts of the base with the first links, as on the robot.
    fixed = fixed_bodies(model, hand.base)
    first = {body for body in range(model.nbody) if int(model.body_parentid[body]) in fixed}
    for finger in hand.fingers:
        links = [body for body in finger if int(model.body_weldid[body]) in first]
        for one in fixed:
            for other in links:
                if geoms_of(model, [one]) and geoms_of(model, [other]):
                    pair = model.body(one).name, model.body(other).name
                    cut.add_exclude(bodyname1=pair[0], bodyname2=pair[1])
    names = tuple(tuple(model.body(body).name for body in finger) for finger in hand.fingers)
    return MountedHand(cut, model.body(hand.base).name, names)


def _acts_within(
    model: mujoco.MjModel,
    actuator: int,
    joints: set[int],
    tendons: set[int],
    sites: set[int],
    own: set[int],
) -> bool:
    """Return whether an actuator acts on one of these."""
    inside = {
        int(mujoco.mjtTrn.mjTRN_JOINT): joints,
        int(mujoco.mjtTrn.mjTRN_JOINTINPARENT): joints,
        int(mujoco.mjtTrn.mjTRN_TENDON): tendons,
        int(mujoco.mjtTrn.mjTRN_SITE): sites,
        int(mujoco.mjtTrn.mjTRN_BODY): own,
    }.get(int(model.actuator_trntype[actuator]), set[int]())
    return int(model.actuator_trnid[actuator, 0]) in inside


def _tendons_of(model: mujoco.MjModel, joints: set[int], sites: set[int]) -> set[int]:
    """Return the tendons that act on these joints, and pass only these sites."""
    tendons = set[int]()
    for tendon in range(model.ntendon):
        first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
        wraps = range(first, first + count)
        kinds = {"joint": joints, "site": sites}
        inside = [
            int(model.wrap_objid[wrap]) in kinds[kind]
            for wrap in wraps
            if (kind := _WRAPPED.get(int(model.wrap_type[wrap])))
        ]
        if inside and all(inside):
            tendons.add(tendon)
    return tendons


def _is_within(
    model: mujoco.MjModel, equality: int, joints: set[int], tendons: set[int], own: set[int]
) -> bool:
    """Return whether an equality constraint belongs to the hand alone."""
    kind = int(model.eq_type[equality])
    ends = [int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])]
    if kind == mujoco.mjtEq.mjEQ_JOINT:
        return all(end in joints for end in ends if end >= 0)
    if kind == mujoco.mjtEq.mjEQ_TENDON:
        return all(end in tendons for end in ends if end >= 0)
    if model.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_SITE:
        ends = [int(model.site_bodyid[end]) for end in ends]
    return kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD) and all(
        end in own for end in ends
    )


def _names_within(model: mujoco.MjModel, pair: Any, own: set[int]) -> bool:  # noqa: ANN401 - a pair or an exclude
    if hasattr(pair, "bodyname1"):
        names = (pair.bodyname1, pair.bodyname2)
        return all(model.body(name).id in own for name in names)
    names = (pair.geomname1, pair.geomname2)
    return all(int(model.geom_bodyid[model.geom(name).id]) in own for name in names)


@dataclass(frozen=True)
class GripFixture:
    """A hand and its object, compiled.

    Attributes:
        model: without gravity; loads are applied.
        base, body: ids of the base and of the object.
        fingers: ids of the bodies of each finger.
        address: address of the object's pose in qpos.
        half: (3,) half extents of the object in its own frame [m].
        middle: (3,) middle of these extents in its own frame [m].
    """

    model: mujoco.MjModel
    base: int
    body: int
    fingers: tuple[tuple[int, ...], ...]
    address: int
    half: Floats
    middle: Floats


def add_object(mounted_hand: MountedHand, gripped: GrippedObject) -> GripFixture:
    """Compile a mounted hand with an object that collides with the whole hand.

    Raises:
        SceneError: the object is not a body of the model, or does not compile.
    """
    spec = mounted_hand.spec.copy()
    if gripped.shape == "body":
        names = [body.name for body in spec.bodies]
        SceneError.unless_known(
            gripped.name, names, f"--object: no body '{gripped.name}' in the model"
        )
        body, name = spec.body(gripped.name), gripped.name
        if body.parent.name != "world":
            raise SceneError(
                f"--object {name}: it is fixed to {body.parent.name}; name a free body"
            )
        for joint in list(body.joints):
            spec.delete(joint)
        body.add_freejoint(name=f"{_NAME}/free")
    else:
        name = _NAME
        body = spec.worldbody.add_body(name=name)
        body.add_freejoint(name=f"{_NAME}/free")
        # The bits of the object match every colliding geom.
        bits = 1
        for geom in spec.geoms:
            bits |= int(geom.contype) | int(geom.conaffinity)
        geom_fields: dict[str, Any] = {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": _NAME}
        if gripped.shape == "mesh":
            spec.add_mesh(name=_NAME, file=str(Path(gripped.name)))
        else:
            across, second, third = (length / 2 for length in gripped.size)
            size = [across, second, third] if gripped.shape == "box" else [across, third, 0.0]
            geom_fields = {"type": _KINDS[gripped.shape], "size": size}
        body.add_geom(
            name=_NAME,
            mass=gripped.mass,
            contype=bits,
            conaffinity=bits,
            condim=3,
            friction=[1, 0.005, 0.0001],
            priority=0,
            # Geoms outside this group range are ignored for inertia.
            group=max(0, int(spec.compiler.inertiagrouprange[0])),
            rgba=[0.9, 0.6, 0.2, 1],
            **geom_fields,
        )
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise SceneError(f"the hand with its object does not compile: {error}") from error
    number = model.body(name).id
    half, middle = colliding_bounds(model, number)
    return GripFixture(
        model=model,
        base=model.body(mounted_hand.base).id,
        body=number,
        fingers=tuple(tuple(model.body(each).id for each in one) for one in mounted_hand.fingers),
        address=int(model.jnt_qposadr[model.body_jntadr[number]]),
        half=half,
        middle=middle,
    )


def colliding_bounds(model: mujoco.MjModel, body: int) -> tuple[Floats, Floats]:
    """Return half extents and the middle of a body's colliding geoms, in its frame [m]."""
    lows, highs = list[Floats](), list[Floats]()
    for geom in range(model.ngeom):
        if int(model.geom_bodyid[geom]) != body or not is_colliding(model, geom):
            continue
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        matrix = turn.reshape(3, 3)
        centre = model.geom_pos[geom] + matrix @ model.geom_aabb[geom, :3]
        reach = np.abs(matrix) @ model.geom_aabb[geom, 3:]
        lows.append(centre - reach)
        highs.append(centre + reach)
    if not lows:
        raise SceneError(f"body {model.body(body).name} has no geom that collides")
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    return (high - low) / 2, (high + low) / 2
