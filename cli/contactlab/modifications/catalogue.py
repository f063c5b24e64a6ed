"""The catalogue of modifications: one list of all that can be changed in a model.

Rows of the error budget, fixes of an examination, levers of the search, features and parts of
`effects`, and fixes of a grip are read from it. A new modification is one entry in a file of this
package.
"""

from typing import get_args

from contactlab.modifications import contacts, mechanics, numerics, structure
from contactlab.modifications.modification import (
    Candidate,
    Feature,
    Lever,
    Modification,
    PartFix,
    Reduction,
    Row,
    RowKind,
)
from contactlab.registry import Registry
from contactlab.scene.variants import Variant, VariantKind

CATALOGUE: Registry[Modification] = Registry("modification")
"""All modifications, by name."""
for _file in (numerics, contacts, mechanics, structure):
    for _entry in _file.MODIFICATIONS:
        CATALOGUE.add(_entry)


def list_rows() -> tuple[Row, ...]:
    """Return the rows of the error budget: numerics, modeling choices, effects, then parameters."""
    kinds = get_args(RowKind)
    rows = [row for entry in CATALOGUE.values() for row in entry.rows]
    return tuple(sorted(rows, key=lambda row: kinds.index(row.kind)))


def find_row(name: str) -> Row:
    """Return the row of the error budget with a name."""
    return next(row for row in list_rows() if row.name == name)


def list_candidates(stage: str = "usual") -> tuple[Candidate, ...]:
    """Return the fixes that are the same for every model, in the order of their trials."""
    fixes = [fix for entry in CATALOGUE.values() for fix in entry.fixes if fix.stage == stage]
    return tuple(sorted(fixes, key=lambda fix: (fix.order, fix.rate)))


def list_part_fixes(apply: str) -> tuple[PartFix, ...]:
    """Return the fixes of parts of a model that go by a name for `--apply`."""
    fixes = [fix for entry in CATALOGUE.values() for fix in entry.part_fixes]
    return tuple(fix for fix in fixes if fix.apply == apply)


def find_part_fix(apply: str) -> PartFix:
    """Return the only fix of parts of a model that goes by a name for `--apply`."""
    (fix,) = list_part_fixes(apply)
    return fix


def list_levers(search: str) -> tuple[Lever, ...]:
    """Return the levers of the search of `tune` that are tried in one way."""
    levers = [lever for entry in CATALOGUE.values() for lever in entry.levers]
    return tuple(sorted((one for one in levers if one.search == search), key=lambda one: one.order))


def list_features() -> tuple[Feature, ...]:
    """Return the features that `effects` leaves out, or adds, as a whole."""
    return tuple(feature for entry in CATALOGUE.values() for feature in entry.features)


def list_reductions() -> tuple[Reduction, ...]:
    """Return the parts that `tune` leaves out."""
    return tuple(one for entry in CATALOGUE.values() for one in entry.reductions)


def list_variants() -> dict[str, Variant]:
    """Return the variants of an episode by name: numerics, the control, then those of a robot."""
    kinds = get_args(VariantKind)
    variants = [one for entry in CATALOGUE.values() for one in entry.variants]
    return {one.name: one for one in sorted(variants, key=lambda one: kinds.index(one.kind))}


def find_safeguards() -> frozenset[str]:
    """Return the names of features that stay whatever they save."""
    return frozenset(
        feature.name
        for entry in CATALOGUE.values()
        for feature in entry.features
        if entry.safeguard or feature.safeguard
    )


def find_softness_rows(label: str) -> tuple[str, ...]:
    """Return the rows of the error budget that stiffen parts with a label."""
    return tuple(
        row for fix in list_part_fixes("solref") if label in fix.labels for row in fix.rows
    )


def is_numerical_label(label: str) -> bool:
    """Return whether a better computation of the same model may remove a label.

    It may not if a fix of some parts names the label, and no fix that keeps the model does. A fix
    of collision is no better computation.
    """
    entries = CATALOGUE.values()
    keeping = any(
        label in fix.labels and not fix.missed for entry in entries for fix in entry.fixes
    )
    return keeping or not any(label in fix.labels for entry in entries for fix in entry.part_fixes)
