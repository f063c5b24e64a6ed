"""Modifications of the structure of a model: its start, its collision shapes, its parts."""

from contactlab.modifications.model_predicates import find_colliding_geoms
from contactlab.modifications.modification import Modification, PartFix, PartRemoval

MODIFICATIONS = (
    Modification(
        "geom collisions",
        "Removes all collisions of a geom.",
        ("geom_contype", "geom_conaffinity"),
        "model",
        removals=(PartRemoval("geom", ("geom_contype", "geom_conaffinity"), find_colliding_geoms),),
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
