"""Proofs that nothing changes in a run without an effect: the reason, or None without a proof.

The proofs rest on MuJoCo's code path: what is absent is not computed, and a force of exactly zero
leaves the state as it is, to rounding.
"""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

_GEOM = mujoco.mjtGeom
_ROUND = {int(_GEOM.mjGEOM_SPHERE), int(_GEOM.mjGEOM_CAPSULE)}
_BOX, _CYLINDER = int(_GEOM.mjGEOM_BOX), int(_GEOM.mjGEOM_CYLINDER)
# Flags that not every version of MuJoCo has.
_SPECULATIVE = int(getattr(mujoco.mjtEnableBit, "mjENBL_SPECULATIVE", 0))
_SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))
_TENDON_FORCES = "stiffness", "stiffnesspoly", "damping", "dampingpoly", "frictionloss"
_TENDON_EFFECTS = *_TENDON_FORCES, "armature", "limited"
# Pairs with a collision function of their own; others go through the general one.
_DIRECT = (
    {(first, second) for first in _ROUND for second in _ROUND if first <= second}
    | {(int(_GEOM.mjGEOM_PLANE), shape) for shape in (*_ROUND, _BOX, _CYLINDER)}
    | {(shape, _BOX) for shape in (*_ROUND, _BOX)}
    | {(int(_GEOM.mjGEOM_SPHERE), _CYLINDER)}
)


@dataclass(frozen=True)
class ModelFacts:
    """What a compiled structure decides about its effects, whatever a run sets.

    Attributes:
        kinds: pairs of geom types, the smaller first, among geoms that MuJoCo's filters let touch;
            None where that is not known.
        level: whether only spheres, free and alone with their mass at their centres, and fixed
            horizontal planes can touch.
        turning: whether a body that can touch another can turn.
        crowded: whether a body has more than one geom.
        sensors: how many sensors the model has that do not record the run.
        tendons: how many tendons it has; 0 if they were not compiled.
        idle_tendons: whether its tendons can do nothing but be measured.
        energy: whether energies are recorded.
    """

    kinds: frozenset[tuple[int, int]] | None
    level: bool
    turning: bool
    crowded: bool
    sensors: int
    tendons: int
    idle_tendons: bool
    energy: bool


@dataclass(frozen=True)
class RunState:
    """A run as the proofs see it, before it starts.

    Attributes:
        model: the run's model, its settings written.
        facts: what its structure decides.
        straight: whether nothing turns or moves sideways at the start, or is pushed to.
    """

    model: mujoco.MjModel
    facts: ModelFacts
    straight: bool


Proof = Callable[[RunState], str | None]
"""Returns why nothing changes in a run without an effect; None where that is not proven."""


def never(_: RunState) -> str | None:
    """Prove nothing."""
    return None


def no_contact(run: RunState) -> str | None:
    """No two geoms can touch."""
    return "no two geoms can touch" if run.facts.kinds == frozenset() else None


def zero(reason: str, *fields: str) -> Proof:
    """Return a proof that all coefficients in some fields of the model are zero."""

    def prove(run: RunState) -> str | None:
        acting = any(np.any(getattr(run.model, field, 0)) for field in fields)
        return None if acting else reason

    return prove


def no_damping(run: RunState) -> str | None:
    """No joint, tendon or flex is damped, and no other passive force needs the computation."""
    reason = zero(
        "no joint or tendon is damped",
        "dof_damping",
        "dof_dampingpoly",
        "actuator_damping",
        "tendon_damping",
        "flex_damping",
        "flex_edgedamping",
    )(run)
    return None if _has_other_forces(run.model) else reason


def no_spring(run: RunState) -> str | None:
    """No joint, tendon or flex is a spring, and no other passive force needs the computation."""
    reason = zero(
        "no joint or tendon is a spring",
        "jnt_stiffness",
        "jnt_stiffnesspoly",
        "tendon_stiffness",
        "tendon_stiffnesspoly",
        "flex_stiffness",
        "flex_edgestiffness",
    )(run)
    return None if run.model.nflex or _has_other_forces(run.model) else reason


def _has_other_forces(model: mujoco.MjModel) -> bool:
    """Return whether passive forces act that MuJoCo skips where springs and damping are off."""
    air = model.opt.density or model.opt.viscosity
    return bool(air or model.nplugin or model.nflex or np.any(model.body_gravcomp))


no_limit = zero("no joint or tendon has a limit", "jnt_limited", "tendon_limited")


def no_gravity(run: RunState) -> str | None:
    """Gravity is zero."""
    return None if run.model.opt.gravity.any() else "gravity is zero"


def no_air(run: RunState) -> str | None:
    """Without density and viscosity a medium exerts no force, whatever the wind."""
    option = run.model.opt
    return None if option.density or option.viscosity else "the medium has no density or viscosity"


def no_friction(run: RunState) -> str | None:
    """No contact has friction, and no joint or tendon has friction loss."""
    if reason := no_contact(run):
        return reason
    return None if most_condim(run.model) > 1 else "no contact has friction"


def no_noslip(run: RunState) -> str | None:
    """No contact or joint has friction that could slip."""
    lossless = zero("", "dof_frictionloss", "tendon_frictionloss")(run) is not None
    return no_friction(run) if lossless else None


def most_condim(model: mujoco.MjModel) -> int:
    """Return the most dimensions that any contact of a model could have; 0 without geoms."""
    solid = np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)
    flex = np.asarray(model.flex_condim if model.nflex else [], dtype=np.int32)
    dims = np.concatenate([model.geom_condim[solid != 0], model.pair_dim, flex])
    return int(dims.max(initial=0))


def straight_drop(run: RunState) -> str | None:
    """A sphere that falls straight onto a horizontal plane never slides in its contact.

    The contact lies under its centre, so that no force turns it. Elliptic cones treat the normal
    separately; of pyramids, only those with a coefficient of 1 in three dimensions add up to the
    same normal force.
    """
    if reason := no_contact(run):
        return reason
    gravity = np.asarray(run.model.opt.gravity)
    if not run.straight or not run.facts.level or gravity[:2].any() or no_air(run) is None:
        return None
    if run.model.opt.wind.any() or not (_is_elliptic(run.model) or _is_unit_pyramid(run.model)):
        return None
    return "what falls does so straight, and its contacts never move sideways"


def no_turning(run: RunState) -> str | None:
    """Bodies that touch cannot turn, and an elliptic cone treats every direction separately."""
    if reason := no_contact(run):
        return reason
    if not run.facts.turning and _is_elliptic(run.model):
        return "no body that can touch another can turn"
    return straight_drop(run)


def _is_elliptic(model: mujoco.MjModel) -> bool:
    return bool(model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC)


def _is_unit_pyramid(model: mujoco.MjModel) -> bool:
    slides = np.concatenate([model.geom_friction[:, 0], model.pair_friction[:, :2].ravel()])
    return most_condim(model) <= 3 and bool((slides == 1).all())


def no_general_collision(run: RunState) -> str | None:
    """Every pair of shapes has its own collision function; speculative contacts do not."""
    if reason := no_contact(run):
        return reason
    if run.model.opt.enableflags & _SPECULATIVE:
        return None
    if run.facts.kinds is None or not run.facts.kinds <= _DIRECT:
        return None
    return "all shapes that can touch have a collision function of their own"


def no_crowd(run: RunState) -> str | None:
    """No body has several geoms to sort."""
    return no_contact(run) or (None if run.facts.crowded else "no body has more than one geom")


def one_tree(run: RunState) -> str | None:
    """One kinematic tree is one island; sleeping needs islands."""
    if run.model.ntree > 1 or run.model.nflex or run.model.opt.enableflags & _SLEEP:
        return None
    return "a single tree of bodies is one island"


def no_constraint(run: RunState) -> str | None:
    """No contact, limit, equality or friction loss: nothing is solved."""
    model = run.model
    solved = model.neq or model.nflex or np.any(model.dof_frictionloss)
    if solved or np.any(model.tendon_frictionloss) or no_contact(run) is None:
        return None
    return None if no_limit(run) is None else "there is nothing to solve"


def no_equality(run: RunState) -> str | None:
    """No equality constraint is there, or all are inactive."""
    if not run.model.neq:
        return "no equality constraint"
    return None if np.any(run.model.eq_active0) else "no equality constraint is active"


def no_actuator(run: RunState) -> str | None:
    """The model has no actuator."""
    return None if run.model.nu else "no actuator"


def no_ctrl_limit(run: RunState) -> str | None:
    """No control is limited."""
    return None if np.any(run.model.actuator_ctrllimited) else "no control is limited"


def idle_tendons(run: RunState) -> str | None:
    """No tendon does anything."""
    idle = run.facts.idle_tendons and not tendons_act(run.model)
    return "no tendon exerts a force" if idle else None


def tendons_act(model: mujoco.MjModel) -> bool:
    """Return whether a tendon has a spring, damping, friction, a limit or inertia."""
    return any(np.any(getattr(model, f"tendon_{each}", 0)) for each in _TENDON_EFFECTS)


def spare_sensors(_: RunState) -> str | None:
    """Sensors measure, and change nothing; no metric reads those of the model."""
    return "no metric reads the model's own sensors"
