"""Modifications of joints, tendons, actuators, masses and fields of force."""

from contactlab.modifications.model_changes import (
    clear_fields,
    disable_effect,
    remove_clamps,
    remove_fluid,
    remove_gravity,
    scale_masses,
    stiffen_equalities,
    stiffen_fields,
)
from contactlab.modifications.model_predicates import (
    find_limited_joints,
    has_clamps,
    has_equalities,
    has_fluid,
    has_friction_loss,
    has_gravity,
    has_joining_equalities,
    has_limits,
    has_nonzero,
)
from contactlab.modifications.modification import (
    ANY_LABEL,
    Feature,
    GripFix,
    Modification,
    PartFix,
    PartRemoval,
    Row,
)
from contactlab.modifications.state_predicates import (
    has_equality_force,
    has_force,
    has_friction_loss_force,
    has_limit_force,
    has_tendon_force,
    is_clamped,
    joins_bodies,
)
from contactlab.scene.variants import Variant

TENDON_FORCE_FIELDS = (
    "tendon_stiffness",
    "tendon_stiffnesspoly",
    "tendon_damping",
    "tendon_dampingpoly",
    "tendon_frictionloss",
)
"""Fields of forces that a tendon has within its limits."""
_TENDON_FIELDS = (*TENDON_FORCE_FIELDS, "tendon_limited")
_DAMPING_FIELDS = (
    "dof_damping",
    "dof_dampingpoly",
    "tendon_damping",
    "tendon_dampingpoly",
    "actuator_damping",
    "actuator_dampingpoly",
)
_SPRING_FIELDS = ("jnt_stiffness", "tendon_stiffness", "jnt_stiffnesspoly", "tendon_stiffnesspoly")

MODIFICATIONS = (
    Modification(
        "limit softness",
        "Makes limits of joints and tendons stiffer.",
        ("jnt_solref", "jnt_solimp", "tendon_solref_lim", "tendon_solimp_lim"),
        "model",
        rows=(
            Row(
                "limit softness",
                "solref of limits / 2",
                "model",
                (stiffen_fields("jnt_solref", "tendon_solref_lim"),),
                has_limits,
                has_limit_force,
                subject="joint limit softness",
                alternative="half the limit solref",
            ),
        ),
        part_fixes=(
            PartFix(
                "solref",
                ("jnt_solref", "tendon_solref_lim"),
                labels=("constraint_violated",),
                rows=("limit softness",),
            ),
            PartFix(
                "solimp",
                ("jnt_solimp", "tendon_solimp_lim"),
                labels=("constraint_violated",),
                rows=("limit softness",),
            ),
        ),
    ),
    Modification(
        "friction loss softness",
        "Makes dry friction of joints and tendons stiffer.",
        ("dof_solref", "dof_solimp", "tendon_solref_fri", "tendon_solimp_fri"),
        "model",
        rows=(
            Row(
                "friction loss softness",
                "solref of friction loss / 2",
                "model",
                (stiffen_fields("dof_solref", "tendon_solref_fri"),),
                has_friction_loss,
                has_friction_loss_force,
                subject="friction loss softness",
                alternative="half the friction loss solref",
            ),
        ),
        part_fixes=(
            PartFix(
                "solref", ("dof_solref", "tendon_solref_fri"), rows=("friction loss softness",)
            ),
            PartFix(
                "solimp", ("dof_solimp", "tendon_solimp_fri"), rows=("friction loss softness",)
            ),
        ),
    ),
    Modification(
        "equality softness",
        "Makes equality constraints stiffer.",
        ("eq_solref", "eq_solimp"),
        "model",
        rows=(
            Row(
                "equality softness",
                "solref of equalities / 2, except those that mocap bodies drive",
                "model",
                (stiffen_equalities,),
                has_joining_equalities,
                joins_bodies,
                subject="equality softness",
                alternative="half the equality solref",
            ),
        ),
        part_fixes=(
            PartFix(
                "solref",
                ("eq_solref",),
                labels=("constraint_violated",),
                rows=("equality softness",),
            ),
            PartFix(
                "solimp",
                ("eq_solimp",),
                labels=("constraint_violated",),
                rows=("equality softness",),
            ),
        ),
    ),
    Modification(
        "friction loss",
        "Removes dry friction of joints and tendons.",
        ("frictionloss", "dof_frictionloss", "tendon_frictionloss"),
        "model",
        rows=(
            Row(
                "friction loss",
                "no friction loss",
                "effect",
                (clear_fields("dof_frictionloss", "tendon_frictionloss"),),
                has_friction_loss,
                has_friction_loss_force,
            ),
        ),
        features=(Feature("frictionloss"),),
    ),
    Modification(
        "servo gains",
        "Lowers gains of servos until the time step can hold them, at the same damping ratio.",
        ("actuator_gainprm", "actuator_biasprm"),
        "model",
        part_fixes=(
            PartFix(
                "gains",
                ("actuator_gainprm", "actuator_biasprm"),
                labels=(ANY_LABEL,),
            ),
        ),
    ),
    Modification(
        "actuators",
        "Removes the force of actuators.",
        ("actuator_gainprm", "actuator_biasprm"),
        "model",
        # A program may command any of them.
        safeguard=True,
        features=(Feature("actuation"),),
        removals=(
            PartRemoval(
                "actuator",
                ("actuator_gainprm", "actuator_biasprm"),
                lambda model: range(model.nu),
            ),
        ),
    ),
    Modification(
        "squeeze",
        "Closes a hand with more or less force.",
        ("ctrl",),
        "model",
        grip_fixes=(GripFix(lambda _: "the squeeze", "squeeze", None),),
    ),
    Modification(
        "armature",
        "Adds rotor inertia to joints, so that the time step can hold their servos.",
        ("dof_armature",),
        "model",
        part_fixes=(PartFix("armature", ("dof_armature",), labels=(ANY_LABEL,)),),
        features=(Feature("armature", fields=("dof_armature",)),),
    ),
    Modification(
        "damping",
        "Adds joint damping, so that the time step can hold servos, or removes damping.",
        ("damper", "dof_damping", "tendon_damping", "actuator_damping"),
        "model",
        rows=(
            Row(
                "damping",
                "no damping",
                "effect",
                (clear_fields(*_DAMPING_FIELDS),),
                has_nonzero(*_DAMPING_FIELDS),
                has_force("qfrc_damper"),
            ),
        ),
        part_fixes=(PartFix("damping", ("dof_damping",), labels=(ANY_LABEL,)),),
        features=(Feature("damper"),),
    ),
    Modification(
        "springs",
        "Removes springs of joints and tendons.",
        ("spring", "jnt_stiffness", "tendon_stiffness"),
        "model",
        rows=(
            Row(
                "springs",
                "no springs",
                "effect",
                (clear_fields(*_SPRING_FIELDS),),
                has_nonzero(*_SPRING_FIELDS),
                has_force("qfrc_spring"),
            ),
        ),
        features=(Feature("spring"),),
    ),
    Modification(
        "fluid",
        "Removes the density and the viscosity of the medium.",
        ("density", "viscosity"),
        "model",
        rows=(
            Row("fluid", "no fluid", "effect", (remove_fluid,), has_fluid, has_force("qfrc_fluid")),
        ),
        features=(Feature("air"),),
    ),
    Modification(
        "limits",
        "Removes limits of joints and tendons.",
        ("limit",),
        "model",
        safeguard=True,
        rows=(
            Row(
                "limits",
                "no limits",
                "effect",
                (disable_effect("limit"),),
                has_limits,
                has_limit_force,
            ),
        ),
        features=(Feature("limit"),),
        removals=(PartRemoval("limit", ("jnt_limited",), find_limited_joints),),
    ),
    Modification(
        "tendons",
        "Makes tendons slack, so that they exert no force of their own.",
        ("tendon_stiffness", "tendon_damping", "tendon_frictionloss"),
        "model",
        rows=(
            Row(
                "tendons",
                "slack tendons",
                "effect",
                (clear_fields(*_TENDON_FIELDS),),
                has_nonzero(*_TENDON_FIELDS),
                has_tendon_force,
            ),
        ),
        features=(Feature("tendon"),),
        removals=(PartRemoval("tendon", _TENDON_FIELDS, lambda model: range(model.ntendon)),),
    ),
    Modification(
        "equalities",
        "Removes equality constraints.",
        ("equality",),
        "model",
        rows=(
            Row(
                "equalities",
                "no equalities",
                "effect",
                (disable_effect("equality"),),
                has_equalities,
                has_equality_force,
            ),
        ),
        features=(Feature("equality", safeguard=True),),
    ),
    Modification(
        "gravity compensation",
        "Removes gravity compensation of bodies.",
        ("body_gravcomp",),
        "model",
        rows=(
            Row(
                "gravity compensation",
                "no gravity compensation",
                "effect",
                (clear_fields("body_gravcomp"),),
                lambda model: has_nonzero("body_gravcomp")(model) and has_gravity(model),
                has_force("qfrc_gravcomp"),
            ),
        ),
        features=(Feature("gravity compensation", fields=("body_gravcomp",)),),
    ),
    Modification(
        "clamps",
        "Removes limits of controls and forces.",
        ("clampctrl", "actuator_forcerange", "jnt_actfrcrange", "tendon_actfrcrange"),
        "model",
        safeguard=True,
        rows=(
            Row(
                "clamps",
                "no limits of controls and forces",
                "effect",
                (remove_clamps,),
                has_clamps,
                is_clamped,
            ),
        ),
        features=(Feature("clampctrl"),),
    ),
    Modification(
        "gravity",
        "Removes gravity.",
        ("gravity",),
        "model",
        rows=(Row("gravity", "no gravity", "effect", (remove_gravity,), has_gravity),),
        features=(Feature("gravity", off={"gravity": 0.0}, safeguard=True),),
    ),
    Modification(
        "mass",
        "Scales masses and inertias.",
        ("body_mass", "body_inertia"),
        "model",
        rows=(
            Row(
                "mass 5 %",
                "all masses + 5 % and - 5 %",
                "unknown",
                (scale_masses(1.05), scale_masses(0.95)),
                has_time=False,
            ),
        ),
        variants=(
            Variant(
                "nudged",
                "all masses + 1 in a million, to see what chance alone changes",
                "control",
                scale_masses(1 + 1e-6),
            ),
            *(
                Variant(f"mass x {factor:g}", "all masses", "robot", scale_masses(factor))
                for factor in (0.8, 1.25)
            ),
        ),
    ),
    Modification(
        "latency",
        "Delays the actions of a policy.",
        ("ctrl",),
        "model",
        variants=(Variant("late actions", "actions one control step late", "robot", delay=1),),
    ),
    Modification(
        "sensor noise",
        "Adds noise to the observations of a policy.",
        ("sensor",),
        "model",
        variants=(
            Variant(
                "noisy observations",
                "normal noise of 0.001 (1 mm, 1 mrad) on each observed number",
                "robot",
                noise=1e-3,
            ),
        ),
    ),
)
