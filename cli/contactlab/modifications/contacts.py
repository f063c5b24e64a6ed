"""Modifications of contacts and friction."""

import mujoco

from contactlab.modifications.model_changes import (
    GRIP_NOSLIP,
    add_grip_noslip,
    add_noslip,
    add_noslip_iterations,
    add_several_contacts,
    add_speculative_contacts,
    add_torsional_friction,
    choose_other_cone,
    clear_fields,
    converge_collision,
    double_friction,
    find_stiff_impratio,
    limit_condim,
    multiply_impratio,
    reduce_condim,
    scale_friction,
    set_option,
    stiffen_fields,
    stiffen_friction,
    stiffen_friction_with_noslip,
    stiffen_geoms,
    stiffen_grip,
    stiffen_grip_with_noslip,
)
from contactlab.modifications.model_predicates import (
    CONTACT_SOLREF_FIELDS,
    ELLIPTIC,
    NO_FRICTION,
    PYRAMIDAL,
    SLIDING,
    has_condim_above,
    has_flag,
    has_iterated_collision,
    has_no_flex,
    has_nonzero,
    has_possible_contacts,
    has_single_contacts,
    lacks_surroundings,
    may_collide,
    may_slip,
)
from contactlab.modifications.modification import (
    Candidate,
    Feature,
    GripFix,
    Lever,
    Modification,
    PartFix,
    Row,
)
from contactlab.modifications.numerics import ENERGY_LABELS
from contactlab.modifications.state_predicates import (
    has_any_friction,
    has_contact_force,
    has_friction,
    has_torsional_friction,
    pushes_at_distance,
)
from contactlab.scene.model_edits import FLAG_NAMES, read_flag
from contactlab.scene.variants import Variant

_MARGIN_FIELDS = ("geom_margin", "geom_gap", "pair_margin", "pair_gap", "flex_margin", "flex_gap")
COLLISION_LABELS = ("tunneling", "deep_penetration", *ENERGY_LABELS)
"""Labels that missing or wrong contacts may cause."""
MARGIN = "margin"
"""Name for `--apply` of the fix that removes all contact margins."""


def _name_stiff_grip(model: mujoco.MjModel) -> str:
    return f"elliptic cones with impratio {find_stiff_impratio(model):g}"


def _has_useless_collision(model: mujoco.MjModel) -> bool:
    possible = has_possible_contacts(model) or lacks_surroundings(model)
    return read_flag(model, "contact") and not possible


def _may_speculate(model: mujoco.MjModel) -> bool:
    return "speculative" in FLAG_NAMES and not read_flag(model, "speculative")


def _has_pyramids(model: mujoco.MjModel) -> bool:
    return model.opt.cone == PYRAMIDAL


MODIFICATIONS = (
    Modification(
        "friction cone",
        "Uses elliptic friction cones instead of pyramids, or pyramids instead of cones.",
        ("cone",),
        "computation",
        rows=(
            Row(
                "cone",
                "elliptic friction cones, not pyramids",
                "model",
                (set_option("cone", lambda _: ELLIPTIC),),
                lambda model: model.opt.cone != ELLIPTIC and has_condim_above(NO_FRICTION)(model),
                has_friction,
                subject="the friction cone",
                alternative="an elliptic cone",
            ),
            Row(
                "pyramids",
                "pyramids for friction cones",
                "effect",
                (set_option("cone", lambda _: PYRAMIDAL),),
                lambda model: model.opt.cone == ELLIPTIC and has_condim_above(NO_FRICTION)(model),
                has_friction,
            ),
        ),
        levers=(
            Lever(
                "cone",
                ("pyramidal", "elliptic"),
                rows=("cone", "pyramids"),
                load="friction",
                cost_falls=False,
            ),
        ),
        features=(Feature("elliptic", on={"elliptic": True}),),
        variants=(
            Variant(
                "other cone",
                "elliptic friction cones, or pyramids in place of cones",
                "numerics",
                choose_other_cone,
                has_condim_above(NO_FRICTION),
            ),
        ),
    ),
    Modification(
        "impratio",
        "Makes friction stiffer than the normal force, in elliptic cones.",
        ("impratio", "cone"),
        "computation",
        rows=(
            Row(
                "impratio",
                "impratio x 10, in elliptic cones: in pyramids it is of the normal force, too",
                "model",
                (set_option("impratio", lambda model: 10 * model.opt.impratio),),
                has_condim_above(NO_FRICTION),
                has_friction,
                both=set_option("cone", lambda _: ELLIPTIC),
                subject="impratio",
                alternative="ten times the impratio",
            ),
        ),
        fixes=(
            Candidate(
                "elliptic cones with impratio 10",
                "depends",
                stiffen_friction,
                labels=("step_dependent",),
                label_applies=_has_pyramids,
            ),
        ),
        levers=(
            Lever(
                "impratio",
                (1.0,),
                applies=lambda model: model.opt.impratio != 1,
                rows=("impratio",),
                load="friction",
                order=2,
            ),
        ),
        features=(Feature("impratio", off={"impratio": 1.0}, on={"impratio": 10.0}),),
        grip_fixes=(GripFix(_name_stiff_grip, "regularized", stiffen_grip),),
        variants=(
            Variant(
                "impratio x 10",
                "elliptic cones with ten times the impratio",
                "numerics",
                multiply_impratio,
                has_condim_above(NO_FRICTION),
            ),
        ),
    ),
    Modification(
        "noslip",
        "Solves friction again after the main solver, so that it slips less.",
        ("noslip_iterations", "noslip_tolerance"),
        "computation",
        rows=(
            Row(
                "noslip",
                "noslip with 10 iterations",
                "model",
                (add_noslip_iterations,),
                may_slip,
                has_any_friction,
                subject="slip in contacts",
                alternative="the noslip solver",
            ),
        ),
        fixes=(
            Candidate(
                "elliptic cones with impratio 10, and noslip",
                "depends",
                stiffen_friction_with_noslip,
                applies=has_no_flex,
                includes=("elliptic cones with impratio 10",),
            ),
            Candidate(
                "noslip with 10 iterations",
                "depends",
                add_noslip,
                rows=("noslip",),
                applies=has_no_flex,
            ),
        ),
        levers=(
            Lever(
                "noslip_iterations",
                (3, 0),
                "below",
                rows=("noslip",),
                load="friction",
                order=1,
            ),
        ),
        features=(Feature("noslip", on={"noslip": True}),),
        grip_fixes=(
            GripFix(lambda _: f"noslip {GRIP_NOSLIP}", "regularized", add_grip_noslip),
            GripFix(
                lambda model: f"{_name_stiff_grip(model)}, and noslip {GRIP_NOSLIP}",
                "regularized",
                stiffen_grip_with_noslip,
                is_both=True,
            ),
        ),
        variants=(
            Variant(
                "noslip",
                "ten more iterations that remove slip",
                "numerics",
                add_noslip_iterations,
                may_slip,
            ),
        ),
    ),
    Modification(
        "collision iterations",
        "Bounds the iterations of collisions of convex shapes and distance fields.",
        ("ccd_iterations", "ccd_tolerance", "sdf_iterations", "sdf_initpoints"),
        "computation",
        rows=(
            Row(
                "collision",
                "the run's own iterations of collision",
                "numerics",
                (converge_collision,),
                has_iterated_collision,
                has_contact_force,
                base="run",
                against="run",
                cause="collision detection stops too early",
            ),
        ),
        fixes=(
            Candidate(
                "converged collisions",
                "inaccurate",
                converge_collision,
                applies=has_iterated_collision,
                labels=COLLISION_LABELS,
                label_applies=has_iterated_collision,
                missed="collision detection stops before it has found the contacts",
                order=-1,  # collision comes before all that is computed from its contacts
            ),
        ),
        levers=(Lever("ccd_iterations", (12,), "below", order=1),),
    ),
    Modification(
        "several contacts",
        "Finds several contacts between two convex shapes that meet in a face.",
        ("multiccd",),
        "computation",
        rows=(
            Row(
                "single contacts",
                "the run's own number of contacts between faces",
                "numerics",
                (add_several_contacts,),
                has_single_contacts,
                has_contact_force,
                base="run",
                against="run",
                cause="collision finds a single contact of faces that meet: bodies turn on it",
            ),
        ),
        fixes=(
            Candidate(
                "several contacts of convex shapes",
                "inaccurate",
                add_several_contacts,
                applies=has_single_contacts,
                labels=COLLISION_LABELS,
                label_applies=has_single_contacts,
                missed="collision finds a single contact of faces that meet: bodies turn on it",
                order=-1,
            ),
        ),
        levers=(
            Lever(
                "multiccd",
                (False,),
                applies=has_flag("multiccd"),
                rows=("contact softness",),
                load="contacts",
                order=3,
            ),
        ),
        features=(Feature("multiccd"),),
        variants=(
            Variant(
                "multiccd",
                "several contacts of convex shapes that meet in a face",
                "numerics",
                add_several_contacts,
                has_single_contacts,
            ),
        ),
    ),
    Modification(
        "native convex collision",
        "Finds contacts of convex shapes by another library.",
        ("nativeccd",),
        "computation",
        features=(Feature("nativeccd"),),
    ),
    Modification(
        "midphase",
        "Compares all geoms of two bodies, without a tree that sorts them.",
        ("midphase",),
        "computation",
        features=(Feature("midphase"),),
    ),
    Modification(
        "exact diagonal",
        "Computes the exact inertia of each contact instead of an estimate.",
        ("diagexact",),
        "computation",
        levers=(Lever("diagexact", (False,), applies=has_flag("diagexact"), order=3),),
        features=(Feature("diagexact", on={"diagexact": True}),),
    ),
    Modification(
        "speculative contacts",
        "Finds contacts with bodies that a body would pass in a step.",
        ("speculative",),
        "computation",
        fixes=(
            Candidate(
                "speculative contacts",
                "inaccurate",
                add_speculative_contacts,
                applies=_may_speculate,
                labels=("tunneling",),
                label_applies=_may_speculate,
                missed="collision misses a contact: a body passes another one within a step",
                order=-1,
            ),
        ),
        levers=(Lever("speculative", (False,), applies=has_flag("speculative"), order=3),),
        features=(Feature("speculative", on={"speculative": True}),),
    ),
    Modification(
        "collision detection",
        "Leaves out collision detection if no contact is possible.",
        ("contact",),
        "computation",
        levers=(Lever("contact", (False,), applies=_has_useless_collision, order=4),),
        features=(Feature("contact", safeguard=True),),
    ),
    Modification(
        "contact softness",
        "Makes contacts stiffer by a shorter time constant or a larger impedance.",
        ("geom_solref", "geom_solimp", "pair_solref", "pair_solimp", "flex_solref"),
        "model",
        rows=(
            Row(
                "contact softness",
                "solref of contacts / 2",
                "model",
                (stiffen_fields(*CONTACT_SOLREF_FIELDS),),
                may_collide,
                has_contact_force,
                subject="contact softness",
                alternative="half the contact solref",
            ),
        ),
        part_fixes=(
            PartFix(
                "solref",
                ("geom_solref", "pair_solref"),
                labels=("deep_penetration", "tunneling", "broken"),
                rows=("contact softness",),
            ),
            PartFix(
                "solimp",
                ("geom_solimp", "pair_solimp"),
                labels=("deep_penetration", "tunneling", "broken"),
                rows=("contact softness",),
            ),
        ),
        grip_fixes=(
            GripFix(
                lambda _: "stiffer pads (half of solref)",
                "solref",
                stiffen_geoms,
                ("geom_solref",),
            ),
        ),
        variants=(
            Variant(
                "half the solref",
                "half the time constant of contacts",
                "numerics",
                stiffen_fields(*CONTACT_SOLREF_FIELDS),
                may_collide,
            ),
        ),
    ),
    Modification(
        "contact margins",
        "Removes margins and gaps, so that contacts act only when geoms touch.",
        ("geom_margin", "geom_gap", "pair_margin", "pair_gap"),
        "model",
        safeguard=True,
        rows=(
            Row(
                "margin",
                "no margins, no gaps",
                "effect",
                (clear_fields(*_MARGIN_FIELDS),),
                lambda model: may_collide(model) and has_nonzero(*_MARGIN_FIELDS)(model),
                pushes_at_distance,
            ),
        ),
        part_fixes=(
            # A contact that pushes before its geoms touch is softer than its solref says.
            PartFix(
                MARGIN,
                ("geom_margin", "geom_gap", "pair_margin", "pair_gap"),
                labels=("contact_at_distance", *ENERGY_LABELS),
                exercised="margin",
                rows=("contact softness",),
            ),
        ),
        features=(
            Feature("margin", fields=("geom_margin", "geom_gap", "pair_margin", "pair_gap")),
        ),
        variants=(
            Variant(
                "no margins",
                "contacts act only when geoms touch",
                "numerics",
                clear_fields(*_MARGIN_FIELDS),
                lambda model: may_collide(model) and has_nonzero(*_MARGIN_FIELDS)(model),
            ),
        ),
    ),
    Modification(
        "contact dimensions",
        "Removes or adds resistance of contacts against sliding, torsion or rolling.",
        ("geom_condim", "pair_dim"),
        "model",
        rows=(
            Row(
                "condim 1",
                "contacts without friction",
                "effect",
                (limit_condim(NO_FRICTION),),
                has_condim_above(NO_FRICTION),
                has_friction,
            ),
            Row(
                "condim 3",
                "contacts without torsion and rolling",
                "effect",
                (limit_condim(SLIDING),),
                has_condim_above(SLIDING),
                has_torsional_friction,
            ),
        ),
        levers=(
            # Fewer than three dimensions have no friction, which this task may not show.
            Lever(
                "condim",
                (4, 3),
                rows=("condim 3",),
                load="torsional friction",
                write=reduce_condim,
                order=5,
            ),
        ),
        features=(
            # A body that stands on a slope shows friction, and a task may have no slope.
            Feature("tangential_friction", safeguard=True),
            Feature("torsional_friction", on={"torsional_friction": True}),
            Feature("rolling_friction", on={"rolling_friction": True}),
        ),
        grip_fixes=(
            GripFix(
                lambda _: "pads that resist spin (condim 4)",
                "condim",
                add_torsional_friction,
                ("geom_condim",),
            ),
        ),
    ),
    Modification(
        "friction",
        "Scales the friction coefficients of contacts.",
        ("geom_friction", "pair_friction"),
        "model",
        rows=(
            Row(
                "friction 10 %",
                "friction + 10 % and - 10 %",
                "unknown",
                (scale_friction(1.1), scale_friction(0.9)),
                has_condim_above(NO_FRICTION),
                has_friction,
                has_time=False,
            ),
        ),
        grip_fixes=(
            GripFix(
                lambda _: "twice the pads' friction",
                "friction",
                double_friction,
                ("geom_friction",),
            ),
        ),
        variants=tuple(
            Variant(
                f"friction x {factor:g}",
                "sliding friction of all contacts",
                "robot",
                scale_friction(factor),
                has_condim_above(NO_FRICTION),
            )
            for factor in (0.8, 1.25)
        ),
    ),
)
