"""Table of every effect: its description, its switch, its need, and its proof of being unused.

It also decides the effects of a run, with reasons, from its structure and initial state.
"""

from collections.abc import Collection, Mapping
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.registry import Registry
from contactlab.scene.compile_model import SENSOR_PREFIX
from contactlab.scene.effects import proofs
from contactlab.scene.effects.effect import (
    NOT_IN_MODEL,
    Effect,
    EffectRequest,
    EffectState,
    Kind,
    compile_switch,
    condim_switch,
    flag_switch,
    option_switch,
)
from contactlab.scene.effects.proofs import (
    ModelFacts,
    RunState,
    has_nonzero_fields,
    proof_from_condition,
    proof_of_zero_fields,
)
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.model_edits import FLAG_NAMES
from contactlab.schema.setting_values import as_number

EFFECTS: Registry[Effect] = Registry("effect")
"""Every effect that this version of MuJoCo has, in the order of records and tables."""


def _flag_effect(name: str, kind: Kind, what: str) -> Effect:
    return Effect(name, kind, what, flag_switch(name))


_EFFECT_LIST = (
    _flag_effect("contact", "physical", "normal force between bodies that touch").needed_by(
        "geoms that can touch", proofs.no_contact, feature="contact"
    ),
    Effect(
        "tangential_friction", "physical", "force against sliding", condim_switch(3, 1)
    ).needed_by("contacts that may slide", proofs.straight_drop, feature="friction"),
    Effect(
        "torsional_friction",
        "physical",
        "torque against spin about the normal",
        condim_switch(4, 3),
    ).needed_by(
        "bodies that may spin in their contacts",
        proofs.no_turning,
        feature="spin",
    ),
    Effect("rolling_friction", "physical", "torque against rolling", condim_switch(6, 4)).needed_by(
        "bodies that may roll", proofs.no_turning, feature="rolling"
    ),
    Effect(
        "elliptic",
        "numerical",
        "friction of one size in all directions, not a pyramid",
        option_switch(off={"cone": "pyramidal"}, on={"cone": "elliptic"}),
    ).needed_by("contacts with friction", feature="friction"),
    Effect(
        "noslip",
        "numerical",
        "a second solve against the creep of soft friction",
        option_switch(off={"noslip_iterations": 0}, on={"noslip_iterations": 3}),
    ).needed_by("friction that may creep", proofs.no_noslip, feature="friction"),
    Effect(
        "impratio",
        "numerical",
        "friction harder than the normal force",
        option_switch(
            is_on=lambda settings: as_number(settings["impratio"]) > 1,
            off={"impratio": 1.0},
            on={"impratio": 10.0},
        ),
    ).needed_by(
        "friction that may creep",
        proofs.no_friction,
        feature="friction",
    ),
    _flag_effect(
        "multiccd", "numerical", "several contacts between two convex shapes that meet in a face"
    ).needed_by(
        "meshes, cylinders or other shapes of the general collision function",
        proofs.no_general_collision,
        feature="contact",
    ),
    _flag_effect("nativeccd", "numerical", "the engine's own general collision function").needed_by(
        "meshes, cylinders or other shapes of the general collision function",
        proofs.no_general_collision,
        feature="contact",
    ),
    _flag_effect(
        "speculative", "numerical", "contacts with what a body would pass in a step"
    ).needed_by(
        "bodies that may move farther than their size in a step",
        proofs.no_contact,
        feature="contact",
    ),
    _flag_effect(
        "midphase", "numerical", "sorting the geoms of a body before they are compared"
    ).needed_by("bodies of several geoms", proofs.no_crowd, feature="contact"),
    _flag_effect("filterparent", "physical", "no contact between a body and its parent").needed_by(
        "geoms that can touch"
    ),
    _flag_effect(
        "constraint", "physical", "all that is solved: contact, limits, equalities, friction loss"
    ).needed_by("anything to solve"),
    _flag_effect("island", "numerical", "groups of bodies that touch are solved apart").needed_by(
        "several trees of bodies", proofs.one_tree
    ),
    # Sleeping bodies form an island, so sleep turns islands on again.
    _flag_effect("sleep", "numerical", "bodies at rest are left alone").needed_by("bodies at rest"),
    _flag_effect(
        "warmstart", "numerical", "the solver starts from the last step's solution"
    ).needed_by("anything to solve", proofs.no_constraint),
    _flag_effect("refsafe", "numerical", "time constants of at least two steps").needed_by(
        "contacts too stiff for the timestep"
    ),
    _flag_effect(
        "diagexact", "numerical", "the exact inertia behind each contact, not its estimate"
    ).needed_by("chains of bodies", proofs.no_constraint),
    _flag_effect("gravity", "physical", "weight").needed_by(
        "gravity above zero",
        proof_from_condition("gravity is zero", lambda run: not run.model.opt.gravity.any()),
        feature="motion",
    ),
    Effect(
        "air",
        "physical",
        "forces of the medium and of wind",
        option_switch(off={"density": 0.0, "viscosity": 0.0, "wind": (0.0, 0.0, 0.0)}, on={}),
    ).needed_by("a medium of some density or viscosity", proofs.no_air, feature="motion"),
    _flag_effect("spring", "physical", "springs of joints and tendons").needed_by(
        "springs", proofs.no_spring, feature="motion"
    ),
    _flag_effect("damper", "physical", "damping of joints and tendons").needed_by(
        "damping", proofs.no_damping, feature="motion"
    ),
    _flag_effect(
        "eulerdamp", "numerical", "joint damping taken at the step's end by the Euler integrator"
    ).needed_by("joint damping", proofs.no_joint_damping, feature="motion"),
    _flag_effect("frictionloss", "physical", "dry friction in joints and tendons").needed_by(
        "friction loss above zero",
        proof_of_zero_fields("no joint or tendon has friction loss", *proofs.FRICTION_LOSS),
        feature="motion",
    ),
    _flag_effect("limit", "physical", "ends of joints and tendons").needed_by(
        "limits", proofs.no_limit, feature="limit"
    ),
    _flag_effect("equality", "physical", "equality constraints").needed_by(
        "equalities", proofs.no_equality, feature="equality"
    ),
    Effect(
        "tendon",
        "physical",
        "springs, damping, friction, inertia and limits of tendons",
        # Tendons that only transmit, for actuators or equalities, have no effect of their own.
        compile_switch(
            lambda run: (
                run.facts.tendons > 0
                and (
                    run.facts.idle_tendons or has_nonzero_fields(run.model, *proofs.TENDON_EFFECTS)
                )
            ),
            *proofs.TENDON_EFFECTS,
        ),
    ).needed_by(
        "tendons",
        proof_from_condition(
            "no tendon exerts a force",
            lambda run: (
                run.facts.idle_tendons and not has_nonzero_fields(run.model, *proofs.TENDON_EFFECTS)
            ),
        ),
        feature="tendon",
    ),
    _flag_effect("actuation", "physical", "actuators").needed_by(
        "actuators", proof_of_zero_fields("no actuator", "nu"), feature="actuation"
    ),
    _flag_effect("clampctrl", "physical", "limits of controls").needed_by(
        "limited controls",
        proof_of_zero_fields("no control is limited", "actuator_ctrllimited"),
        feature="clamping",
    ),
    Effect(
        "implicit",
        "numerical",
        "forces that depend on velocity taken at the step's end",
        option_switch(
            is_on=lambda settings: settings["integrator"] not in ("Euler", "RK4"),
            off={"integrator": "Euler"},
            on={"integrator": "implicitfast"},
        ),
    ).needed_by("damping and actuators that are stiff for the timestep"),
    _flag_effect("invdiscrete", "numerical", "inverse dynamics of whole steps").needed_by(
        "inverse dynamics"
    ),
    Effect(
        "sensor",
        "recording",
        "sensors beyond those that record the run",
        compile_switch(lambda run: run.facts.sensors > 0),
    ).needed_by(
        "whoever reads them; no metric does",
        proof_from_condition("no metric reads the model's own sensors", lambda _: True),
    ),
    Effect(
        "energy",
        "recording",
        "kinetic and potential energy",
        compile_switch(lambda run: run.facts.energy),
    ).needed_by("metrics of energy and speed"),
    *(
        _flag_effect(name, "numerical", "engine switch").needed_by("whoever sets it")
        for name in FLAG_NAMES
    ),
)

for effect in _EFFECT_LIST:
    supported = effect.switch.flag is None or effect.switch.flag in FLAG_NAMES
    if supported and effect.name not in EFFECTS:
        EFFECTS.add(effect)


def is_straight(model: mujoco.MjModel, start: InitialStates) -> bool:
    """Return whether everything at a start (n is 1) moves, and is pushed, at most along z."""
    speed, push = start.qvel[0], start.applied[0]
    if speed.any():
        speed = speed[_is_not_vertical(model)]
    if push.any():
        push = np.delete(push.reshape(-1, 6), 2, axis=1)
    return not (speed.any() or push.any() or start.driven_inputs.size)


@lru_cache(maxsize=1)
def _is_not_vertical(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return a mask (nv,) of degrees of freedom other than those along z of free joints."""
    free = np.asarray(model.jnt_dofadr)[model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)]
    return ~np.isin(np.arange(model.nv), free + 2)


_COMPILED_EFFECTS = ("sensor", "tendon", "energy")


def choose_effects(run: RunState, request: EffectRequest) -> dict[str, EffectState]:
    """Decide every effect of a run; its settings and request are already written in its model."""
    return {name: _choose_effect(effect, run, request) for name, effect in EFFECTS.items()}


def turn_off_unused(run: RunState, chosen: Mapping[str, EffectState]) -> None:
    """Turn off the effects that are not chosen in a run's model, in place."""
    # Read all effects before writing any, because friction effects share condim.
    off = [
        effect
        for name, effect in EFFECTS.items()
        if not chosen[name].on and effect.switch.is_on(run)
    ]
    for effect in off:
        effect.switch.write(run.model, False)


def _choose_effect(effect: Effect, run: RunState, request: EffectRequest) -> EffectState:
    on = effect.switch.is_on(run)
    if effect.name in request.requested:
        # A tendon that is left out may still be in the model, idle.
        requested = request.requested[effect.name] or effect.name not in _COMPILED_EFFECTS
        return EffectState(on and requested, "as asked")
    if not on:
        return EffectState(on=False, reason=NOT_IN_MODEL)
    if not request.auto:
        return EffectState(on=True, reason="all that the model has is on")
    if set_here := sorted(request.changed_settings.intersection(effect.switch.settings)):
        return EffectState(on=True, reason=f"the sweep sets {', '.join(set_here)}")
    proof = effect.unused(run)
    return EffectState(proof is None, proof or effect.called_by)


def left_uncompiled(facts: ModelFacts, request: EffectRequest) -> frozenset[str]:
    """Return the effects without which a run's model is compiled, from facts of the whole model."""
    requested, default = request.requested, not request.auto
    out: set[str] = set()
    if facts.sensors and not requested.get("sensor", default):
        out.add("sensor")
    reads_sensors = facts.sensors and "sensor" not in out
    sets_tendon = any(name.startswith("tendon_") for name in request.changed_settings)
    spare = facts.tendons and facts.idle_tendons and not reads_sensors and not sets_tendon
    if spare and not requested.get("tendon", default):
        out.add("tendon")
    if not requested.get("energy", True):
        out.add("energy")
    return frozenset(out)


def remove_from_spec(spec: mujoco.MjSpec, without: Collection[str]) -> None:
    """Delete sensors and tendons from a specification, before recording sensors are added."""
    for sensor in list(spec.sensors) if "sensor" in without else ():
        if (
            not sensor.name.startswith(SENSOR_PREFIX)
            and sensor.type != mujoco.mjtSensor.mjSENS_PLUGIN
        ):
            spec.delete(sensor)
    for tendon in list(spec.tendons) if "tendon" in without else ():
        spec.delete(tendon)
