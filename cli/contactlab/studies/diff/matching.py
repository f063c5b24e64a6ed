"""Matches the parts of two models, by name and then by structure."""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.scene.model_names import is_address, name_of

Matches = Sequence[tuple[int, int]]


@dataclass(frozen=True)
class MatchedParts:
    """Ids of the parts that two models share, by kind, and of those that only one has."""

    both: Mapping[str, Matches]
    gone: Mapping[str, Sequence[int]]
    new: Mapping[str, Sequence[int]]


def match_parts(one: mujoco.MjModel, other: mujoco.MjModel) -> MatchedParts:
    """Match the parts of two models; unnamed parts have addresses."""
    bodies = _match_bodies(one, other)
    after = dict(bodies)
    joints = _match_within_bodies(one, other, "joint", "jnt_bodyid", "jnt_type", after)
    geoms = _match_within_bodies(one, other, "geom", "geom_bodyid", "geom_type", after)
    both: dict[str, Matches] = {"body": bodies, "joint": joints, "geom": geoms}
    for kind, field in (
        ("tendon", "tendon_num"),
        ("actuator", "actuator_trntype"),
        ("equality", "eq_type"),
        ("key", ""),
    ):
        types = _part_types(one, kind, field), _part_types(other, kind, field)
        both[kind] = _by_name_then_type(_part_names(one, kind), _part_names(other, kind), types)
    same = dict(geoms)
    geom_pairs = zip(one.pair_geom1.tolist(), one.pair_geom2.tolist(), strict=True)
    ours = [frozenset(same.get(geom, -1) for geom in pair) for pair in geom_pairs]
    geom_pairs = zip(other.pair_geom1.tolist(), other.pair_geom2.tolist(), strict=True)
    both["pair"] = _by_name_then_type(
        _part_names(one, "pair"), _part_names(other, "pair"), (ours, [*map(frozenset, geom_pairs)])
    )
    counts = {kind: (len(_part_names(one, kind)), len(_part_names(other, kind))) for kind in both}
    return MatchedParts(
        both=both,
        gone={
            kind: _remaining_parts(range(counts[kind][0]), (a for a, _ in both[kind]))
            for kind in both
        },
        new={
            kind: _remaining_parts(range(counts[kind][1]), (b for _, b in both[kind]))
            for kind in both
        },
    )


def _remaining_parts(every: Iterable[int], some: Iterable[int]) -> list[int]:
    return sorted(set(every) - set(some))


def _part_types(model: mujoco.MjModel, kind: str, field: str) -> list[Hashable]:
    count = len(_part_names(model, kind))
    return np.asarray(getattr(model, field)).tolist() if field else [0] * count


def _part_names(model: mujoco.MjModel, kind: str) -> list[str]:
    """Return the names of the parts of a kind; "" for an unnamed part."""
    counts = {"joint": "njnt", "key": "nkey", "equality": "neq", "actuator": "nactuator"}
    field = counts.get(kind, f"n{kind}")
    count = int(getattr(model, field, model.nu))
    names = [name_of(model, kind, index) for index in range(count)]
    return ["" if is_address(name) else name for name in names]


def _by_name_then_type(
    ones: Sequence[str],
    others: Sequence[str],
    *levels: tuple[Sequence[Hashable], Sequence[Hashable]],
) -> list[tuple[int, int]]:
    """Match parts of equal names, then the remaining ones that are equal at a level, in order.

    Each level has a property of the parts of both models, the strictest first.
    """
    places_by_name = {name: place for place, name in enumerate(others) if name}
    matches = {
        place: places_by_name[name] for place, name in enumerate(ones) if name in places_by_name
    }
    unmatched = _remaining_parts(range(len(ones)), matches)
    free = _remaining_parts(range(len(others)), matches.values())
    for own, others_own in levels:
        for place in [place for place in unmatched if place not in matches]:
            same = next((b for b in free if others_own[b] == own[place]), None)
            if same is not None:
                matches[place] = same
                free.remove(same)
    return sorted(matches.items())


def _match_bodies(one: mujoco.MjModel, other: mujoco.MjModel) -> list[tuple[int, int]]:
    """Match bodies by name, then the remaining ones by parent and joints, in order."""
    world = 0
    matches = {world: world}
    names, others = _part_names(one, "body"), _part_names(other, "body")
    bodies_by_name = {name: body for body, name in enumerate(others) if name and body}
    matches |= {
        body: bodies_by_name[name]
        for body, name in enumerate(names)
        if body and name in bodies_by_name
    }
    free = _remaining_parts(range(other.nbody), matches.values())
    for body in _remaining_parts(range(one.nbody), matches):
        parent = matches.get(int(one.body_parentid[body]))
        same = next(
            (
                child
                for child in free
                if int(other.body_parentid[child]) == parent
                and _joint_types(other, child) == _joint_types(one, body)
            ),
            None,
        )
        if same is not None:
            matches[body] = same
            free.remove(same)
    return sorted(matches.items())


def _joint_types(model: mujoco.MjModel, body: int) -> list[int]:
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    return np.asarray(model.jnt_type[first : first + count]).tolist() if count else []


def _add_shapes(parts: Sequence[Hashable], model: mujoco.MjModel) -> list[Hashable]:
    places = (model.geom_size, model.geom_pos, model.geom_quat)
    shapes = np.column_stack([*places, model.geom_contype, model.geom_conaffinity]).round(6)
    return [(part, *shape) for part, shape in zip(parts, shapes.tolist(), strict=True)]


def _match_within_bodies(
    one: mujoco.MjModel,
    other: mujoco.MjModel,
    kind: str,
    owner: str,
    type_: str,
    bodies: Mapping[int, int],
) -> list[tuple[int, int]]:
    """Match parts of bodies by name, then the remaining ones within the same body by type.

    Geoms of equal size, place and contacts come first, since their order in a file changes nothing.
    """

    def typed(model: mujoco.MjModel, body_of: Callable[[int], Hashable]) -> list[Hashable]:
        owners, types = getattr(model, owner).tolist(), getattr(model, type_).tolist()
        return [(body_of(body), kind) for body, kind in zip(owners, types, strict=True)]

    ones = typed(one, lambda body: bodies.get(body, ("gone", body)))
    others = typed(other, lambda body: body)
    levels = [(ones, others)]
    if kind == "geom":
        levels.insert(0, (_add_shapes(ones, one), _add_shapes(others, other)))
    return _by_name_then_type(_part_names(one, kind), _part_names(other, kind), *levels)
