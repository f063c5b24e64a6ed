"""Selects the monitored contact pairs of a model, and computes their contact parameters.

An explicit <pair> decides; otherwise the geom of higher priority; otherwise friction and condim by
maximum, solref and solimp by weights (element-wise minimum if a solref is in direct form), margin
and gap always by sum. No friction is below MuJoCo's minimum, and the override flag replaces the
parameters that have an override option. Source: MuJoCo's documentation, Modeling > Contact
parameters.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError, explain_fatal
from contactlab.mjcf import CONTACT
from contactlab.scene.keyframes import start_data
from contactlab.scene.model_names import match_names, name_of, require_id
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.schema.evidence import PairRecord
from contactlab.schema.scene_manifest import PairEntry
from contactlab.schema.task import QPOS0

MAX_PAIRS = 64
_BODY_PAIR_SLOTS = 16
_GEOM_OBJECT = mujoco.mjtGeom
_SURFACE_TYPES = (int(_GEOM_OBJECT.mjGEOM_PLANE), int(_GEOM_OBJECT.mjGEOM_HFIELD))


@dataclass(frozen=True)
class MonitoredPair:
    """A monitored contact pair: two geoms, or two bodies with all of their geoms."""

    name: str  # `side-side`, unique in the model
    sides: tuple[str, str]  # the names of both geoms or bodies
    bodies: bool  # whether the sides are bodies
    geoms: tuple[tuple[int, ...], tuple[int, ...]]  # ids of the geoms on each side
    slots: int  # number of its contacts that are recorded each step


def declared_pairs(
    model: mujoco.MjModel, entries: tuple[PairEntry, ...]
) -> tuple[MonitoredPair, ...]:
    """Return the pairs that a manifest lists.

    Raises a SceneError if one is unknown or listed twice.
    """
    pairs = tuple(pair for entry in entries for pair in entry_pairs(model, entry))
    names = [pair.name for pair in pairs]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"the pair {name} is listed twice")
    return pairs


def detected_pairs(model: mujoco.MjModel, keyframe: str = QPOS0) -> tuple[MonitoredPair, ...]:
    """Return the geom pairs that can touch: all of them, or the 64 likeliest.

    The likeliest are those that touch in short runs, then those of free trees, because a free body
    may come to lie on anything: first against fixed geoms, then against others. Within each group
    the nearest at the start come first. The runs start at qpos0 and at the keyframe, because
    contacts depend on the posture, such as whether fingers are open or closed.
    """
    # A pair of two moving geoms counts twice.
    most = sum(np.count_nonzero(part) for _, part in _touch_rows(model)) + model.npair
    pairs = touch_pairs(model) if most <= 2 * MAX_PAIRS else []
    if most > 2 * MAX_PAIRS or len(pairs) > MAX_PAIRS:
        touching = _touching_pairs(model, {QPOS0, keyframe})
        pairs = [*touching, *_likely_pairs(model, keyframe, touching)][:MAX_PAIRS]
    rough = [bool((model.geom_type[[*pair]] == _GEOM_OBJECT.mjGEOM_HFIELD).any()) for pair in pairs]
    # At most the 50 contacts of two geoms in MuJoCo (mjMAXCONPAIR), as only height fields need. All
    # pairs with height fields share 400 slots; each slot takes 184 bytes per step.
    shared = min(50, max(_BODY_PAIR_SLOTS, 400 // max(sum(rough), 1)))
    slots = [shared if is_rough else None for is_rough in rough]
    return tuple(_geom_pair(model, *pair, most) for pair, most in zip(pairs, slots, strict=True))


def _likely_pairs(
    model: mujoco.MjModel, keyframe: str, touching: list[tuple[int, int]]
) -> list[tuple[int, int]]:
    # The likeliest of the pairs that do not touch, in order: by group, then by gap at the start.
    bodies = np.asarray(model.geom_bodyid)
    fixed = model.body_weldid[bodies] == 0
    roots = model.body_rootid[bodies]
    free = np.isin(roots, model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE])
    data = start_data(model, keyframe)
    mujoco.mj_kinematics(model, data)
    flat = np.isin(model.geom_type, _SURFACE_TYPES)
    known = np.array([first * model.ngeom + second for first, second in touching], np.intp)

    def measure_pairs(codes: NDArray[np.intp]) -> tuple[NDArray[np.intp], Floats]:
        # The group of each pair, and its approximate gap: a million exact ones take 20 s.
        first, second = np.divmod(codes, model.ngeom)
        is_free, is_fixed = free[first] | free[second], fixed[first] | fixed[second]
        groups = np.where(is_free, np.where(is_fixed, 0, 1), 2)
        between = np.linalg.norm(data.geom_xpos[first] - data.geom_xpos[second], axis=1)
        gaps = between - model.geom_rbound[first] - model.geom_rbound[second]
        gaps[flat[first] | flat[second]] = -np.finfo(float).max / 2
        return groups, gaps

    def widen_bound(bound: float) -> float:
        # Equal gaps of a regular scene differ by rounding, and are ranked by exact ones later.
        return bound + 1e-9 * (1 + abs(bound))

    def keep_likely(codes: NDArray[np.intp]) -> NDArray[np.intp]:
        codes = np.setdiff1d(codes, known)
        groups, gaps = measure_pairs(codes)
        kept, left = [codes[:0]], MAX_PAIRS
        for group in range(3):
            inside, own = codes[groups == group], gaps[groups == group]
            if len(inside) > left > 0:
                bound = np.partition(own, left - 1)[left - 1]
                inside = inside[own <= widen_bound(bound)]
            kept.append(inside if left > 0 else inside[:0])
            left -= len(inside)
        return np.concatenate(kept)

    def drop_unlikely(codes: NDArray[np.intp], likely: NDArray[np.intp]) -> NDArray[np.intp]:
        # Leave out pairs behind the last of enough likely ones, before anything is sorted.
        if len(likely) < MAX_PAIRS:
            return codes
        own_groups, own_gaps = measure_pairs(likely)
        last = own_groups.max()
        bound = own_gaps[own_groups == last].max()
        groups, gaps = measure_pairs(codes)
        return codes[(groups < last) | ((groups == last) & (gaps <= widen_bound(bound)))]

    likely = np.array([*zip(model.pair_geom1, model.pair_geom2, strict=True)], np.intp)
    likely = np.sort(likely.reshape(-1, 2), axis=1) @ np.array([model.ngeom, 1])
    moving = model.body_dofnum[model.body_weldid[bodies]] > 0
    for rows, part in _touch_rows(model):
        # A pair of two moving geoms counts once.
        places, others = np.nonzero(part & (~moving | (rows[:, None] < np.arange(model.ngeom))))
        own = rows[places]
        codes = np.minimum(own, others) * model.ngeom + np.maximum(own, others)
        likely = keep_likely(np.concatenate([likely, drop_unlikely(codes, likely)]))

    def rank_pair(pair: tuple[int, int]) -> tuple[int, float, tuple[int, int]]:
        first, second = pair
        is_free = free[first] or free[second]
        group = 2 if not is_free else 0 if fixed[first] or fixed[second] else 1
        between = np.linalg.norm(data.geom_xpos[first] - data.geom_xpos[second])
        gap = float(between - model.geom_rbound[[first, second]].sum())
        return group, -np.inf if flat[first] or flat[second] else gap, pair

    return sorted((divmod(code, model.ngeom) for code in likely.tolist()), key=rank_pair)


def entry_pairs(model: mujoco.MjModel, entry: PairEntry) -> list[MonitoredPair]:
    """Return the pairs of one entry of a manifest; see `declared_pairs`."""
    if [entry.bodies, entry.chain, entry.geoms].count(None) != 2:
        raise SceneError("an entry of pairs takes exactly one of geoms, bodies and chain")
    if entry.bodies is not None:
        first, second = entry.bodies
        sides = (_colliding_geoms(model, first), _colliding_geoms(model, second))
        slots = entry.slots or _BODY_PAIR_SLOTS
        return [MonitoredPair(f"{first}-{second}", (first, second), True, sides, slots)]
    chain = [*(entry.geoms or ())]
    if entry.chain:
        names = [name_of(model, "geom", index) for index in range(model.ngeom)]
        chain = [name for part in entry.chain for name in match_names(names, part) or [part]]
    ids = [require_id(model, "geom", name) for name in chain]
    if len(ids) < 2:
        raise SceneError(f"the chain {', '.join(chain)} has fewer than two geoms")
    return [_geom_pair(model, first, second, entry.slots) for first, second in pairwise(ids)]


def _geom_pair(model: mujoco.MjModel, first: int, second: int, slots: int | None) -> MonitoredPair:
    names = (name_of(model, "geom", first), name_of(model, "geom", second))
    shapes = {int(model.geom_type[first]), int(model.geom_type[second])}
    # The most contacts of two such shapes.
    if _GEOM_OBJECT.mjGEOM_HFIELD in shapes:
        most = mujoco.mjMAXCONPAIR
    elif _GEOM_OBJECT.mjGEOM_SPHERE in shapes:
        most = 1
    else:
        most = 2 if _GEOM_OBJECT.mjGEOM_CAPSULE in shapes else 8
    slots = slots or most
    return MonitoredPair("-".join(names), names, False, ((first,), (second,)), slots)


def _colliding_geoms(model: mujoco.MjModel, name: str) -> tuple[int, ...]:
    own = np.asarray(model.geom_bodyid) == require_id(model, "body", name)
    listed = np.isin(np.arange(model.ngeom), [model.pair_geom1, model.pair_geom2])
    solid = listed | (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    geoms: list[int] = np.flatnonzero(own & solid).tolist()
    if not geoms:
        raise SceneError(f"body '{name}' has no geom that can collide")
    return tuple(geoms)


def colliding_geoms(
    model: mujoco.MjModel, pairs: Sequence[MonitoredPair]
) -> list[list[tuple[int, int]]]:
    """Return the geoms of each pair, one of each side, that MuJoCo's filters let touch.

    These are the places of `touch_mask`, found without a mask of all geoms.
    """
    sides = [list(product(*pair.geoms)) for pair in pairs]
    every = [geoms for side in sides for geoms in side]
    first, second = np.array(every, np.intp).reshape(-1, 2).T
    bodies = np.asarray(model.geom_bodyid)
    dofs = model.body_dofnum[model.body_weldid[bodies]]
    touch = _pass_filters(model, first, second) & ((dofs[first] > 0) | (dofs[second] > 0))
    for one, other in ((first, second), (second, first)):
        signatures = bodies[one].astype(np.intp) << 16 | bodies[other]
        touch &= ~np.isin(signatures, model.exclude_signature)
    listed = {*zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True)}
    passed = iter(touch.tolist())
    return [
        [geoms for geoms in side if next(passed) or geoms in listed or geoms[::-1] in listed]
        for side in sides
    ]


def half_extents(model: mujoco.MjModel) -> Floats:
    """Return half the smallest extent of each geom (ngeom,) [m].

    It is infinite for planes and height fields, which have no opposite side.
    """
    return np.where(
        np.isin(model.geom_type, _SURFACE_TYPES), np.inf, model.geom_aabb[:, 3:].min(axis=1)
    )


def geom_ends(model: mujoco.MjModel, data: mujoco.MjData, way: Floats) -> Floats:
    """Return both ends of the bounding boxes of all geoms along a unit vector (2, ngeom) [m].

    They are infinite for planes and height fields.
    """
    frames = data.geom_xmat.reshape(-1, 3, 3)
    centers = data.geom_xpos + np.einsum("gij,gj->gi", frames, model.geom_aabb[:, :3])
    halves = (np.abs(np.einsum("gij,i->gj", frames, way)) * model.geom_aabb[:, 3:]).sum(axis=1)
    halves = np.where(np.isin(model.geom_type, _SURFACE_TYPES), np.inf, halves)
    return np.array([centers @ way - halves, centers @ way + halves])


def body_reaches(model: mujoco.MjModel) -> Floats:
    """Return how far the geoms of each body reach from its frame [m] (nbody,); 0 without geoms."""
    reach = np.zeros(model.nbody)
    ends = np.linalg.norm(model.geom_pos, axis=1) + model.geom_rbound
    np.maximum.at(reach, model.geom_bodyid, ends)
    return reach


def touch_mask(model: mujoco.MjModel, *, listed: bool = True) -> NDArray[np.bool_]:
    """Return (ngeom, ngeom) whether MuJoCo's collision filters let two geoms touch.

    The geoms of <pair> elements touch whatever their masks are. If not `listed`, they do not count.
    Source: MuJoCo's documentation, Computation > Collision > Selection.
    """
    # Pages of zeros that are not written take no memory.
    touch = np.zeros((model.ngeom, model.ngeom), np.bool_)
    for rows, part in _touch_rows(model):
        touch[rows] = part
        touch[:, rows] = part.T
    for pair in zip(model.pair_geom1, model.pair_geom2, strict=True):
        touch[pair] = touch[pair[::-1]] = listed
    return touch


def touch_places(
    model: mujoco.MjModel, *, listed: bool = True
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return (P,) the first and the second geoms of the pairs of `touch_mask`, in order.

    Many geoms that do not move take neither the time nor the memory of a mask.
    """
    codes = [np.empty(0, np.intp)]
    for rows, part in _touch_rows(model):
        places, others = np.nonzero(part)
        own = rows[places]
        codes.append(np.minimum(own, others) * model.ngeom + np.maximum(own, others))
    pairs = np.sort([model.pair_geom1, model.pair_geom2], axis=0).astype(np.intp)
    listed_codes = pairs[0] * model.ngeom + pairs[1]
    sorted_codes = np.sort(np.concatenate([*codes, listed_codes]))
    # `np.unique` loads a module, and runs call this: Ctrl-C would end them there.
    found = sorted_codes[np.diff(sorted_codes, prepend=-1) > 0]
    if not listed:
        found = found[~np.isin(found, listed_codes)]
    first, second = np.divmod(found, max(model.ngeom, 1))
    return first, second


def touch_pairs(model: mujoco.MjModel, *, listed: bool = True) -> list[tuple[int, int]]:
    """Return the pairs of geoms of `touch_mask`, the lower id first, in order."""
    first, second = touch_places(model, listed=listed)
    return list(zip(first.tolist(), second.tolist(), strict=True))


def _touch_rows(model: mujoco.MjModel) -> Iterator[tuple[NDArray[np.intp], NDArray[np.bool_]]]:
    # Yield some moving geoms, and (rows, ngeom) whether they may touch each geom.
    bodies, everything = np.asarray(model.geom_bodyid), np.arange(model.ngeom)
    # One of two geoms moves.
    moving = np.flatnonzero(model.body_dofnum[model.body_weldid[bodies]] > 0)
    at_once = max(1, (1 << 22) // max(model.ngeom, 1))
    for begin in range(0, len(moving), at_once):
        rows = moving[begin : begin + at_once]
        part = _pass_filters(model, rows[:, None], everything)
        for signature in model.exclude_signature:
            excluded = divmod(int(signature), 1 << 16)
            for first, second in (excluded, excluded[::-1]):
                part[np.ix_(bodies[rows] == first, bodies == second)] = False
        yield rows, part


def _pass_filters(
    model: mujoco.MjModel, first: NDArray[np.intp], second: NDArray[np.intp]
) -> NDArray[np.bool_]:
    # Whether masks, welds and parents of geoms, of shapes that broadcast, let them touch.
    welds = model.body_weldid[model.geom_bodyid]
    flat = np.isin(model.geom_type, _SURFACE_TYPES)
    kinds, affinities = np.asarray(model.geom_contype), np.asarray(model.geom_conaffinity)
    own, other = welds[first], welds[second]
    touch = (kinds[first] & affinities[second] | affinities[first] & kinds[second]) != 0
    touch &= (own != other) & ~(flat[first] & flat[second])
    if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT:
        parents = model.body_weldid[model.body_parentid[welds]]
        touch &= ~((other > 0) & (other == parents[first]))
        touch &= ~((own > 0) & (own == parents[second]))
    return touch


def mask_overlap(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return (ngeom, ngeom) whether contype and conaffinity of two geoms let them touch."""
    kinds, affinities = np.asarray(model.geom_contype), np.asarray(model.geom_conaffinity)
    bits = kinds[:, None] & affinities
    return (bits | bits.T) != 0


def geom_pairs(touch: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the geom pairs with a true entry in a symmetric (ngeom, ngeom) mask, in order."""
    first, second = np.nonzero(touch)
    upper = first < second
    return list(zip(first[upper].tolist(), second[upper].tolist(), strict=True))


def _touching_pairs(model: mujoco.MjModel, keyframes: set[str]) -> list[tuple[int, int]]:
    """Return the geom pairs that touch in a short run from each start, most frequent first."""
    silence_mujoco()
    detection_steps = 2000  # 4 s of the default timestep
    most_contacts = 200_000  # of a start: a hundred bodies show their pairs in 2 s
    pair_codes = [np.empty(0, np.int64)]
    try:
        for data in [start_data(model, keyframe) for keyframe in keyframes]:
            contacts_left = most_contacts
            for _ in range(detection_steps):
                mujoco.mj_step(model, data)
                touching = data.contact.geom.astype(np.int64)
                touching = touching[touching.min(axis=1) >= 0]  # a contact of a flex has geom -1
                pair_codes.append(touching.min(axis=1) * model.ngeom + touching.max(axis=1))
                contacts_left -= len(touching)
                if contacts_left < 0:
                    break
    except mujoco.FatalError as error:
        why = explain_fatal(error)
        raise SceneError(f"cannot detect contact pairs: the simulation failed: {why}") from error
    pairs, counts = np.unique(np.concatenate(pair_codes), return_counts=True)
    order: list[int] = pairs[np.argsort(-counts, kind="stable")].tolist()
    return [divmod(pair, model.ngeom) for pair in order]


def effective_parameters(model: mujoco.MjModel, pair: MonitoredPair) -> PairRecord:
    """Return the effective contact parameters of a pair's first two geoms.

    For a pair of bodies these represent all of their geoms, with the largest friction among them,
    which bounds the cone of every contact.
    """
    first, second = pair.geoms[0][0], pair.geoms[1][0]
    explicit, fields = explicit_pair(model, first, second), dict[str, Any]()
    if explicit is not None:
        columns = {**{name: f"pair_{name}" for name in CONTACT}, "condim": "pair_dim"}
        fields |= {
            name: getattr(model, column)[explicit].tolist() for name, column in columns.items()
        }
    else:
        both, deciding = [first, second], _deciding_geoms(model, first, second)
        weight = mixing_weight(model, first, second)
        (one, two), (solimp, other) = model.geom_solref[both], model.geom_solimp[both]
        mean = len(deciding) == 1 or (one[0] > 0 and two[0] > 0)
        fields |= {
            "condim": int(model.geom_condim[deciding].max()),
            "friction": _pair_friction(model, first, second),
            "solref": _float_tuple(
                weight * one + (1 - weight) * two if mean else np.minimum(one, two)
            ),
            "solimp": _float_tuple(weight * solimp + (1 - weight) * other),
            "margin": float(model.geom_margin[both].sum()),
            "gap": float(model.geom_gap[both].sum()),
        }
    frictions = [fields["friction"]]
    if pair.bodies:
        frictions += [_pair_friction(model, *geoms) for geoms in product(*pair.geoms)]
    fields["friction"] = _float_tuple(np.max(frictions, axis=0), mujoco.mjMINMU)
    if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE:
        fields |= {
            "friction": _float_tuple(model.opt.o_friction, mujoco.mjMINMU),
            "solref": _float_tuple(model.opt.o_solref),
            "solimp": _float_tuple(model.opt.o_solimp),
            "margin": float(model.opt.o_margin),
        }
    return PairRecord(**fields)


def explicit_pair(model: mujoco.MjModel, first: int, second: int) -> int | None:
    """Return the index of the <pair> element that names both geoms, or None."""
    pairs = zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True)
    return next((index for index, pair in enumerate(pairs) if set(pair) == {first, second}), None)


def _deciding_geoms(model: mujoco.MjModel, first: int, second: int) -> list[int]:
    most = max(model.geom_priority[first], model.geom_priority[second])
    return [geom for geom in (first, second) if model.geom_priority[geom] == most]


def _pair_friction(model: mujoco.MjModel, first: int, second: int) -> tuple[float, ...]:
    three = model.geom_friction[_deciding_geoms(model, first, second)].max(axis=0)
    slide, torsion, roll = (float(value) for value in three)
    return slide, slide, torsion, roll, roll


def mixing_weight(model: mujoco.MjModel, first: int, second: int) -> float:
    """Return the first geom's weight in the mean of solref, and of solimp."""
    deciding = _deciding_geoms(model, first, second)
    if len(deciding) == 1:
        return float(deciding == [first])
    min_weight = 1e-15  # smaller weights count as 0, as in MuJoCo (mjMINVAL)
    mixes = np.where(model.geom_solmix[deciding] < min_weight, 0.0, model.geom_solmix[deciding])
    return float(mixes[0] / mixes.sum()) if mixes.any() else 0.5


def _float_tuple(
    values: np.ndarray | tuple[float, ...], least: float = -np.inf
) -> tuple[float, ...]:
    return tuple(np.maximum(values, least).tolist())
