"""Effects of what else moves bodies, of how it is solved and of what is recorded."""

from contactlab.scene.effects import turning, unused
from contactlab.scene.effects.effect import Effect
from contactlab.scene.effects.entry import switch
from contactlab.scene.effects.unused import never, zero

SOLVING = [
    switch(
        "constraint",
        "physical",
        "all that is solved: contact, limits, equalities, friction loss",
        "anything to solve",
        unused.never,
    ),
    switch(
        "island",
        "numerical",
        "groups of bodies that touch are solved apart",
        "several trees of bodies",
        unused.one_tree,
        changes=False,
    ),
    switch("sleep", "numerical", "bodies at rest are left alone", "bodies at rest", unused.never),
    switch(
        "warmstart",
        "numerical",
        "the solver starts from the last step's solution",
        "anything to solve",
        unused.no_constraint,
        changes=False,
    ),
    switch(
        "refsafe",
        "numerical",
        "time constants of at least two steps",
        "contacts too stiff for the timestep",
        unused.never,
    ),
    switch(
        "diagexact",
        "numerical",
        "the exact inertia behind each contact, not its estimate",
        "chains of bodies",
        unused.no_constraint,
    ),
]

MOTION = [
    switch("gravity", "physical", "weight", "gravity above zero", unused.no_gravity),
    Effect(
        "air",
        "physical",
        "forces of the medium and of wind",
        "density, viscosity and wind 0",
        "a medium of some density or viscosity",
        True,
        turning.option_is_set("density", "viscosity", "wind"),
        turning.turn_options_off("density", "viscosity", "wind"),
        unused.no_air,
        ("density", "viscosity", "wind"),
    ),
    switch("spring", "physical", "springs of joints and tendons", "springs", unused.no_spring),
    switch("damper", "physical", "damping of joints and tendons", "damping", unused.no_damping),
    switch(
        "eulerdamp",
        "numerical",
        "joint damping taken at the step's end by the Euler integrator",
        "joint damping",
        zero("no joint is damped", "dof_damping", "dof_dampingpoly", "actuator_damping"),
    ),
    switch(
        "frictionloss",
        "physical",
        "dry friction in joints and tendons",
        "friction loss above zero",
        zero("no joint or tendon has friction loss", "dof_frictionloss", "tendon_frictionloss"),
    ),
    switch("limit", "physical", "ends of joints and tendons", "limits", unused.no_limit),
    switch("equality", "physical", "equality constraints", "equalities", unused.no_equality),
    Effect(
        "tendon",
        "physical",
        "springs, damping, friction, inertia and limits of tendons",
        "idle ones are not compiled, others have nothing that acts",
        "tendons",
        True,
        lambda run: run.facts.tendons > 0,
        turning.turn_tendons,
        unused.idle_tendons,
    ),
    switch("actuation", "physical", "actuators", "actuators", unused.no_actuator),
    switch("clampctrl", "physical", "limits of controls", "limited controls", unused.no_ctrl_limit),
    Effect(
        "implicit",
        "numerical",
        "forces that depend on velocity taken at the step's end",
        "integrator Euler",
        "damping and actuators that are stiff for the timestep",
        True,
        turning.is_implicit,
        None,
        never,
        ("integrator",),
    ),
    switch(
        "invdiscrete",
        "numerical",
        "inverse dynamics of whole steps",
        "inverse dynamics",
        unused.never,
    ),
]

RECORDING = [
    Effect(
        "sensor",
        "recording",
        "sensors beyond those that record the run",
        "they are not compiled",
        "whoever reads them; no metric does",
        False,
        lambda run: run.facts.sensors > 0,
        None,
        unused.spare_sensors,
    ),
    Effect(
        "energy",
        "recording",
        "kinetic and potential energy",
        "their sensors are not compiled",
        "metrics of energy and speed",
        False,
        lambda run: run.facts.energy,
        None,
        never,
    ),
]
