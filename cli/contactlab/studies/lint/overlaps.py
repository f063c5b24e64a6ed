"""Shape rules: geoms that overlap at a start, and hulls that fill openings of meshes."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.rendering.amounts import format_others, format_percent
from contactlab.scene.body_inertia import hull_volume, mesh_vertices
from contactlab.scene.contact_pairs import half_extents, touch_mask, touch_places
from contactlab.schema.task import QPOS0
from contactlab.studies.lint.linted_model import Edit, Fault, LintedModel, Place
from contactlab.studies.lint.rules import rule
from contactlab.studies.lint.static_equilibrium import (
    MANY_WEIGHTS,
    contact_rows,
    find_pressing,
    is_in_equilibrium,
)

_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)
_MOUNTED = "one is fixed to the world, where that filter does not hold"


class _Overlap(NamedTuple):
    """Two bodies with geoms that overlap in a start."""

    start: str
    geoms: tuple[int, int]
    depth: float  # [m]
    share: float  # of half the thinner geom's extent


def _find_overlaps(linted: LintedModel, *, thrown: bool) -> dict[tuple[int, int], _Overlap]:
    """Return the deepest overlap of each two bodies in any start; if `thrown`, without held ones.

    Loads may hold an overlap, as of a handle in closed fingers.
    """
    model, overlaps = linted.model, dict[tuple[int, int], _Overlap]()
    halves = half_extents(model)
    # Share of half the thinner geom's extent; a larger overlap is more than a touch.
    deep_share = 0.1
    for start, data in linted.starts.items():
        geoms_of = data.contact.geom.tolist()
        for contact, distance in enumerate(data.contact.dist.tolist()):
            geoms = geoms_of[contact]
            if min(geoms) < 0:
                continue
            half = float(halves[geoms].min())
            overlap = _Overlap(start, (geoms[0], geoms[1]), -distance, -distance / half)
            low, high = sorted(int(model.geom_bodyid[geom]) for geom in geoms)
            known = overlaps.get((low, high))
            if overlap.share > deep_share and overlap.depth > (known.depth if known else 0.0):
                rows = contact_rows(model, data, contact) if thrown else None
                if rows is None or not is_in_equilibrium(model, data, rows):
                    overlaps[low, high] = overlap
    return overlaps


def _are_joined(linted: LintedModel, low: int, high: int) -> bool:
    """Return whether two bodies are links of one chain, at most two joints apart.

    The world counts as a link only for a URDF with its base fixed to it.
    """
    model, ends = linted.model, {_first_link(linted.model, low), _first_link(linted.model, high)}
    near_joints = 2  # joints between two links that meet in one place, as in a wrist
    for start in ends:
        link, others = start, ends - {start}
        for _ in range(near_joints):
            joint = int(model.body_jntadr[link])
            is_free = joint >= 0 and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
            if not link or is_free:
                break
            link = _first_link(model, int(model.body_parentid[link]))
            if link in others and (link or linted.is_urdf):
                return True
    return False


def _first_link(model: mujoco.MjModel, body: int) -> int:
    """Return the first of the bodies that are fixed to each other, without the world."""
    while model.body_parentid[body] and not model.body_jntnum[body]:
        body = int(model.body_parentid[body])
    return body


def _overlap_text(linted: LintedModel, overlaps: Sequence[_Overlap]) -> str:
    worst = max(overlaps, key=lambda overlap: overlap.depth)
    bodies = [linted.name("body", int(linted.model.geom_bodyid[geom])) for geom in worst.geoms]
    geoms = " - ".join(linted.name("geom", geom) for geom in worst.geoms)
    more = format_others(len(overlaps) - 1, "pair")
    return (
        f"at {worst.start}, {bodies[0]} and {bodies[1]} overlap by {1e3 * worst.depth:.3g} mm "
        f"({geoms}; {format_percent(worst.share)} of the thinner's half thickness){more}"
    )


def _overlap_place(linted: LintedModel, overlaps: Sequence[_Overlap]) -> Place:
    worst = max(overlaps, key=lambda overlap: overlap.depth)
    return linted.place("body", max(int(linted.model.geom_bodyid[geom]) for geom in worst.geoms))


@rule("parent-filter", "warn")
def find_overlapping_neighbors(linted: LintedModel) -> Iterator[Fault]:
    """Neighbouring links overlap in a start, and MuJoCo's filter of parents is not about them.

    MuJoCo leaves out contacts of a link with its parent, but not with a grandparent, nor with a
    parent that is fixed to the world, as the base of every URDF is. Fix: an `<exclude>` for each
    pair; a free joint for a base that floats.
    """
    near = _neighbor_overlaps(linted)
    mounted = {pair: one for pair, one in near.items() if _is_mounted(linted, *pair)}
    others = {pair: one for pair, one in near.items() if pair not in mounted}
    if others:
        yield _filter_fault(linted, others, "the filter is of a link and its parent alone")
    if mounted and linted.is_urdf:
        yield _filter_fault(linted, mounted, _MOUNTED)


@rule("base-filter", "note")
def find_overlapping_bases(linted: LintedModel) -> Iterator[Fault]:
    """A base that MJCF fixes to the world overlaps links that it carries.

    Alone, its joints jam; programs attach such a part to a robot. Fix: an `<exclude>` for each
    pair.
    """
    near = _neighbor_overlaps(linted)
    mounted = {pair: one for pair, one in near.items() if _is_mounted(linted, *pair)}
    if mounted and not linted.is_urdf:
        yield _filter_fault(linted, mounted, _MOUNTED)


def _neighbor_overlaps(linted: LintedModel) -> dict[tuple[int, int], _Overlap]:
    """Return the overlaps of links of one chain."""
    overlaps = _find_overlaps(linted, thrown=False).items()
    return {pair: one for pair, one in overlaps if _are_joined(linted, *pair)}


def _is_mounted(linted: LintedModel, low: int, high: int) -> bool:
    """Return whether one of two bodies is fixed to the world, and carries the other."""
    model = linted.model
    links = {_first_link(model, low), _first_link(model, high)}
    parents = {_first_link(model, int(model.body_parentid[link])) for link in links if link}
    return not all(model.body_weldid[[low, high]]) and bool(parents & links)


def _filter_fault(
    linted: LintedModel, overlap_by_pair: Mapping[tuple[int, int], _Overlap], why: str
) -> Fault:
    edits: list[Edit] = []
    for pair in overlap_by_pair:
        contact = ET.Element("contact")
        names = [linted.name("body", body) for body in pair]
        ET.SubElement(contact, "exclude", body1=names[0], body2=names[1])
        edits += linted.add(contact)
    overlaps = list(overlap_by_pair.values())
    message = f"{_overlap_text(linted, overlaps)}; {why}"
    return Fault(message, _overlap_place(linted, overlaps), tuple(edits))


def _unjoined_overlaps(linted: LintedModel) -> list[_Overlap]:
    """Return the overlaps of bodies that are not joined."""
    overlaps = _find_overlaps(linted, thrown=True).items()
    return [overlap for pair, overlap in overlaps if not _are_joined(linted, *pair)]


@rule("overlap", "warn")
def find_overlaps_in_keyframes(linted: LintedModel) -> Iterator[Fault]:
    """Bodies that are not joined overlap in a keyframe.

    The overlap is more than a tenth of half the thinner geom, and the first steps throw the bodies
    apart. An overlap that loads hold, as closed fingers do, passes. Fix: move one of them in the
    keyframe.
    """
    if overlaps := [overlap for overlap in _unjoined_overlaps(linted) if overlap.start != QPOS0]:
        message = f"{_overlap_text(linted, overlaps)}; the first step throws them apart"
        yield Fault(message, linted.place("key", overlaps[0].start))


@rule("overlap-qpos0", "note")
def find_overlaps_in_qpos0(linted: LintedModel) -> Iterator[Fault]:
    """Bodies that are not joined overlap in the reference pose, and no keyframe is another.

    Programs often place bodies themselves. Fix: a keyframe with them apart.
    """
    if overlaps := [overlap for overlap in _unjoined_overlaps(linted) if overlap.start == QPOS0]:
        message = f"{_overlap_text(linted, overlaps)}; start from a keyframe without this overlap"
        yield Fault(message, _overlap_place(linted, overlaps))


@rule("below-floor", "warn")
def find_starts_below_floor(linted: LintedModel) -> Iterator[Fault]:
    """A floating body begins with its center of mass below a plane that it can touch.

    The floor throws it out. Fix: a larger `pos`, or a keyframe.
    """
    model = linted.model
    pairs = np.column_stack(touch_places(model))
    planes = np.flatnonzero(model.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE)).tolist()
    for start, data in linted.starts.items():
        for joint in np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)).tolist():
            body = int(model.jnt_bodyid[joint])
            own = model.body_rootid[model.geom_bodyid] == model.body_rootid[body]
            for plane in planes:
                normal = data.geom_xmat[plane].reshape(3, 3)[:, 2]
                below = float(normal @ (data.geom_xpos[plane] - data.subtree_com[body]))
                touches = own[pairs[(pairs == plane).any(axis=1)]].any()
                if below > COARSE_ROUNDING * model.stat.extent and touches:
                    name, floor = linted.name("body", body), linted.name("geom", plane)
                    yield Fault(
                        f"at {start}, the center of mass of {name} is {1e3 * below:.3g} mm below "
                        f"{floor}, which throws it out; raise it",
                        linted.place("body", body),
                    )
                    return


@rule("pressing", "warn")
def find_pressed_bodies(linted: LintedModel) -> Iterator[Fault]:
    """Joints hold bodies in each other, which press with many times the weight, without a motor.

    The contacts press with more than ten times the weight of all that moves, at the start, without
    motors and springs. Fix: move the bodies apart, or `<exclude>`.
    """
    model, pressed_pairs = linted.model, dict[tuple[int, int], tuple[float, str]]()
    halves = half_extents(model)
    for start, state in linted.starts.items():
        loads = dict[tuple[int, int], float]()
        for pressed in find_pressing(model, state.qpos):
            geoms = list(pressed.geoms)
            low, high = sorted(map(int, model.geom_bodyid[geoms]))
            joined = _are_joined(linted, low, high) or _is_mounted(linted, low, high)
            on_floor = bool(np.isinf(halves[geoms]).any())  # a floor is not a base of its robots
            if on_floor or not joined:
                loads[low, high] = loads.get((low, high), 0.0) + pressed.weights
        for pair, weights in loads.items():
            if weights > max(MANY_WEIGHTS, pressed_pairs.get(pair, (0.0, ""))[0]):
                pressed_pairs[pair] = weights, start
    if pressed_pairs:
        pair, (times, start) = max(pressed_pairs.items(), key=lambda one: one[1][0])
        one, two = (linted.name("body", body) for body in pair)
        more = format_others(len(pressed_pairs) - 1, "pair")
        size = "over 1,000" if times > 1000 else f"{times:.3g}"  # more says no more
        yield Fault(
            f"at {start}, {one} and {two} press on each other with {size} times the weight of all "
            f"that moves, and no motor presses them{more}: joints or other bodies hold them in "
            "each other; move them apart, or exclude their contact",
            linted.place("body", pair[1]),
        )


COINCIDENT = "coincident-geoms"


@rule(COINCIDENT, "warn", voids_runs=True)
def find_doubled_geoms(linted: LintedModel) -> Iterator[Fault]:
    """Two equal geoms of one rigid part lie in one place, and both collide with the same.

    Such as a shape and its visual copy: each touch makes two contacts, which are twice as stiff.
    Fix: `contype="0" conaffinity="0"` for the copy.
    """
    doubled = find_coincident_geoms(linted.model)
    if doubled:
        edits = dict[Edit, None]()
        for _, second in doubled:
            copied = linted.name("geom", second)
            edits |= dict.fromkeys(linted.set("geom", copied, contype="0", conaffinity="0"))
        first, second = (linted.name("geom", geom) for geom in doubled[0])
        more = f"; and {len(doubled) - 1} more" if len(doubled) > 1 else ""
        yield Fault(
            f"geoms {first} and {second} are equal, lie in one place, and both collide{more}: each "
            "touch makes two contacts, which are twice as stiff; let one of them have contype 0 "
            "and conaffinity 0",
            linted.place("geom", doubled[0][1]),
            tuple(edits),
        )


def find_coincident_geoms(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Return pairs of geoms of one rigid part that fill one place and collide with the same."""
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    touch = touch_mask(model)
    doubled, copies = list[tuple[int, int]](), set[int]()
    for first, second in find_equal_places(model, np.flatnonzero(collides)):
        if first not in copies and (touch[first] & touch[second]).any():
            doubled.append((first, second))
            copies.add(second)
    return doubled


def find_equal_places(model: mujoco.MjModel, geoms: NDArray[np.int_]) -> list[tuple[int, int]]:
    """Return pairs of some geoms (n,) of one rigid part that fill one place, in their order."""
    parts = model.body_weldid[model.geom_bodyid]
    counts = np.bincount(parts[geoms], minlength=model.nbody)
    several = geoms[(counts[parts[geoms]] > 1) & (parts[geoms] > 0)]
    if not len(several):
        return []

    # Boxes around the geoms, in the frames of their parts.
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turn = np.asarray(data.xmat)[parts].reshape(-1, 3, 3).transpose(0, 2, 1)
    own = turn @ np.asarray(data.geom_xmat).reshape(-1, 3, 3)
    offset = (turn @ (data.geom_xpos - data.xpos[parts])[..., None])[..., 0]
    center = offset + (own @ model.geom_aabb[:, :3, None])[..., 0]
    half = (np.abs(own) @ model.geom_aabb[:, 3:, None])[..., 0]
    lows, highs = center - half, center + half

    same_share = 0.01  # of the smallest side: difference of boxes around a copy and its original
    pairs = list[tuple[int, int]]()
    for place, first in enumerate(several.tolist()):
        rest = several[place + 1 :]
        rest = rest[parts[rest] == parts[first]]
        apart = np.maximum(np.abs(lows[rest] - lows[first]), np.abs(highs[rest] - highs[first]))
        alike = apart.max(axis=1, initial=0.0) <= same_share * (highs[first] - lows[first]).min()
        pairs += [(first, second) for second in rest[alike].tolist()]
    return pairs


@rule("hull-fills-mesh", "note")
def find_filled_meshes(linted: LintedModel) -> Iterator[Fault]:
    """A mesh collides as its convex hull, which fills much that the mesh leaves open.

    The hull has at least 1.5 times the volume. Fix: cut the mesh into convex parts, where it
    matters.
    """
    model = linted.model
    solid = (model.geom_type == _MESH) & ((model.geom_contype != 0) | (model.geom_conaffinity != 0))
    ratios = dict[int, float]()
    most_filled = 1.5  # a larger volume of a hull over that of its mesh is another shape
    for mesh in sorted({*model.geom_dataid[solid].tolist()}):  # `np.unique` loads numpy.ma
        volume, hull = _closed_volume(model, mesh), hull_volume(model, mesh)
        if volume > 0 and hull > most_filled * volume:
            ratios[mesh] = hull / volume
    if ratios:
        worst = max(ratios, key=lambda mesh: ratios[mesh])
        geom = int(np.flatnonzero(solid & (model.geom_dataid == worst))[0])
        more = f", and {len(ratios) - 1} more" if len(ratios) > 1 else ""
        yield Fault(
            f"mesh '{model.mesh(worst).name}' collides as its convex hull, which has "
            f"{ratios[worst]:.2g} times its volume{more}: cut it into convex parts if that matters",
            linted.place("geom", geom),
        )


def _closed_volume(model: mujoco.MjModel, mesh: int) -> float:
    """Return the volume within a mesh [m^3]; 0 if it is not closed."""
    first = int(model.mesh_faceadr[mesh])
    faces = np.array(model.mesh_face[first : first + int(model.mesh_facenum[mesh])])
    edges = np.concatenate([faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    codes = edges.min(axis=1) * (int(faces.max()) + 1) + edges.max(axis=1)
    if np.any(np.unique(codes, return_counts=True)[1] != 2):
        return 0.0
    corners = mesh_vertices(model, mesh)[faces]
    return float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)
