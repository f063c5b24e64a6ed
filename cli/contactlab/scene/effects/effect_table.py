"""Every effect: what it is, how it is turned on and off, what calls for it, when it is unused."""

from contactlab.registry import Registry
from contactlab.scene.effects import proofs
from contactlab.scene.effects.effect import (
    Effect,
    Kind,
    by_compiling,
    by_condim,
    by_flag,
    by_options,
    by_tendons,
)
from contactlab.scene.effects.proofs import Proof, never, zero
from contactlab.scene.model_options import FLAGS
from contactlab.schema.coverage import Feature

EFFECTS: Registry[Effect] = Registry("effect")
"""Every effect that this version of MuJoCo has, in the order of records and tables."""


def _flag(
    name: str,
    kind: Kind,
    what: str,
    called_by: str,
    unused: Proof = never,
    feature: Feature | None = None,
) -> Effect:
    """Return the effect of one of MuJoCo's flags, which has its name."""
    return Effect(name, kind, what, by_flag(name), called_by, unused, feature=feature)


_EFFECTS = (
    _flag(
        "contact",
        "physical",
        "normal force between bodies that touch",
        "geoms that can touch",
        proofs.no_contact,
        feature="contact",
    ),
    Effect(
        "tangential_friction",
        "physical",
        "force against sliding",
        by_condim(3, 1),
        "contacts that may slide",
        proofs.straight_drop,
        feature="friction",
    ),
    Effect(
        "torsional_friction",
        "physical",
        "torque against spin about the normal",
        by_condim(4, 3),
        "bodies that may spin in their contacts",
        proofs.no_turning,
        on={"torsional_friction": True},
        feature="spin",
    ),
    Effect(
        "rolling_friction",
        "physical",
        "torque against rolling",
        by_condim(6, 4),
        "bodies that may roll",
        proofs.no_turning,
        on={"rolling_friction": True},
        feature="rolling",
    ),
    Effect(
        "elliptic",
        "numerical",
        "friction of one size in all directions, not a pyramid",
        by_options(off={"cone": "pyramidal"}, on={"cone": "elliptic"}),
        "contacts with friction",
        on={"elliptic": True},
        feature="friction",
    ),
    Effect(
        "noslip",
        "numerical",
        "a second solve against the creep of soft friction",
        by_options(off={"noslip_iterations": 0}, on={"noslip_iterations": 3}),
        "friction that may creep",
        proofs.no_noslip,
        on={"noslip": True},
        feature="friction",
    ),
    Effect(
        "impratio",
        "numerical",
        "friction harder than the normal force",
        by_options(
            is_on=lambda settings: settings.number("impratio") > 1,
            off={"impratio": 1.0},
            on={"impratio": 10.0},
        ),
        "friction that may creep",
        proofs.no_friction,
        on={"impratio": 10.0},
        off={"impratio": 1.0},
        feature="friction",
    ),
    _flag(
        "multiccd",
        "numerical",
        "several contacts between two convex shapes that meet in a face",
        "meshes, cylinders or other shapes of the general collision function",
        proofs.no_general_collision,
        feature="contact",
    ),
    _flag(
        "nativeccd",
        "numerical",
        "the engine's own general collision function",
        "meshes, cylinders or other shapes of the general collision function",
        proofs.no_general_collision,
        feature="contact",
    ),
    Effect(
        "speculative",
        "numerical",
        "contacts with what a body would pass in a step",
        by_flag("speculative"),
        "bodies that may move farther than their size in a step",
        proofs.no_contact,
        on={"speculative": True},
        feature="contact",
    ),
    _flag(
        "midphase",
        "numerical",
        "sorting the geoms of a body before they are compared",
        "bodies of several geoms",
        proofs.no_crowd,
        feature="contact",
    ),
    Effect(
        "filterparent",
        "physical",
        "no contact between a body and its parent",
        by_flag("filterparent"),
        "geoms that can touch",
        studied=False,
    ),
    Effect(
        "constraint",
        "physical",
        "all that is solved: contact, limits, equalities, friction loss",
        by_flag("constraint"),
        "anything to solve",
        studied=False,
    ),
    _flag(
        "island",
        "numerical",
        "groups of bodies that touch are solved apart",
        "several trees of bodies",
        proofs.one_tree,
    ),
    Effect(
        "sleep",
        "numerical",
        "bodies at rest are left alone",
        by_flag("sleep"),
        "bodies at rest",
        # What sleeps is an island; where islands are left out, sleep brings them back.
        on={"sleep": True, "island": True},
    ),
    _flag(
        "warmstart",
        "numerical",
        "the solver starts from the last step's solution",
        "anything to solve",
        proofs.no_constraint,
    ),
    _flag(
        "refsafe",
        "numerical",
        "time constants of at least two steps",
        "contacts too stiff for the timestep",
    ),
    Effect(
        "diagexact",
        "numerical",
        "the exact inertia behind each contact, not its estimate",
        by_flag("diagexact"),
        "chains of bodies",
        proofs.no_constraint,
        on={"diagexact": True},
    ),
    Effect(
        "gravity",
        "physical",
        "weight",
        by_flag("gravity"),
        "gravity above zero",
        proofs.no_gravity,
        off={"gravity": 0.0},
        feature="motion",
    ),
    Effect(
        "air",
        "physical",
        "forces of the medium and of wind",
        by_options(off={"density": 0.0, "viscosity": 0.0, "wind": (0.0, 0.0, 0.0)}, on={}),
        "a medium of some density or viscosity",
        proofs.no_air,
        feature="motion",
    ),
    _flag(
        "spring", "physical", "springs of joints and tendons", "springs", proofs.no_spring, "motion"
    ),
    _flag(
        "damper",
        "physical",
        "damping of joints and tendons",
        "damping",
        proofs.no_damping,
        "motion",
    ),
    _flag(
        "eulerdamp",
        "numerical",
        "joint damping taken at the step's end by the Euler integrator",
        "joint damping",
        zero("no joint is damped", "dof_damping", "dof_dampingpoly", "actuator_damping"),
        feature="motion",
    ),
    _flag(
        "frictionloss",
        "physical",
        "dry friction in joints and tendons",
        "friction loss above zero",
        zero("no joint or tendon has friction loss", "dof_frictionloss", "tendon_frictionloss"),
        feature="motion",
    ),
    _flag("limit", "physical", "ends of joints and tendons", "limits", proofs.no_limit, "limit"),
    _flag(
        "equality", "physical", "equality constraints", "equalities", proofs.no_equality, "equality"
    ),
    Effect(
        "tendon",
        "physical",
        "springs, damping, friction, inertia and limits of tendons",
        by_tendons(),
        "tendons",
        proofs.idle_tendons,
        feature="tendon",
    ),
    _flag("actuation", "physical", "actuators", "actuators", proofs.no_actuator, "actuation"),
    _flag(
        "clampctrl",
        "physical",
        "limits of controls",
        "limited controls",
        proofs.no_ctrl_limit,
        "clamping",
    ),
    Effect(
        "implicit",
        "numerical",
        "forces that depend on velocity taken at the step's end",
        by_options(
            is_on=lambda settings: settings["integrator"] not in ("Euler", "RK4"),
            off={"integrator": "Euler"},
            on={"integrator": "implicitfast"},
        ),
        "damping and actuators that are stiff for the timestep",
        on={"implicit": True},
    ),
    Effect(
        "invdiscrete",
        "numerical",
        "inverse dynamics of whole steps",
        by_flag("invdiscrete"),
        "inverse dynamics",
        studied=False,
    ),
    Effect(
        "sensor",
        "recording",
        "sensors beyond those that record the run",
        by_compiling(lambda run: run.facts.sensors > 0, "remove the elements of <sensor>"),
        "whoever reads them; no metric does",
        proofs.spare_sensors,
    ),
    Effect(
        "energy",
        "recording",
        "kinetic and potential energy",
        by_compiling(lambda run: run.facts.energy),
        "metrics of energy and speed",
    ),
    *(_flag(name, "numerical", "engine switch", "whoever sets it") for name in FLAGS),
)

for effect in _EFFECTS:
    supported = effect.switch.flag is None or effect.switch.flag in FLAGS
    if supported and effect.name not in EFFECTS:
        EFFECTS.add(effect)
