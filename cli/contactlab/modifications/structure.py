"""Modifications of the structure of a model: its start, its collision shapes, its parts."""

from contactlab.modifications.model_predicates import find_colliding_geoms
from contactlab.modifications.modification import (
    Feature,
    Modification,
    PartFix,
    PartRemoval,
    Reduction,
)

MODIFICATIONS = (
    Modification(
        "geom collisions",
        "Removes all collisions of a geom.",
        ("geom_contype", "geom_conaffinity"),
        "model",
        # A push that the task does not have may need it.
        safeguard=True,
        removals=(PartRemoval("geom", ("geom_contype", "geom_conaffinity"), find_colliding_geoms),),
    ),
    Modification(
        "explicit pairs",
        "Removes pairs of geoms that collide whatever their masks are.",
        ("pair",),
        "model",
        safeguard=True,
        removals=(PartRemoval("pair", (), lambda model: range(model.npair)),),
    ),
    Modification(
        "unused parts",
        "Removes collisions that are impossible by proof, and flags that no state depends on.",
        ("geom_contype", "geom_conaffinity", "exclude", "flag"),
        "computation",
        features=(Feature("energy"),),
        reductions=(Reduction("unused", is_exact=True),),
    ),
    Modification(
        "far pairs",
        "Ignores collisions of parts that stayed this far from each other in every run.",
        ("geom_contype", "geom_conaffinity", "exclude"),
        "model",
        reductions=(Reduction("far-pairs", distance=0.05),),
    ),
    Modification(
        "hull vertices",
        "Simplifies convex hulls of meshes, moving the surface by at most this distance.",
        ("maxhullvert",),
        "model",
        # The printers and mills that parts are made with are no more exact.
        reductions=(Reduction("hulls", distance=0.001),),
    ),
    Modification(
        "sensors",
        "Removes sensors, which a program may read.",
        ("sensor",),
        "model",
        features=(Feature("sensor"),),
        reductions=(Reduction("sensors"),),
    ),
    Modification(
        "start state",
        "Begins where limits, contacts and equalities allow it.",
        ("keyframe",),
        "model",
        part_fixes=(PartFix("start", ("keyframe",)),),
    ),
    Modification(
        "root height",
        "Raises the roots of floating robots at the start, until nothing of them is in the floor.",
        ("keyframe",),
        "model",
        part_fixes=(PartFix("raise", ("keyframe",)),),
    ),
    Modification(
        "contacts between links",
        "Removes contacts between links that joints hold in each other.",
        ("exclude",),
        "model",
        part_fixes=(PartFix("exclude", ("exclude",)),),
    ),
    Modification(
        "free root",
        "Gives the root of a URDF robot a free joint, because the import welds it to the world.",
        ("freejoint",),
        "model",
        part_fixes=(PartFix("freejoint", ("freejoint",)),),
    ),
    Modification(
        "collision primitives",
        "Collides a mesh as the box, capsule, cylinder, sphere or ellipsoid that it resembles.",
        ("geom type",),
        "model",
        part_fixes=(PartFix("primitive", ("geom type",)),),
    ),
)
