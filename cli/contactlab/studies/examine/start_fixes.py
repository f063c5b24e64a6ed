"""Fixes overlapping starts: moves bodies apart, or excludes their contacts.

Links that a joint holds in each other's geoms push with the force of the joint. MuJoCo leaves out
contacts of parent and child unless the parent is the world, as for a robot with a welded base from
a URDF. Its pairs may be excluded, or its base set free if it stands on limbs. A body that begins
beyond its limits, in another body, or off its equalities may begin elsewhere.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget import Motion, Verdict
from contactlab.budget.force_places import contact_name
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.verdict import VerdictWord
from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError
from contactlab.modifications.modification import Candidate
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.scene.closed_start import OPEN_TOLERANCE, closed_start, moving_extent
from contactlab.scene.model_draft import CompiledFiles, ModelEdits, edit_spec
from contactlab.scene.model_names import name_of
from contactlab.scene.part_bodies import AT_JOINT
from contactlab.scene.raised_start import deepest_overlap, raised_start
from contactlab.scene.scene import Scene
from contactlab.schema.task import QPOS0
from contactlab.studies.examine.standing_starts import (
    begin_motion,
    find_fall,
    list_standing_poses,
)
from contactlab.studies.lint.linted_model import linted_model
from contactlab.studies.lint.structure import find_welded_roots
from contactlab.tasks.session import Values

_ENDLESS = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))
_HELD = "allowed"  # keyframe of a model that has none


def separate_links(
    scene: Scene, values: Values, motions: Sequence[Motion], verdict: Verdict
) -> tuple[Candidate, ...]:
    """Return candidates that separate overlapping links.

    Contacts are excluded, or the base is freed, only for links of one robot, few joints apart, that
    overlap at the start, or for bodies that joints hold inside each other. Floors, and bodies that
    a robot stands on, holds or runs into, are never excluded.
    """
    model = motions[0].model
    word: VerdictWord = "depends" if verdict.word == "depends" else "inaccurate"
    can_move = any(moved_starts(scene, values, motions[0]))
    # Pairs deep in each other; neither body is the world, and neither floats.
    stuck = list[tuple[int, int]]()
    if not can_move:
        data = begin_motion(motions[0])
        least = OPEN_TOLERANCE * moving_extent(model, data)
        for one, two, depth in find_overlaps(model, data):
            links_of_bodies = [_list_links(model, body) for body in (one, two)]
            if depth > least and all(way[0] and way[-1] == 0 for way in links_of_bodies):
                stuck.append((one, two))
    pairs = dict.fromkeys((*find_overlapping_links(motions[0]), *stuck))
    if not pairs:
        return ()
    names = tuple((name_of(model, "body", one), name_of(model, "body", two)) for one, two in pairs)
    return (
        *_without_contacts(scene, values, model, names, word, must_come_nearer=not stuck),
        *_free_roots(scene, values, names, word),
    )


class MovedStart(NamedTuple):
    """A start that limits, contacts and equalities allow.

    Attributes:
        name: as in "fix: a raised start".
        apply: its name for `--apply`.
        edits: that write it.
        sentence: the mistake of the start as written.
    """

    name: str
    apply: str
    edits: ModelEdits
    sentence: str


def moved_starts(scene: Scene, values: Values, motion: Motion) -> Iterator[MovedStart]:
    """Yield starts that limits, contacts and equalities allow, the one that keeps the pose first.

    A start in the reference pose is written as `pos` of bodies if that moves nothing else,
    otherwise as a keyframe.
    """
    model, start = motion.model, motion.starts[0]
    raised = raised_start(model, start, INTEGRATION)
    opened = start
    if raised is not None:
        data, opened = begin_motion(motion), np.empty_like(start)
        data.qpos[:] = raised
        mujoco.mj_getState(model, data, opened, INTEGRATION)
    positions = closed_start(model, opened, INTEGRATION)
    if raised is None and positions is None:
        return
    keyframe = scene.resolve(values, 0, None).keyframe
    begun = begin_motion(motion)
    sentence = _start_sentence(model, begun)
    if raised is not None:
        overlap = 1e3 * deepest_overlap(begun)
        name = f"a start raised out of an overlap of {overlap:.3g} mm"
        edits = _start_edits(scene, values, model, keyframe, raised)
        yield MovedStart(name, "raise", edits, sentence)
    if positions is not None:
        # Digits that no tolerance sees would turn bodies that only move.
        digits = 6 - math.floor(math.log10(moving_extent(model, begun)))
        positions = np.round(positions, digits) + 0.0
        name = "a start that its limits, contacts and equalities allow"
        edits = _start_edits(scene, values, model, keyframe, positions)
        yield MovedStart(name, "start", edits, sentence)


def standing_starts(
    scene: Scene, values: Values, motion: Motion, *, off_limits: bool = False
) -> Iterator[MovedStart]:
    """Yield starts from which a robot stands that falls from its keyframe as written.

    A keyframe that is `off_limits` need not fall.
    """
    keyframe = scene.resolve(values, 0, None).keyframe
    fall = 0.0 if keyframe == QPOS0 else find_fall(motion)
    if not (fall or off_limits):
        return
    for pose in list_standing_poses(motion):
        if not find_fall(motion, pose.positions):
            edits = _start_edits(scene, values, motion.model, keyframe, pose.positions)
            sentence = (
                f"keyframe {keyframe} falls by {1e3 * fall:.3g} mm at once; with "
                f"{pose.difference} it stands"
            )
            yield MovedStart(f"a start with {pose.difference}", "stand", edits, sentence)


def _start_sentence(model: mujoco.MjModel, data: mujoco.MjData) -> str:
    depths = [-float(distance) for distance in data.contact.dist.tolist()]
    deepest = int(np.argmax(depths)) if depths else -1
    if deepest < 0 or depths[deepest] <= OPEN_TOLERANCE * moving_extent(model, data):
        return "its start is one that limits or equalities do not allow"
    place = contact_name(model, data.contact.geom[deepest])
    return f"its start overlaps by {1e3 * depths[deepest]:.3g} mm at {place}"


def _start_edits(
    scene: Scene, values: Values, model: mujoco.MjModel, keyframe: str, positions: Floats
) -> ModelEdits:
    own = tuple(positions.tolist())
    if keyframe != QPOS0:
        return ModelEdits(posed=((keyframe, own),))
    placed = dict[str, tuple[float, ...]]()
    for joint in range(model.njnt):
        place, body = int(model.jnt_qposadr[joint]), int(model.jnt_bodyid[joint])
        name, kind = name_of(model, "body", body), int(model.jnt_type[joint])
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            placed[name] = own[place : place + 3]
        elif kind == mujoco.mjtJoint.mjJNT_SLIDE and _is_passive_root(model, joint):
            axis, turn = np.array(model.jnt_axis[joint]), np.array(model.body_quat[body])
            mujoco.mju_rotVecQuat(axis, axis.copy(), turn)
            way = (own[place] - float(model.qpos0[place])) * axis
            before = placed.get(name, model.body_pos[body])
            placed[name] = tuple((np.asarray(before) + way).tolist())
    placed = {
        name: place
        for name, place in placed.items()
        if not np.array_equal(place, model.body(name).pos)
    }
    edits = ModelEdits(placed=tuple(placed.items()))
    compiled_model = compile_edited(scene, values, lambda spec: edit_spec(spec, edits))
    if compiled_model is not None and _begins_alike(model, compiled_model, positions):
        return edits
    return ModelEdits(posed=((_HELD, own),))


def _is_passive_root(model: mujoco.MjModel, joint: int) -> bool:
    # Limits and actuators count from the place of the body.
    at_joint = np.isin(model.actuator_trntype, AT_JOINT)
    driven = joint in np.asarray(model.actuator_trnid)[at_joint, 0]
    on_world = not model.body_parentid[model.jnt_bodyid[joint]]
    return bool(on_world and not driven and not model.jnt_limited[joint] and not model.neq)


def _begins_alike(model: mujoco.MjModel, compiled_model: mujoco.MjModel, positions: Floats) -> bool:
    # Whether the reference pose of a model has all bodies where another one has them in a pose.
    # Anchors of equalities and lengths of tendons are read from the reference pose, too.
    for field in ("eq_data", "tendon_lengthspring"):
        if not np.array_equal(getattr(model, field), getattr(compiled_model, field)):
            return False
    places = list[Floats]()
    for one, qpos in ((model, positions), (compiled_model, compiled_model.qpos0)):
        data = mujoco.MjData(one)
        if len(data.qpos) != len(qpos) or one.nbody != model.nbody:
            return False
        data.qpos[:] = qpos
        mujoco.mj_kinematics(one, data)
        places.append(np.concatenate([data.xpos.ravel(), data.xmat.ravel()]))
    return bool(np.allclose(*places, rtol=0, atol=SUM_ROUNDING * (1 + np.abs(places[0]).max())))


def _without_contacts(
    scene: Scene,
    values: Values,
    model: mujoco.MjModel,
    names: Sequence[tuple[str, str]],
    word: VerdictWord,
    *,
    must_come_nearer: bool,
) -> Iterator[Candidate]:
    edits = ModelEdits(excluded=tuple(names))
    compiled_model = compile_edited(scene, values, lambda spec: edit_spec(spec, edits))
    size = mujoco.mj_stateSize(model, INTEGRATION)
    if compiled_model is None or mujoco.mj_stateSize(compiled_model, INTEGRATION) != size:
        return
    first = " - ".join(names[0])
    more = f" and {len(names) - 1} more pairs" if len(names) > 1 else ""
    yield Candidate(
        f"no contacts of {first}{more}",
        word,
        apply="exclude",
        edits=edits,
        compiled=compiled_model,
        must_come_nearer=must_come_nearer,  # overlaps that joints hold have no reference motion
    )


def _free_roots(
    scene: Scene, values: Values, names: Sequence[tuple[str, str]], word: VerdictWord
) -> Iterator[Candidate]:
    """Yield the change that gives the root links of a URDF a free joint, which no URDF can have.

    They are those that carry a link of a pair by joints, and are welded to the world themselves.
    The frame of a door belongs to a wall: only a robot that stands on limbs gets one.
    """
    if scene.source.model.suffix != ".urdf":
        return
    with linted_model(scene.source) as linted:
        if linted.compiled is None or not any(find_welded_roots(linted)):
            return
    roots = dict[str, None]()

    def free(spec: mujoco.MjSpec) -> None:
        bodies = {body.name: body for body in spec.bodies if body != spec.worldbody}
        for link in (bodies[name] for pair in names for name in pair if name in bodies):
            root = link
            while root.parent != spec.worldbody:
                root = root.parent
            if not root.joints:
                roots[root.name] = None
        edit_spec(spec, ModelEdits(freed=tuple(roots)))

    if compile_edited(scene, values, free) is None or not roots:
        return
    yield Candidate(
        f"a free joint for {', '.join(roots)}, which the import welds to the world",
        word,
        apply="freejoint",
        edits=ModelEdits(freed=tuple(roots)),
        must_come_nearer=word == "depends",  # its states are others: it does not fix softness
    )


def find_overlapping_links(motion: Motion) -> Iterator[tuple[int, int]]:
    """Yield pairs of near links that are in each other where a motion starts."""
    model = motion.model
    overlaps = find_overlaps(model, begin_motion(motion))
    yield from ((one, two) for one, two, _ in overlaps if _are_near(model, one, two))


def find_overlaps(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[tuple[int, int, float]]:
    """Yield pairs of bodies in each other, except floors, and how deep [m]."""
    for contact in range(data.ncon):
        geoms = data.contact.geom[contact]
        if geoms.min() < 0 or set(_ENDLESS) & set(map(int, model.geom_type[geoms])):
            continue
        one, two = sorted(map(int, model.geom_bodyid[geoms]))
        if (distance := float(data.contact.dist[contact])) < 0:
            yield one, two, -distance


def _are_near(model: mujoco.MjModel, one: int, two: int) -> bool:
    """Return whether one of two bodies carries the other, few joints on.

    Fingers that close on each other carry neither the other, and may touch.
    """
    most_joints = 2  # between links of one robot that touch by how it is built
    ways = [_list_links(model, body) for body in (one, two)]
    return any(
        way[0] in other and 0 < other.index(way[0]) <= most_joints
        for way, other in (ways, ways[::-1])
    )


def _list_links(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the links from a body to the root of its robot, welded bodies as one.

    A body with a free joint begins a robot of its own.
    """
    free = int(mujoco.mjtJoint.mjJNT_FREE)
    link = int(model.body_weldid[body])
    way = [link]
    while link:
        joint = int(model.body_jntadr[link])
        if joint >= 0 and int(model.jnt_type[joint]) == free:
            break
        link = int(model.body_weldid[model.body_parentid[link]])
        way.append(link)
    return way


def compile_edited(
    scene: Scene, values: Values, edit: Callable[[mujoco.MjSpec], None]
) -> mujoco.MjModel | None:
    """Return the model of an edited specification; None if it does not compile."""
    try:
        return CompiledFiles.from_scene(scene, scene.source, values, edit).model
    except SceneError:
        return None
