"""Load rules: constraints that are soft for their load, since a part is light.

A constraint yields in proportion to the inverse mass of the parts that it joins, so a light part
between two constraints yields as a spring for that part alone would under the whole load.
"""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact.contact_laws import pyramid_softness, rest_penetration
from contactlab.rendering.amounts import format_others
from contactlab.scene.compile_model import wrong_options
from contactlab.scene.contact_pairs import (
    detected_pairs,
    effective_parameters,
    half_extents,
    touch_mask,
)
from contactlab.scene.part_bodies import bodies_of_equality, bodies_of_tendon
from contactlab.studies.lint.linted_model import Fault, LintedModel
from contactlab.studies.lint.rules import rule

_JOINING = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))
_WORLD = -1


class _Link(NamedTuple):
    """An equality or a limited tendon between parts that nothing else joins."""

    name: str
    trees: frozenset[int]
    solref: tuple[float, ...]
    solimp: tuple[float, ...]


def _list_links(linted: LintedModel) -> Iterator[_Link]:
    model = linted.model
    for equality in np.flatnonzero(np.isin(model.eq_type, _JOINING) & model.eq_active0).tolist():
        yield _Link(
            f"equality {linted.name('equality', equality)}",
            _trees_of(model, bodies_of_equality(model, equality)),
            tuple(model.eq_solref[equality].tolist()),
            tuple(model.eq_solimp[equality].tolist()),
        )
    for tendon in np.flatnonzero(model.tendon_limited).tolist():
        yield _Link(
            f"tendon {linted.name('tendon', tendon)}",
            _trees_of(model, bodies_of_tendon(model, tendon)),
            tuple(model.tendon_solref_lim[tendon].tolist()),
            tuple(model.tendon_solimp_lim[tendon].tolist()),
        )


def _trees_of(model: mujoco.MjModel, bodies: tuple[str, ...]) -> frozenset[int]:
    # A link of one tree alone is to the world.
    trees = {int(model.body_treeid[model.body(name).id]) for name in bodies}
    return frozenset(trees if len(trees) > 1 else {*trees, _WORLD})


@rule("light-link", "warn")
def find_light_links(linted: LintedModel) -> Iterator[Fault]:
    """A light body joins a heavy one to the world by constraints, which stretch then.

    A constraint yields in proportion to the inverse mass of its parts: each one of the light body
    stretches by more than a hundredth of the model's extent. Fix: more mass for the light body.
    """
    model = linted.model
    gravity = float(np.linalg.norm(model.opt.gravity))
    links = [link for link in _list_links(linted) if len(link.trees) == 2]
    masses = np.array(
        [model.body_mass[model.body_treeid == tree].sum() for tree in range(model.ntree)]
    )
    light_links = list[tuple[float, float, int, _Link]]()
    for tree in range(model.ntree):
        own = [link for link in links if tree in link.trees]
        hanging = _hanging_mass(links, masses, tree) if len(own) > 1 else 0.0
        if not hanging or not masses[tree] > 0:
            continue
        for link in own:
            stretch = float(
                rest_penetration(hanging * gravity, 1 / masses[tree], link.solref, link.solimp)
            )
            light_links.append((stretch, hanging, tree, link))
    stretch, hanging, tree, link = max(
        light_links, default=(0.0, 0.0, 0, None), key=lambda one: one[0]
    )
    most_share = 0.01  # of the model's extent: more is seen
    if link is not None and stretch > most_share * model.stat.extent:
        body = int(np.flatnonzero(model.body_treeid == tree)[0])
        name = linted.name("body", body)
        yield Fault(
            f"{hanging:.3g} kg are carried by {name} of {1e3 * masses[tree]:.3g} g: {link.name} "
            f"stretches by {1e3 * stretch:.3g} mm, since a constraint is as soft as its lightest "
            f"part; give {name} more mass, or attach {link.name} to the heavy body",
            linted.place("body", body),
        )


def _hanging_mass(links: list[_Link], masses: np.ndarray, tree: int) -> float:
    # Return the mass that only a tree joins to the world [kg].
    without = _find_reached({_WORLD}, [link for link in links if tree not in link.trees])
    whole = _find_reached({_WORLD}, links)
    return float(masses[sorted(whole - without - {tree})].sum()) if tree in whole else 0.0


def _find_reached(begin: set[int], links: list[_Link]) -> set[int]:
    reached, before = {*begin}, set[int]()
    while reached != before:
        before = {*reached}
        for link in links:
            if link.trees & reached:
                reached |= link.trees
    return reached


@rule("pyramid-friction", "warn", cause="file")
def find_soft_pyramids(linted: LintedModel) -> Iterator[Fault]:
    """Pyramids of a large friction coefficient make a contact too soft to carry a weight.

    Pyramids soften a contact by mu^2 (1 + mu^2) / (condim - 1): 5,050 for a friction of 10. The
    factor is above 100, and a geom sinks in by more than a tenth of half the thinner one. Fix:
    `cone="elliptic"`, or a friction of about 1.
    """
    model = linted.model
    gravity = float(np.linalg.norm(model.opt.gravity))
    pyramids = model.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    if not pyramids or not gravity or wrong_options(model):
        return
    much_softer = 100.0  # with friction 1, pyramids are as soft as a cone, with 3.7 100 times
    written = (model.geom_friction[:, 0], model.pair_friction[:, 0], model.opt.o_friction[:1])
    largest = float(max(friction.max(initial=0) for friction in written))
    if pyramid_softness(largest, 3, float(model.opt.impratio)) < much_softer:
        return  # finding which geoms touch takes a simulation
    deep_share = 0.1  # of half the thinner geom; more is an overlap
    halves, soft_pairs = half_extents(model), list[tuple[float, float, float, tuple[int, int]]]()
    for pair in detected_pairs(model):
        used = effective_parameters(model, pair)
        softer = pyramid_softness(used.friction[0], used.condim, float(model.opt.impratio))
        if used.condim < 3 or softer < much_softer:
            continue
        first, second = pair.geoms[0][0], pair.geoms[1][0]
        # One contact of four that a body rests on.
        depth = float(rest_penetration(softer * gravity / 4, 1.0, used.solref, used.solimp))
        if depth > deep_share * float(halves[[first, second]].min()):
            soft_pairs.append((depth, softer, used.friction[0], (first, second)))
    if soft_pairs:
        depth, softer, friction, (first, second) = max(soft_pairs, key=lambda one: one[0])
        more = format_others(len(soft_pairs) - 1, "pair")
        names = f"{linted.name('geom', first)} and {linted.name('geom', second)}"
        yield Fault(
            f"friction {friction:g} under pyramids softens contacts of {names} {softer:.3g} "
            f"times: at rest they sink in by {1e3 * depth:.3g} mm{more}; write "
            'cone="elliptic", or a friction of about 1',
            linted.place("geom", first),
            linted.set_in("option", cone="elliptic"),
        )


@rule("hfield-cell", "warn")
def find_large_cells(linted: LintedModel) -> Iterator[Fault]:
    """Cells of a height field are larger than a geom that can touch it, which may fall through.

    Cells are more than four times as wide as the geom. 48 shapes fell on rough fields: none passed
    at 3 times their size, 2 at 5, 12 at 8, 33 at 40. Fix: a finer grid, or a mesh.
    """
    model = linted.model
    most_sizes = 4.0  # of a geom, see the drops above
    large_cells = list[tuple[float, float, int, int]]()
    fields = np.flatnonzero(model.geom_type == int(mujoco.mjtGeom.mjGEOM_HFIELD)).tolist()
    touch = touch_mask(model) if fields else np.zeros((0, 0), bool)
    for field in fields:
        data = int(model.geom_dataid[field])
        rows, columns = int(model.hfield_nrow[data]), int(model.hfield_ncol[data])
        wide, long = model.hfield_size[data, :2]
        cell = float(max(2 * wide / max(columns - 1, 1), 2 * long / max(rows - 1, 1)))
        for geom in np.flatnonzero(touch[field]).tolist():
            size = 2 * float(model.geom_aabb[geom, 3:].max())
            if size > 0 and cell > most_sizes * size:
                large_cells.append((cell / size, cell, field, geom))
    if large_cells:
        times, cell, field, geom = max(large_cells)
        yield Fault(
            f"cells of height field {linted.name('geom', field)} are {1e3 * cell:.3g} mm wide, "
            f"{times:.3g} times geom {linted.name('geom', geom)}: contacts of small geoms on large "
            "cells may vanish, and the geom falls through; use a finer grid, or a mesh",
            linted.place("geom", field),
        )
