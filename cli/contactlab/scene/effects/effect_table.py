"""Every effect: what it is, how it is turned on and off, what calls for it, when it is unused."""

from contactlab.registry import Registry
from contactlab.scene.effects import proofs
from contactlab.scene.effects.effect import Effect
from contactlab.scene.effects.effect_switches import (
    by_compiling,
    by_condim,
    by_flag,
    by_options,
    by_tendons,
)
from contactlab.scene.effects.proofs import zero
from contactlab.scene.model_options import FLAGS

EFFECTS: Registry[Effect] = Registry("effect")
"""Every effect that this version of MuJoCo has, in the order of records and tables."""


_EFFECTS = (
    Effect(
        "contact",
        "physical",
        "normal force between bodies that touch",
        by_flag("contact"),
        "geoms that can touch",
        proofs.no_contact,
    ),
    Effect(
        "tangential_friction",
        "physical",
        "force against sliding",
        by_condim(3, 1),
        "contacts that may slide",
        proofs.straight_drop,
    ),
    Effect(
        "torsional_friction",
        "physical",
        "torque against spin about the normal",
        by_condim(4, 3),
        "bodies that may spin in their contacts",
        proofs.no_turning,
        on={"torsional_friction": True},
    ),
    Effect(
        "rolling_friction",
        "physical",
        "torque against rolling",
        by_condim(6, 4),
        "bodies that may roll",
        proofs.no_turning,
        on={"rolling_friction": True},
    ),
    Effect(
        "elliptic",
        "numerical",
        "friction of one size in all directions, not a pyramid",
        by_options(
            has=lambda settings: settings["cone"] == "elliptic",
            off={"cone": "pyramidal"},
            on={"cone": "elliptic"},
        ),
        "contacts with friction",
        on={"elliptic": True},
    ),
    Effect(
        "noslip",
        "numerical",
        "a second solve against the creep of soft friction",
        by_options(
            has=lambda settings: settings["noslip_iterations"] != 0,
            off={"noslip_iterations": 0},
            on={"noslip_iterations": 3},
        ),
        "friction that may creep",
        proofs.no_noslip,
        on={"noslip": True},
    ),
    Effect(
        "impratio",
        "numerical",
        "friction harder than the normal force",
        by_options(
            has=lambda settings: settings.number("impratio") > 1,
            off={"impratio": 1.0},
            on={"impratio": 10.0},
        ),
        "friction that may creep",
        proofs.no_friction,
        on={"impratio": 10.0},
        off={"impratio": 1.0},
    ),
    Effect(
        "multiccd",
        "numerical",
        "several contacts between two convex shapes that meet in a face",
        by_flag("multiccd"),
        "meshes, cylinders or other shapes of the general collision function",
        proofs.no_general_collision,
    ),
    Effect(
        "nativeccd",
        "numerical",
        "the engine's own general collision function",
        by_flag("nativeccd"),
        "meshes, cylinders or other shapes of the general collision function",
        proofs.no_general_collision,
    ),
    Effect(
        "speculative",
        "numerical",
        "contacts with what a body would pass in a step",
        by_flag("speculative"),
        "bodies that may move farther than their size in a step",
        proofs.no_contact,
        on={"speculative": True},
    ),
    Effect(
        "midphase",
        "numerical",
        "sorting the geoms of a body before they are compared",
        by_flag("midphase"),
        "bodies of several geoms",
        proofs.no_crowd,
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
    Effect(
        "island",
        "numerical",
        "groups of bodies that touch are solved apart",
        by_flag("island"),
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
    Effect(
        "warmstart",
        "numerical",
        "the solver starts from the last step's solution",
        by_flag("warmstart"),
        "anything to solve",
        proofs.no_constraint,
    ),
    Effect(
        "refsafe",
        "numerical",
        "time constants of at least two steps",
        by_flag("refsafe"),
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
    ),
    Effect(
        "air",
        "physical",
        "forces of the medium and of wind",
        by_options(
            has=lambda settings: any(
                (settings["density"], settings["viscosity"], *settings.vector("wind"))
            ),
            off={"density": 0.0, "viscosity": 0.0, "wind": (0.0, 0.0, 0.0)},
            on={},
        ),
        "a medium of some density or viscosity",
        proofs.no_air,
    ),
    Effect(
        "spring",
        "physical",
        "springs of joints and tendons",
        by_flag("spring"),
        "springs",
        proofs.no_spring,
    ),
    Effect(
        "damper",
        "physical",
        "damping of joints and tendons",
        by_flag("damper"),
        "damping",
        proofs.no_damping,
    ),
    Effect(
        "eulerdamp",
        "numerical",
        "joint damping taken at the step's end by the Euler integrator",
        by_flag("eulerdamp"),
        "joint damping",
        zero("no joint is damped", "dof_damping", "dof_dampingpoly", "actuator_damping"),
    ),
    Effect(
        "frictionloss",
        "physical",
        "dry friction in joints and tendons",
        by_flag("frictionloss"),
        "friction loss above zero",
        zero("no joint or tendon has friction loss", "dof_frictionloss", "tendon_frictionloss"),
    ),
    Effect(
        "limit",
        "physical",
        "ends of joints and tendons",
        by_flag("limit"),
        "limits",
        proofs.no_limit,
    ),
    Effect(
        "equality",
        "physical",
        "equality constraints",
        by_flag("equality"),
        "equalities",
        proofs.no_equality,
    ),
    Effect(
        "tendon",
        "physical",
        "springs, damping, friction, inertia and limits of tendons",
        by_tendons(),
        "tendons",
        proofs.idle_tendons,
    ),
    Effect(
        "actuation",
        "physical",
        "actuators",
        by_flag("actuation"),
        "actuators",
        proofs.no_actuator,
    ),
    Effect(
        "clampctrl",
        "physical",
        "limits of controls",
        by_flag("clampctrl"),
        "limited controls",
        proofs.no_ctrl_limit,
    ),
    Effect(
        "implicit",
        "numerical",
        "forces that depend on velocity taken at the step's end",
        by_options(
            has=lambda settings: settings["integrator"] not in ("Euler", "RK4"),
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
    *(
        Effect(name, "numerical", "engine switch", by_flag(name), "whoever sets it")
        for name in FLAGS
    ),
)

for effect in _EFFECTS:
    supported = effect.switch.flag is None or effect.switch.flag in FLAGS
    if supported and effect.name not in EFFECTS:
        EFFECTS.add(effect)
