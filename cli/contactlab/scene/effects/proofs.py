"""Proofs that nothing changes in a run without an effect: the reason, or None without a proof.

The proofs rest on MuJoCo's code path: absent features are not computed, and a force of exactly zero
leaves the state unchanged, up to rounding.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from contactlab.scene.compile_model import SENSOR_PREFIX
from contactlab.scene.contact_pairs import mask_overlap
from contactlab.scene.model_edits import read_flag

_GEOM_TYPES = mujoco.mjtGeom
_JOINT_TYPES = mujoco.mjtJoint
_ROUND_SHAPES = {int(_GEOM_TYPES.mjGEOM_SPHERE), int(_GEOM_TYPES.mjGEOM_CAPSULE)}
_BOX_GEOM, _CYLINDER_GEOM = int(_GEOM_TYPES.mjGEOM_BOX), int(_GEOM_TYPES.mjGEOM_CYLINDER)
# Fields of the model; some versions lack some of them.
DAMPING = "dof_damping", "dof_dampingpoly", "actuator_damping", "actuator_dampingpoly"
FRICTION_LOSS = "dof_frictionloss", "tendon_frictionloss"
_TENDON_DAMPING_FIELDS, _TENDON_SPRING_FIELDS = (
    (f"tendon_{name}", f"tendon_{name}poly") for name in ("damping", "stiffness")
)
_SPRING_FIELDS = "jnt_stiffness", "jnt_stiffnesspoly", *_TENDON_SPRING_FIELDS
TENDON_EFFECTS = (
    *(*_TENDON_SPRING_FIELDS, *_TENDON_DAMPING_FIELDS),
    *("tendon_frictionloss", "tendon_armature", "tendon_limited"),
)
# Pairs with a special collision function; others use the general one.
_SPECIAL_PAIRS = (
    {(first, second) for first in _ROUND_SHAPES for second in _ROUND_SHAPES if first <= second}
    | {
        (int(_GEOM_TYPES.mjGEOM_PLANE), shape)
        for shape in (*_ROUND_SHAPES, _BOX_GEOM, _CYLINDER_GEOM)
    }
    | {(shape, _BOX_GEOM) for shape in (*_ROUND_SHAPES, _BOX_GEOM)}
    | {(int(_GEOM_TYPES.mjGEOM_SPHERE), _CYLINDER_GEOM)}
)


class ModelFacts:
    """Facts about effects that a compiled structure, including recording sensors, decides."""

    def __init__(self, model: mujoco.MjModel, *, energy: bool) -> None:
        self._model = model
        self.energy = energy
        # Sensors that do not record the run, except those of MuJoCo plugins.
        self.sensors = sum(
            not model.sensor(index).name.startswith(SENSOR_PREFIX)
            and model.sensor_type[index] != mujoco.mjtSensor.mjSENS_PLUGIN
            for index in range(model.nsensor)
        )
        self.tendons = int(model.ntendon)

    @cached_property
    def _touchable_pairs(self) -> np.ndarray | None:
        """(n, 2) pairs of geoms that could touch, or None if that is unknown.

        A superset of the pairs that MuJoCo lets touch: parents and children, and exclusions, are
        not filtered.
        """
        model = self._model
        max_geoms = 2000  # the table of the pairs of more geoms would be too large
        many = model.ngeom > max_geoms
        if many or model.nflex or model.nplugin or read_flag(model, "override"):
            return None
        weld = np.asarray(model.body_weldid)[model.geom_bodyid]
        filtered = np.argwhere(np.triu(mask_overlap(model) & (weld[:, None] != weld), 1))
        listed_pairs = np.stack([model.pair_geom1, model.pair_geom2], axis=1)
        return np.concatenate([filtered, listed_pairs]).astype(np.intp)

    @cached_property
    def kinds(self) -> frozenset[tuple[int, int]] | None:
        """Pairs of geom types that can touch, the smaller first; None if unknown."""
        if self._touchable_pairs is None:
            return None
        types = np.sort(np.asarray(self._model.geom_type)[self._touchable_pairs], axis=1)
        flat = {int(_GEOM_TYPES.mjGEOM_PLANE), int(_GEOM_TYPES.mjGEOM_HFIELD)}
        pairs = {(int(first), int(second)) for first, second in types}
        return frozenset(pair for pair in pairs if not set(pair) <= flat)

    @cached_property
    def level(self) -> bool:
        """Whether only centered free spheres and horizontal planes can touch."""
        model, touching = self._model, self._touchable_pairs
        if model.nu or model.neq or model.ntendon or model.nplugin or model.nmocap:
            return False
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        if touching is None or not len(touching):
            return False
        return all(_is_level_pair(model, data, *pair) for pair in touching)

    @cached_property
    def turning(self) -> bool:
        """Whether a body that can touch another can turn."""
        if self._touchable_pairs is None or self._model.nmocap:
            return True
        bodies = np.unique(np.asarray(self._model.geom_bodyid)[self._touchable_pairs.ravel()])
        return any(_can_rotate(self._model, int(body)) for body in bodies)

    @property
    def has_crowded_body(self) -> bool:
        """Whether a body has more than one geom."""
        return bool(self._model.nflex or (np.asarray(self._model.body_geomnum) > 1).any())

    @cached_property
    def idle_tendons(self) -> bool:
        """Whether its tendons only serve sensors that can be left out."""
        model = self._model
        driven = (np.asarray(model.actuator_trntype) == mujoco.mjtTrn.mjTRN_TENDON).any()
        tied = (np.asarray(model.eq_type) == mujoco.mjtEq.mjEQ_TENDON).any()
        return not model.ntendon or not (
            has_nonzero_fields(model, *TENDON_EFFECTS) or driven or tied or model.nplugin
        )


def _is_level_pair(model: mujoco.MjModel, data: mujoco.MjData, first: int, second: int) -> bool:
    plane, sphere = sorted((first, second), key=lambda geom: int(model.geom_type[geom]))
    types = (int(model.geom_type[plane]), int(model.geom_type[sphere]))
    if types != (_GEOM_TYPES.mjGEOM_PLANE, _GEOM_TYPES.mjGEOM_SPHERE):
        return False
    body = int(model.geom_bodyid[sphere])
    normal = np.asarray(data.geom_xmat[plane]).reshape(3, 3)[:, 2]
    fixed = int(model.body_weldid[model.geom_bodyid[plane]]) == 0
    # The sphere's body is free, alone, and has its center of mass at the sphere's center.
    free = model.body_jntnum[body] == 1 and (
        model.jnt_type[model.body_jntadr[body]] == _JOINT_TYPES.mjJNT_FREE
    )
    alone = model.body_parentid[body] == 0 and not (np.asarray(model.body_parentid) == body).any()
    centred = np.array_equal(model.geom_pos[sphere], model.body_ipos[body])
    return bool(fixed and not normal[:2].any() and free and alone and centred)


def _can_rotate(model: mujoco.MjModel, body: int) -> bool:
    while body:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        if any(model.jnt_type[first : first + count] != _JOINT_TYPES.mjJNT_SLIDE):
            return True
        body = int(model.body_parentid[body])
    return False


@dataclass(frozen=True)
class RunState:
    """State of a run before it starts, as the proofs use it."""

    # The user's model with its settings written, never a model changed by a drive.
    model: mujoco.MjModel
    facts: ModelFacts  # facts of its structure
    straight: bool  # whether nothing turns, moves sideways, or is pushed to do so at the start
    loaded: bool = False  # whether springs from outside of the model hold its joints


Proof = Callable[[RunState], str | None]
"""Returns why nothing changes in a run without an effect; None without a proof."""


def proof_from_condition(reason: str, holds: Callable[[RunState], object]) -> Proof:
    """Return a proof from a condition on a run."""
    return lambda run: reason if holds(run) else None


def proof_of_zero_fields(reason: str, *fields: str) -> Proof:
    """Return a proof that all coefficients in some fields of the model are zero."""
    return proof_from_condition(reason, lambda run: not has_nonzero_fields(run.model, *fields))


def first_proof(*proofs: Proof) -> Proof:
    """Return the proof by the first of some proofs that holds."""
    return lambda run: next(filter(None, (proof(run) for proof in proofs)), None)


def has_nonzero_fields(model: mujoco.MjModel, *fields: str) -> bool:
    """Return whether any coefficient in existing fields of a model is not zero."""
    return any(np.any(getattr(model, field, 0)) for field in fields)


def most_condim(model: mujoco.MjModel) -> int:
    """Return the largest possible contact dimension in a model; 0 without geoms."""
    solid = np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)
    flex = np.asarray(model.flex_condim if model.nflex else [], dtype=np.int32)
    return int(np.concatenate([model.geom_condim[solid != 0], model.pair_dim, flex]).max(initial=0))


def _has_other_forces(model: mujoco.MjModel) -> bool:
    """Return whether passive forces act besides those of joints and tendons."""
    air = model.opt.density or model.opt.viscosity
    return bool(air or model.nplugin or model.nflex or np.any(model.body_gravcomp))


def _is_elliptic(model: mujoco.MjModel) -> bool:
    return bool(model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC)


def _falls_straight(run: RunState) -> bool:
    """Return whether only spheres fall, straight and onto horizontal planes, and never slide.

    The contact lies under the sphere's center, so no force turns it. Elliptic cones treat the
    normal separately. Among pyramids, only those with a coefficient of 1 in three dimensions add up
    to the same normal force.
    """
    model, gravity = run.model, np.asarray(run.model.opt.gravity)
    if not run.straight or not run.facts.level or gravity[:2].any():
        return False
    slides = np.concatenate([model.geom_friction[:, 0], model.pair_friction[:, :2].ravel()])
    is_unit = most_condim(model) <= 3 and bool((slides == 1).all())
    still = no_air(run) is not None and not model.opt.wind.any()
    return still and (_is_elliptic(model) or is_unit)


proof_of_absence = proof_from_condition("", lambda _: False)
no_contact = proof_from_condition(
    "no two geoms can touch", lambda run: run.facts.kinds == frozenset()
)
no_limit = proof_of_zero_fields("no joint or tendon has a limit", "jnt_limited", "tendon_limited")
# With springs and damping off, MuJoCo also skips the other passive forces; and a holding load acts
# through both.
no_damping = proof_from_condition(
    "no joint or tendon is damped",
    lambda run: (
        not (
            run.loaded
            or _has_other_forces(run.model)
            or has_nonzero_fields(run.model, *DAMPING, *_TENDON_DAMPING_FIELDS)
        )
    ),
)
no_spring = proof_from_condition(
    "no joint or tendon is a spring",
    lambda run: (
        not (
            run.loaded
            or _has_other_forces(run.model)
            or has_nonzero_fields(run.model, *_SPRING_FIELDS)
        )
    ),
)
no_joint_damping = proof_from_condition(
    "no joint is damped", lambda run: not (run.loaded or has_nonzero_fields(run.model, *DAMPING))
)
# Without density and viscosity a medium exerts no force, whatever the wind.
no_air = proof_from_condition(
    "the medium has no density or viscosity",
    lambda run: not (run.model.opt.density or run.model.opt.viscosity),
)
no_friction = first_proof(
    no_contact,
    proof_from_condition("no contact has friction", lambda run: most_condim(run.model) <= 1),
)
straight_drop = first_proof(
    no_contact,
    proof_from_condition(
        "what falls does so straight, and its contacts never move sideways", _falls_straight
    ),
)
# An elliptic cone treats every direction separately.
no_turning = first_proof(
    no_contact,
    proof_from_condition(
        "no body that can touch another can turn",
        lambda run: not run.facts.turning and _is_elliptic(run.model),
    ),
    straight_drop,
)
# Speculative contacts come from the general function.
no_general_collision = first_proof(
    no_contact,
    proof_from_condition(
        "all shapes that can touch have a collision function of their own",
        lambda run: (
            not read_flag(run.model, "speculative")
            and run.facts.kinds is not None
            and run.facts.kinds <= _SPECIAL_PAIRS
        ),
    ),
)
no_crowd = first_proof(
    no_contact,
    proof_from_condition(
        "no body has more than one geom", lambda run: not run.facts.has_crowded_body
    ),
)
# Sleeping needs islands.
one_tree = proof_from_condition(
    "a single tree of bodies is one island",
    lambda run: run.model.ntree <= 1 and not run.model.nflex and not read_flag(run.model, "sleep"),
)
no_constraint = proof_from_condition(
    "there is nothing to solve",
    lambda run: (
        not (run.model.neq or run.model.nflex or has_nonzero_fields(run.model, *FRICTION_LOSS))
        and no_contact(run)
        and no_limit(run)
    ),
)
no_equality = first_proof(
    proof_of_zero_fields("no equality constraint", "neq"),
    proof_of_zero_fields("no equality constraint is active", "eq_active0"),
)


def no_noslip(run: RunState) -> str | None:
    """Return the reason if no contact or joint has friction that could slip."""
    return None if has_nonzero_fields(run.model, *FRICTION_LOSS) else no_friction(run)
