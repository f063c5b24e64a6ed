"""Mass rules: impossible inertias, and visual geoms that have mass."""

from collections.abc import Iterable, Iterator

import mujoco
import numpy as np
from mujoco._specs import MjsGeom

from contactlab.scene.body_inertia import IMPOSSIBLE, in_words
from contactlab.scene.compile_model import InertiaFault
from contactlab.studies.lint.linted_model import Edit, Fault, LintedModel
from contactlab.studies.lint.overlaps import find_equal_places
from contactlab.studies.lint.rules import rule


def _combined_faults(linted: LintedModel, faults: Iterable[InertiaFault]) -> Iterator[Fault]:
    """Yield faults at the first body, combined by kind and limit."""
    alike: dict[tuple[str, float], list[InertiaFault]] = {}
    for fault in faults:
        alike.setdefault((fault.kind, fault.limit), []).append(fault)
    for same in alike.values():
        (words,) = in_words(same)
        yield Fault(words, linted.place("body", same[0].body))


@rule("inertia-impossible", "gate", of_refused=True, voids_runs=True)
def find_impossible_inertias(linted: LintedModel) -> Iterator[Fault]:
    """A body that moves has no mass, or moments of inertia that no body has.

    One principal moment exceeds the sum of the others, so free motion does not conserve energy;
    `balanceinertia` hides it. Or its mass would lie outside the whole machine in any pose, and a
    joint feels it. Fix: the inertia of the part, from its drawing or its geoms; a motor's belongs
    into `armature`.
    """
    for fault in linted.inertia_faults:
        if fault.kind in IMPOSSIBLE:
            (words,) = in_words([fault])
            remedy = "write the inertia of the part, from its drawing or its geoms"
            yield Fault(f"impossible {words}; {remedy}", linted.place("body", fault.body))


@rule("density", "note")
def find_odd_densities(linted: LintedModel) -> Iterator[Fault]:
    """A body is lighter than foam, or denser than any metal.

    Mass over volume of the geoms is below 50 or above 20,000 kg/m^3. Fix: the real mass, or geoms
    of the real size.
    """
    yield from _combined_faults(
        linted, (fault for fault in linted.inertia_faults if fault.kind == "density")
    )


@rule("inertia-shape", "note")
def find_odd_inertias(linted: LintedModel) -> Iterator[Fault]:
    """A body's inertia or center of mass does not fit the shape of its geoms.

    Common where geoms are simplified. Fix: compare the inertia with the drawing.
    """
    others = (*IMPOSSIBLE, "density")
    yield from _combined_faults(
        linted, (fault for fault in linted.inertia_faults if fault.kind not in others)
    )


@rule("visual-mass", "warn")
def find_visual_masses(linted: LintedModel) -> Iterator[Fault]:
    """Geoms that nothing can touch add to the mass of a body that has other geoms.

    They are meshes without a written mass or density, or fill the place of a geom that collides.
    They add more than 2 %: the part counts twice. Fix: `mass="0"`.
    """
    if linted.is_urdf or not (visual := _visual_geoms(linted)):
        return
    without = linted.spec.copy()
    for name in visual:
        without.geom(name).mass = 0
    try:
        bare = without.compile()
    except (ValueError, mujoco.FatalError):
        return
    model = linted.model
    if bare.nbody != model.nbody:
        return
    moving = model.body_dofnum[model.body_weldid] > 0
    added = np.asarray(model.body_mass) - bare.body_mass
    heavier_share = 0.02  # larger shares of a body's mass are reported
    heavy = moving & (bare.body_mass > 0) & (added > heavier_share * bare.body_mass)
    if not heavy.any():
        return
    geoms = [geom for geom in visual if heavy[int(model.geom(geom).bodyid[0])]]
    worst = int(np.argmax(np.where(heavy, added, -np.inf)))
    edits: dict[Edit, None] = {}
    for geom in geoms:
        edits |= dict.fromkeys(linted.set("geom", geom, mass="0"))
    first = next((geom for geom in geoms if model.geom(geom).bodyid[0] == worst), geoms[0])
    count = "a geom" if len(geoms) == 1 else f"{len(geoms)} geoms"
    whole = float(model.body_mass[worst])
    yield Fault(
        f"{added[heavy].sum():.3g} of {model.body_mass[moving].sum():.3g} kg that move belong to "
        f"{count} that nothing can touch, so that a part counts twice: most in body "
        f"'{linted.name('body', worst)}', {added[worst]:.3g} of {whole:.3g} kg",
        linted.place("geom", first),
        tuple(edits),
    )


def _visual_geoms(linted: LintedModel) -> list[str]:
    # Visual meshes without a written mass, and visual copies, of bodies without a written inertia.
    spec = linted.spec
    pair_geoms = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    always = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE

    def touches(geom: MjsGeom) -> bool:
        return bool(geom.contype or geom.conaffinity or geom.name in pair_geoms)

    def weighs(geom: MjsGeom) -> bool:
        return geom.density > 0 if np.isnan(geom.mass) else geom.mass > 0

    inferred = [body for body in spec.bodies[1:] if always or not body.explicitinertial]
    heavy = [[geom for geom in body.geoms if weighs(geom)] for body in inferred]
    doubled = [geoms for geoms in heavy if any(map(touches, geoms))]
    seen = [geom for geoms in doubled for geom in geoms if not touches(geom)]
    if not seen:
        return []
    compared = np.array([geom.id for geoms in doubled for geom in geoms])
    solid = {geom.id for geoms in doubled for geom in geoms if touches(geom)}
    pairs = find_equal_places(linted.model, compared)
    copies = {geom for pair in pairs if not solid.isdisjoint(pair) for geom in pair}
    water = 1000.0  # default density [kg/m^3]
    return [
        geom.name
        for geom in seen
        if geom.id in copies
        or (
            geom.type == mujoco.mjtGeom.mjGEOM_MESH
            and np.isnan(geom.mass)
            and geom.density == water
        )
    ]
