"""Rows of the error budget: each changes the reference model and says when a task exercises it.

A row is one entry in `ROWS`. It has the change, a test whether a model has the setting, and a test
whether a state of the run exercises it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.part_bodies import is_mocap_driven

Change = Callable[[mujoco.MjModel, mujoco.MjModel], None]  # a copy, and the run's own model
Uses = Callable[[mujoco.MjModel], bool]
Shows = Callable[[mujoco.MjModel, mujoco.MjData], bool]
Kind = Literal["numerics", "model", "effect", "unknown"]

_LIMITED = "clampctrl"
_SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))
# Of a solver that runs to convergence.
_ITERATIONS, _LINE_SEARCHES, _SMALL, _DENSE_UP_TO = 100, 50, 1e-12, 400
_PYRAMIDAL, _ELLIPTIC = int(mujoco.mjtCone.mjCONE_PYRAMIDAL), int(mujoco.mjtCone.mjCONE_ELLIPTIC)
_NO_FRICTION, _SLIDING = 1, 3  # of condim
GRAVITY_AS_REAL = 0.1
"""Share of the impulse of free fall that counts as a real impulse of a standing body."""


@dataclass(frozen=True)
class Row:
    """One entry of a budget.

    Attributes:
        name: as tables and options write it.
        summary: the change, in a few words.
        kind: numerics (of the run's own step), model (how rigid and how regularized), effect (left
            out), or unknown (a parameter that is not known exactly).
        changes: each makes one variation in a copy of the compared model; the largest counts.
        uses: whether a model has the setting; otherwise it has no such row.
        shows: whether a state after a step exercises the setting.
        base: the changed settings: those of the reference, of the run's step with a converged
            solver, or of the run.
        against: the settings to compare with: one of these.
        both: a change of both sides that comes first, if any.
        timed: whether the change could be made in the model's own settings.
        subject: the modeling choice, as in "depends on the friction cone".
        alternative: the change, as in "an elliptic cone changes thigh's motion".
    """

    name: str
    summary: str
    kind: Kind
    changes: Sequence[Change]
    uses: Uses
    shows: Shows
    base: Literal["run", "step", "reference"] = "reference"
    against: Literal["run", "step", "reference"] = "reference"
    both: Change | None = None
    timed: bool = True
    subject: str = ""
    alternative: str = ""

    @property
    def is_of_steps(self) -> bool:
        """Whether it says how far the run's steps are from the limit of fine ones."""
        return self.base != "reference" and self.against == "reference"


def _always(model: mujoco.MjModel, data: mujoco.MjData | None = None) -> bool:  # noqa: ARG001
    return True


def has_no_flex(model: mujoco.MjModel) -> bool:
    """Return whether any integrator is allowed: some refuse the elasticity of flexes."""
    return model.nflex == 0


def _any(*fields: str) -> Uses:
    """Return whether any number of a model's fields is not 0."""

    def uses(model: mujoco.MjModel) -> bool:
        return any(np.any(getattr(model, field)) for field in fields if hasattr(model, field))

    return uses


def disabled(model: mujoco.MjModel, name: str) -> bool:
    """Return whether an effect is switched off in a model's options."""
    return bool(model.opt.disableflags & _flag(name))


def gravity_of(model: mujoco.MjModel) -> float:
    """Return the magnitude of a model's gravity, 0 where it is switched off [m/s^2]."""
    return 0.0 if disabled(model, "gravity") else float(np.linalg.norm(model.opt.gravity))


def _flag(name: str) -> int:
    return int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name.upper()}", 0))


def _without(name: str) -> Change:
    def change(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        model.opt.disableflags |= _flag(name)

    return change


def _zero(*fields: str) -> Change:
    def change(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        for field in fields:
            if hasattr(model, field):
                getattr(model, field)[:] = 0

    return change


def _option(name: str, value: Callable[[mujoco.MjModel], float]) -> Change:
    def change(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        setattr(model.opt, name, value(model))

    return change


def stiffened(solref: Floats, times: float = 2) -> Floats:
    """Return (n, 2) solref of so many times the natural frequency and the same damping ratio.

    Positive ones are a time constant and a damping ratio; others are minus stiffness and damping,
    where the frequency is the root of the first.
    """
    standard = solref[:, :1] > 0
    return np.where(standard, solref * [1 / times, 1], solref * [times**2, times])


def _stiffer(*fields: str) -> Change:
    def change(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        for field in fields:
            array = getattr(model, field)
            array[:] = stiffened(array)
        if "geom_solref" in fields:
            model.opt.o_solref[:] = stiffened(model.opt.o_solref[None])[0]

    return change


# Fields of solref by kind of part; contacts also have the override of the options.
_CONTACT_SOLREF = ("geom_solref", "pair_solref", "flex_solref")
_SOLREF = (
    *_CONTACT_SOLREF,
    "jnt_solref",
    "dof_solref",
    "eq_solref",
    "tendon_solref_lim",
    "tendon_solref_fri",
)


def _stiffer_equalities(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    kept = ~is_mocap_driven(model)
    model.eq_solref[kept] = stiffened(model.eq_solref[kept])


def _has_joining_equalities(model: mujoco.MjModel) -> bool:
    return _has_equalities(model) and not is_mocap_driven(model).all()


def _joins(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether an equality pushes that no mocap body drives."""
    rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    rows[rows] = ~is_mocap_driven(model)[data.efc_id[rows]]
    force = np.abs(data.efc_force)
    return bool(force[rows].max(initial=0) > COARSE_ROUNDING * force.max(initial=0))


def _raised(model: mujoco.MjModel, own: mujoco.MjModel) -> None:
    """Raise time constants as refsafe does at the run's step."""
    least = 2 * own.opt.timestep
    for field in _SOLREF:
        array = getattr(model, field)
        array[(array[:, 0] > 0) & (array[:, 0] < least), 0] = least


def raises_time_constants(model: mujoco.MjModel) -> bool:
    """Return whether refsafe raises any time constant at a model's step."""
    if disabled(model, "refsafe"):
        return False
    return shortest_time_constant(model) < 2 * model.opt.timestep


def shortest_time_constant(model: mujoco.MjModel) -> float:
    """Return the shortest of a solref that anything may use [s]; infinite if there is none."""
    times = np.concatenate([getattr(model, field)[used(model, field), 0] for field in _SOLREF])
    return float(times.min(where=times > 0, initial=np.inf))


def used(model: mujoco.MjModel, field: str) -> NDArray[np.bool_]:
    """Return which rows of a field of solref anything may use."""
    used = {
        "geom_solref": model.geom_contype | model.geom_conaffinity,
        "jnt_solref": model.jnt_limited,
        "dof_solref": model.dof_frictionloss,
        "tendon_solref_lim": model.tendon_limited,
        "tendon_solref_fri": model.tendon_frictionloss,
    }
    return np.asarray(used.get(field, np.ones(len(getattr(model, field))))) != 0


def _scaled_friction(factor: float) -> Change:
    def change(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        model.geom_friction[:, 0] *= factor
        model.pair_friction[:, :2] *= factor
        model.flex_friction[:, 0] *= factor
        model.opt.o_friction[:2] *= factor

    return change


def _scaled_mass(factor: float) -> Change:
    def change(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        model.body_mass[:] *= factor
        model.body_inertia[:] *= factor
        mujoco.mj_setConst(model, mujoco.MjData(model))

    return change


def _with_condim(most: int) -> Change:
    def change(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        for field in ("geom_condim", "pair_dim", "flex_condim"):
            array = getattr(model, field)
            array[:] = np.minimum(array, most)

    return change


def _condim_above(least: int) -> Uses:
    def uses(model: mujoco.MjModel) -> bool:
        dims = (model.geom_condim, model.pair_dim, model.flex_condim)
        return collides(model) and any((dim > least).any() for dim in dims)

    return uses


def collides(model: mujoco.MjModel) -> bool:
    """Return whether contacts can arise in a model."""
    if disabled(model, "contact") or disabled(model, "constraint"):
        return False
    types = np.bitwise_or.reduce(
        np.concatenate([model.geom_contype, model.flex_contype]), initial=0
    )
    affinities = np.bitwise_or.reduce(
        np.concatenate([model.geom_conaffinity, model.flex_conaffinity]), initial=0
    )
    inside = model.flex_selfcollide.any()
    return bool(types & affinities or inside or model.npair)


def _no_clamps(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    model.opt.disableflags |= _flag(_LIMITED)
    for field in ("actuator_forcelimited", "jnt_actfrclimited", "tendon_actfrclimited"):
        getattr(model, field)[:] = 0


def _has_clamps(model: mujoco.MjModel) -> bool:
    ctrl = not disabled(model, _LIMITED) and model.actuator_ctrllimited.any()
    force = (model.actuator_forcelimited, model.jnt_actfrclimited, model.tendon_actfrclimited)
    return bool(ctrl or any(field.any() for field in force))


def _clamps(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    if not disabled(model, _LIMITED):
        low, high = model.actuator_ctrlrange.T
        beyond = (data.ctrl < low) | (data.ctrl > high)
        if (beyond & (model.actuator_ctrllimited > 0)).any():
            return True
    # Since MuJoCo 4, an actuator may have several outputs.
    outputs = getattr(model, "actuator_outnum", np.ones(len(model.actuator_forcelimited), int))
    low, high = model.actuator_forcerange.repeat(outputs, axis=0).T
    at = (data.actuator_force <= low) | (data.actuator_force >= high)
    if (at & (model.actuator_forcelimited.repeat(outputs) > 0)).any():
        return True
    return _at_joint_range(model, data)


def _at_joint_range(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether the actuators of a joint or tendon push with all that it allows."""
    limited = np.flatnonzero(model.jnt_actfrclimited)
    force = data.qfrc_actuator[model.jnt_dofadr[limited]]
    low, high = model.jnt_actfrcrange[limited].T
    joints = (
        (force <= low * (1 - COARSE_ROUNDING)) | (force >= high * (1 - COARSE_ROUNDING))
    ).any()
    # MuJoCo scales the actuators of a tendon together; their sum is then at the range.
    return bool(joints or model.tendon_actfrclimited.any())


def _has_force(field: str) -> Shows:
    """Return whether a field of generalized forces has any that is more than rounding."""

    def shows(model: mujoco.MjModel, data: mujoco.MjData) -> bool:  # noqa: ARG001
        beside = max(
            np.abs(data.qfrc_bias).max(initial=0), np.abs(data.qfrc_passive).max(initial=0)
        )
        own = np.abs(getattr(data, field)).max(initial=0)
        return bool(own > COARSE_ROUNDING * beside)

    return shows


def _has_rows(*kinds: str) -> Shows:
    """Return whether constraints of some kinds push."""
    wanted = [int(getattr(mujoco.mjtConstraint, f"mjCNSTR_{kind}")) for kind in kinds]

    def shows(model: mujoco.MjModel, data: mujoco.MjData) -> bool:  # noqa: ARG001
        if not data.nefc:
            return False
        force = np.abs(data.efc_force)
        own = force[np.isin(data.efc_type, wanted)].max(initial=0)
        return bool(own > COARSE_ROUNDING * force.max())

    return shows


_LOADED = _has_rows("CONTACT_FRICTIONLESS", "CONTACT_PYRAMIDAL", "CONTACT_ELLIPTIC")
_LIMITING = _has_rows("LIMIT_JOINT", "LIMIT_TENDON")
_RUBBING = _has_rows("FRICTION_DOF", "FRICTION_TENDON")
_JOINED = _has_rows("EQUALITY")


def _contact_forces(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[tuple[int, Floats]]:
    force = np.empty(6)
    for contact in np.flatnonzero(data.contact.efc_address >= 0):
        mujoco.mj_contactForce(model, data, int(contact), force)
        yield int(contact), force


def _resists(first: int, last: int) -> Shows:
    """Return whether a contact pushes in some of its directions other than the normal, 0."""

    def shows(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
        return any(
            np.abs(force[first:last]).max() > COARSE_ROUNDING * abs(force[0])
            for _, force in _contact_forces(model, data)
        )

    return shows


_RUBS = _resists(1, 3)
_TWISTS = _resists(3, 6)


def _may_slip(model: mujoco.MjModel) -> bool:
    """Return whether noslip has anything to do; the engine refuses it for flexes."""
    return has_no_flex(model) and (_condim_above(_NO_FRICTION)(model) or _has_friction_loss(model))


def _rubs_anywhere(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    return _RUBBING(model, data) or _RUBS(model, data)


def _pushes_apart(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether a contact pushes geoms that do not touch, or does only by its margin."""
    return any(
        data.contact.dist[contact] > 0 and force[0] > 0
        for contact, force in _contact_forces(model, data)
    )


def _raises(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether a constraint with a time constant that refsafe raises pushes."""
    least = 2 * model.opt.timestep
    if any(
        0 < data.contact.solref[contact][0] < least and force[0] > 0
        for contact, force in _contact_forces(model, data)
    ):
        return True
    others = (
        (_LIMITING, ("jnt_solref", "tendon_solref_lim")),
        (_RUBBING, ("dof_solref", "tendon_solref_fri")),
        (_JOINED, ("eq_solref",)),
    )
    return any(
        ((getattr(model, field)[:, 0] > 0) & (getattr(model, field)[:, 0] < least)).any()
        and shows(model, data)
        for shows, fields in others
        for field in fields
    )


def _pulls(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether a tendon's spring, damper, limit or friction acts."""
    if _has_rows("LIMIT_TENDON", "FRICTION_TENDON")(model, data):
        return True
    low, high = model.tendon_lengthspring.T
    stretched = (data.ten_length < low) | (data.ten_length > high)
    springs = stretched & (model.tendon_stiffness != 0)
    return bool(springs.any() or ((model.tendon_damping != 0) & (data.ten_velocity != 0)).any())


_TENDON = (
    "tendon_stiffness",
    "tendon_stiffnesspoly",
    "tendon_damping",
    "tendon_dampingpoly",
    "tendon_frictionloss",
    "tendon_limited",
)
_DAMPING = (
    "dof_damping",
    "dof_dampingpoly",
    "tendon_damping",
    "tendon_dampingpoly",
    "actuator_damping",
    "actuator_dampingpoly",
)
_SPRINGS = ("jnt_stiffness", "tendon_stiffness", "jnt_stiffnesspoly", "tendon_stiffnesspoly")
_MARGINS = ("geom_margin", "geom_gap", "pair_margin", "pair_gap", "flex_margin", "flex_gap")


def _other_integrator(model: mujoco.MjModel) -> float:
    implicit = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    euler = int(mujoco.mjtIntegrator.mjINT_EULER)
    return euler if model.opt.integrator == implicit else implicit


def go_on(model: mujoco.MjModel, _own: mujoco.MjModel | None = None) -> None:
    """Make the solver run to convergence: Newton's, if its Hessian is right.

    MuJoCo 4.0's can be wrong with sparse Jacobians where trees branch; dense ones take too long
    above 400 degrees of freedom.
    """
    option = model.opt
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.iterations = max(_ITERATIONS, option.iterations)
    option.ls_iterations = max(_LINE_SEARCHES, option.ls_iterations)
    option.tolerance = _SMALL
    if _branches(model) and model.nv <= _DENSE_UP_TO:
        option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE


def _branches(model: mujoco.MjModel) -> bool:
    """Return whether more than one degree of freedom follows upon another."""
    parents = model.dof_parentid[model.dof_parentid >= 0]
    return bool((np.bincount(parents, minlength=1) > 1).any())


def _awake(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    model.opt.enableflags &= ~_SLEEP


def _sleeps(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    return int(data.ntree_awake) < model.ntree


def _as_it_is(_model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    pass


def _without_slip(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    """Make all iterations: noslip's tolerance has a unit."""
    model.opt.noslip_iterations = max(10, 2 * model.opt.noslip_iterations)
    model.opt.noslip_tolerance = 0


def _no_gravity(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    model.opt.gravity[:] = 0


def _has_gravity(model: mujoco.MjModel) -> bool:
    return bool(model.opt.gravity.any()) and not disabled(model, "gravity")


def _has_fluid(model: mujoco.MjModel) -> bool:
    return bool(model.opt.density or model.opt.viscosity)


def _no_fluid(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    model.opt.density = model.opt.viscosity = 0


def _has_equalities(model: mujoco.MjModel) -> bool:
    return bool(model.neq) and not disabled(model, "equality")


def _has_limits(model: mujoco.MjModel) -> bool:
    return _any("jnt_limited", "tendon_limited")(model) and not disabled(model, "limit")


def _has_friction_loss(model: mujoco.MjModel) -> bool:
    return _any("dof_frictionloss", "tendon_frictionloss")(model) and not disabled(
        model, "frictionloss"
    )


def _constrained(model: mujoco.MjModel, data: mujoco.MjData) -> bool:  # noqa: ARG001
    return data.nefc > 0


def _has_constraints(model: mujoco.MjModel) -> bool:
    others = (_has_limits, _has_equalities, _has_friction_loss)
    return collides(model) or any(has(model) for has in others)


# The first row of every budget.
RUN = Row(
    "numerical error",
    "the run as written",
    "numerics",
    (_as_it_is,),
    _always,
    _always,
    base="run",
    timed=False,
)

ROWS: tuple[Row, ...] = (
    Row(
        "step",
        "the run's timestep, with a solver that goes on until it is done",
        "numerics",
        (_as_it_is,),
        _always,
        _always,
        base="step",
        timed=False,
    ),
    Row(
        "solver",
        "the run's own solver, iterations and tolerance",
        "numerics",
        (go_on,),
        _has_constraints,
        _constrained,
        base="step",
        against="run",
    ),
    Row(
        "sleep",
        "bodies that do not sleep",
        "numerics",
        (_awake,),
        lambda model: bool(model.opt.enableflags & _SLEEP),
        _sleeps,
        base="run",
        against="run",
    ),
    Row(
        "integrator",
        "implicitfast in place of the run's integrator; Euler in place of implicitfast",
        "numerics",
        (_option("integrator", _other_integrator),),
        has_no_flex,
        _always,
        base="step",
        against="step",
    ),
    Row(
        "refsafe",
        "time constants as the run's step has them raised",
        "numerics",
        (_raised,),
        raises_time_constants,
        _raises,
        timed=False,
    ),
    Row(
        "cone",
        "elliptic friction cones, not pyramids",
        "model",
        (_option("cone", lambda _: _ELLIPTIC),),
        lambda model: model.opt.cone != _ELLIPTIC and _condim_above(_NO_FRICTION)(model),
        _RUBS,
        subject="the friction cone",
        alternative="an elliptic cone",
    ),
    Row(
        "pyramids",
        "pyramids for friction cones",
        "effect",
        (_option("cone", lambda _: _PYRAMIDAL),),
        lambda model: model.opt.cone == _ELLIPTIC and _condim_above(_NO_FRICTION)(model),
        _RUBS,
    ),
    Row(
        "impratio",
        "impratio x 10, in elliptic cones: in pyramids it is of the normal force, too",
        "model",
        (_option("impratio", lambda model: 10 * model.opt.impratio),),
        _condim_above(_NO_FRICTION),
        _RUBS,
        both=_option("cone", lambda _: _ELLIPTIC),
        subject="impratio",
        alternative="ten times the impratio",
    ),
    Row(
        "noslip",
        "noslip with 10 iterations",
        "model",
        (_without_slip,),
        _may_slip,
        _rubs_anywhere,
        subject="slip in contacts",
        alternative="the noslip solver",
    ),
    Row(
        "contact softness",
        "solref of contacts / 2",
        "model",
        (_stiffer(*_CONTACT_SOLREF),),
        collides,
        _LOADED,
        subject="contact softness",
        alternative="half the contact solref",
    ),
    Row(
        "margin",
        "no margins, no gaps",
        "effect",
        (_zero(*_MARGINS),),
        lambda model: collides(model) and _any(*_MARGINS)(model),
        _pushes_apart,
    ),
    Row(
        "limit softness",
        "solref of limits / 2",
        "model",
        (_stiffer("jnt_solref", "tendon_solref_lim"),),
        _has_limits,
        _LIMITING,
        subject="joint limit softness",
        alternative="half the limit solref",
    ),
    Row(
        "friction loss softness",
        "solref of friction loss / 2",
        "model",
        (_stiffer("dof_solref", "tendon_solref_fri"),),
        _has_friction_loss,
        _RUBBING,
        subject="friction loss softness",
        alternative="half the friction loss solref",
    ),
    Row(
        "equality softness",
        "solref of equalities / 2, but for those by which mocap bodies drive",
        "model",
        (_stiffer_equalities,),
        _has_joining_equalities,
        _joins,
        subject="equality softness",
        alternative="half the equality solref",
    ),
    Row(
        "condim 1",
        "contacts without friction",
        "effect",
        (_with_condim(_NO_FRICTION),),
        _condim_above(_NO_FRICTION),
        _RUBS,
    ),
    Row(
        "condim 3",
        "contacts without torsion and rolling",
        "effect",
        (_with_condim(_SLIDING),),
        _condim_above(_SLIDING),
        _TWISTS,
    ),
    Row(
        "friction loss",
        "no friction loss",
        "effect",
        (_zero("dof_frictionloss", "tendon_frictionloss"),),
        _has_friction_loss,
        _RUBBING,
    ),
    Row(
        "damping",
        "no damping",
        "effect",
        (_zero(*_DAMPING),),
        _any(*_DAMPING),
        _has_force("qfrc_damper"),
    ),
    Row(
        "springs",
        "no springs",
        "effect",
        (_zero(*_SPRINGS),),
        _any(*_SPRINGS),
        _has_force("qfrc_spring"),
    ),
    Row("fluid", "no fluid", "effect", (_no_fluid,), _has_fluid, _has_force("qfrc_fluid")),
    Row("limits", "no limits", "effect", (_without("limit"),), _has_limits, _LIMITING),
    Row("tendons", "slack tendons", "effect", (_zero(*_TENDON),), _any(*_TENDON), _pulls),
    Row("equalities", "no equalities", "effect", (_without("equality"),), _has_equalities, _JOINED),
    Row(
        "gravity compensation",
        "no gravity compensation",
        "effect",
        (_zero("body_gravcomp"),),
        lambda model: _any("body_gravcomp")(model) and _has_gravity(model),
        _has_force("qfrc_gravcomp"),
    ),
    Row(
        "clamps", "no limits of controls and forces", "effect", (_no_clamps,), _has_clamps, _clamps
    ),
    Row("gravity", "no gravity", "effect", (_no_gravity,), _has_gravity, _always),
    Row(
        "friction 10 %",
        "friction + 10 % and - 10 %",
        "unknown",
        (_scaled_friction(1.1), _scaled_friction(0.9)),
        _condim_above(_NO_FRICTION),
        _RUBS,
        timed=False,
    ),
    Row(
        "mass 5 %",
        "all masses + 5 % and - 5 %",
        "unknown",
        (_scaled_mass(1.05), _scaled_mass(0.95)),
        _always,
        _always,
        timed=False,
    ),
)
