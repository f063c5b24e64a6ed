"""Changes of a compiled model in place, for rows of the error budget and for fixes."""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.modifications.model_predicates import (
    CLAMP_FLAG,
    ELLIPTIC,
    PYRAMIDAL,
    SLEEP_BIT,
    SOLREF_FIELDS,
    find_disable_bit,
    has_distance_fields,
    has_iterated_collision,
    has_single_contacts,
)
from contactlab.modifications.modification import InPlaceChange, ModelChange
from contactlab.scene.model_names import name_of
from contactlab.scene.part_bodies import is_mocap_driven
from contactlab.schema.setting_values import as_number

DENSE_UP_TO = 400  # degrees of freedom; a dense Jacobian of more takes too long


def keep_model(_model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    """Change nothing."""


def disable_effect(name: str) -> ModelChange:
    """Return the change that switches an effect off."""

    def change_model(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        model.opt.disableflags |= find_disable_bit(name)

    return change_model


def clear_fields(*fields: str) -> ModelChange:
    """Return the change that sets fields of a model to 0."""

    def change_model(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        for field in fields:
            if hasattr(model, field):
                getattr(model, field)[:] = 0

    return change_model


def set_option(name: str, value: Callable[[mujoco.MjModel], float]) -> ModelChange:
    """Return the change that sets an option to a value, which may depend on the model."""

    def change_model(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        setattr(model.opt, name, value(model))

    return change_model


def choose_other_integrator(model: mujoco.MjModel) -> float:
    """Return implicitfast, or Euler for a model that has implicitfast."""
    implicit = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    euler = int(mujoco.mjtIntegrator.mjINT_EULER)
    return euler if model.opt.integrator == implicit else implicit


def converge_solver(model: mujoco.MjModel, _own: mujoco.MjModel | None = None) -> None:
    """Make the solver run to convergence: Newton's, if its Hessian is right.

    MuJoCo 4.0's can be wrong with sparse Jacobians where trees branch; dense ones take too long
    above 400 degrees of freedom.
    """
    option = model.opt
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    # Few problems need more iterations, and a tolerance of rounding ends others.
    option.iterations = max(100, option.iterations)
    option.ls_iterations = max(50, option.ls_iterations)
    option.tolerance = 1e-12
    if has_branches(model) and model.nv <= DENSE_UP_TO:
        option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE


def converge_solver_alone(model: mujoco.MjModel, own: mujoco.MjModel) -> None:
    """Make the solver run to convergence, from contacts that are found as in the model as written.

    Iterations of collision that are enough are kept: they find the same contacts.
    """
    converge_solver(model)
    if has_iterated_collision(own) or has_single_contacts(own):
        for name in ("ccd_iterations", "ccd_tolerance", "sdf_iterations", "sdf_initpoints"):
            setattr(model.opt, name, getattr(own.opt, name))
        model.opt.disableflags |= own.opt.disableflags & find_disable_bit("multiccd")


def choose_other_solver(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    """Use another solver, converged: Newton's, or conjugate gradients in place of Newton's."""
    newton = int(mujoco.mjtSolver.mjSOL_NEWTON)
    other = mujoco.mjtSolver.mjSOL_CG if int(model.opt.solver) == newton else newton
    converge_solver(model)
    model.opt.solver = other


def choose_other_cone(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    """Use elliptic friction cones in place of pyramids, or pyramids in place of cones."""
    model.opt.cone = PYRAMIDAL if model.opt.cone == ELLIPTIC else ELLIPTIC


def multiply_impratio(model: mujoco.MjModel, own: mujoco.MjModel) -> None:
    """Set elliptic cones with ten times the impratio, or at least ten."""
    model.opt.impratio = find_stiff_impratio(own)
    model.opt.cone = ELLIPTIC


def converge_collision(model: mujoco.MjModel, _own: mujoco.MjModel | None = None) -> None:
    """Make collisions of convex shapes and distance fields run to convergence."""
    option = model.opt
    # Smooth shapes converge within 35 iterations, the default.
    option.ccd_iterations = max(200, option.ccd_iterations)
    option.ccd_tolerance = min(1e-6, option.ccd_tolerance)
    if has_distance_fields(model):
        # The best of several searches counts: four times the defaults, 10 and 40.
        option.sdf_iterations = max(40, option.sdf_iterations)
        option.sdf_initpoints = max(160, option.sdf_initpoints)


def add_speculative_contacts(model: mujoco.MjModel) -> None:
    """Find contacts with bodies that a body would pass in a step."""
    model.opt.enableflags |= int(getattr(mujoco.mjtEnableBit, "mjENBL_SPECULATIVE", 0))


def add_several_contacts(model: mujoco.MjModel, _own: mujoco.MjModel | None = None) -> None:
    """Find several contacts between two convex shapes that meet in a face."""
    model.opt.disableflags &= ~find_disable_bit("multiccd")


def has_branches(model: mujoco.MjModel) -> bool:
    """Return whether a kinematic tree branches."""
    parents = model.dof_parentid[model.dof_parentid >= 0]
    return bool((np.bincount(parents, minlength=1) > 1).any())


def keep_awake(model: mujoco.MjModel, _own: mujoco.MjModel | None = None) -> None:
    """Let no body sleep."""
    model.opt.enableflags &= ~SLEEP_BIT


def add_noslip_iterations(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    """Make all iterations: noslip's tolerance has a unit."""
    model.opt.noslip_iterations = max(10, 2 * model.opt.noslip_iterations)
    model.opt.noslip_tolerance = 0


def stiffen_solref(solref: Floats, times: float = 2) -> Floats:
    """Return (n, 2) solref with `times` the natural frequency and the same damping ratio.

    Positive ones are a time constant and a damping ratio; others are minus stiffness and damping,
    where the frequency is the root of the first.
    """
    standard = solref[:, :1] > 0
    return np.where(standard, solref * [1 / times, 1], solref * [times**2, times])


def stiffen_fields(*fields: str) -> ModelChange:
    """Return the change that doubles the natural frequency of fields of solref."""

    def change_model(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        for field in fields:
            array = getattr(model, field)
            array[:] = stiffen_solref(array)
        if "geom_solref" in fields:
            model.opt.o_solref[:] = stiffen_solref(model.opt.o_solref[None])[0]

    return change_model


def stiffen_equalities(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    """Double the natural frequency of equalities that no mocap body drives."""
    is_free = ~is_mocap_driven(model)
    model.eq_solref[is_free] = stiffen_solref(model.eq_solref[is_free])


def raise_time_constants(model: mujoco.MjModel, own: mujoco.MjModel) -> None:
    """Raise time constants as refsafe does at the run's step."""
    least = 2 * own.opt.timestep
    for field in SOLREF_FIELDS:
        array = getattr(model, field)
        array[(array[:, 0] > 0) & (array[:, 0] < least), 0] = least


def scale_friction(factor: float) -> ModelChange:
    """Return the change that multiplies friction by a factor."""

    def change_model(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        model.geom_friction[:, 0] *= factor
        model.pair_friction[:, :2] *= factor
        model.flex_friction[:, 0] *= factor
        model.opt.o_friction[:2] *= factor

    return change_model


def scale_masses(factor: float) -> ModelChange:
    """Return the change that multiplies masses and inertias by a factor."""

    def change_model(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        model.body_mass[:] *= factor
        model.body_inertia[:] *= factor
        mujoco.mj_setConst(model, mujoco.MjData(model))

    return change_model


def limit_condim(most: int) -> ModelChange:
    """Return the change that bounds the dimensions of contacts."""

    def change_model(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        for field in ("geom_condim", "pair_dim", "flex_condim"):
            array = getattr(model, field)
            array[:] = np.minimum(array, most)

    return change_model


def remove_clamps(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    """Remove the limits of controls and forces."""
    model.opt.disableflags |= find_disable_bit(CLAMP_FLAG)
    for field in ("actuator_forcelimited", "jnt_actfrclimited", "tendon_actfrclimited"):
        getattr(model, field)[:] = 0


def remove_gravity(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    """Remove gravity."""
    model.opt.gravity[:] = 0


def remove_fluid(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    """Remove the medium."""
    model.opt.density = model.opt.viscosity = 0


def set_integrator(kind: int) -> InPlaceChange:
    """Return the change that sets the integrator."""

    def change_model(model: mujoco.MjModel) -> None:
        model.opt.integrator = kind

    return change_model


def add_noslip(model: mujoco.MjModel) -> None:
    """Add ten iterations of noslip."""
    model.opt.noslip_iterations = 10


def stiffen_friction(model: mujoco.MjModel) -> None:
    """Set elliptic cones with friction ten times as stiff as the normal force."""
    model.opt.cone = ELLIPTIC
    model.opt.impratio = 10


def stiffen_friction_with_noslip(model: mujoco.MjModel) -> None:
    """Set elliptic cones with impratio 10, and noslip."""
    stiffen_friction(model)
    add_noslip(model)


GRIP_NOSLIP = 3
"""Iterations of noslip that hold an object against regularized friction."""


def find_stiff_impratio(model: mujoco.MjModel) -> float:
    """Return ten times the impratio under elliptic cones, or at least ten."""
    own = model.opt.impratio if model.opt.cone == ELLIPTIC else 1.0
    factor = 10.0  # holds an object against regularized friction
    return max(factor, factor * float(own))


def stiffen_grip(model: mujoco.MjModel, _geoms: Sequence[int]) -> None:
    """Set elliptic cones with ten times the impratio."""
    model.opt.impratio = find_stiff_impratio(model)
    model.opt.cone = ELLIPTIC


def add_grip_noslip(model: mujoco.MjModel, _geoms: Sequence[int]) -> None:
    """Set iterations of noslip."""
    model.opt.noslip_iterations = GRIP_NOSLIP


def stiffen_grip_with_noslip(model: mujoco.MjModel, geoms: Sequence[int]) -> None:
    """Set elliptic cones with ten times the impratio, and noslip."""
    stiffen_grip(model, geoms)
    add_grip_noslip(model, geoms)


def double_friction(model: mujoco.MjModel, geoms: Sequence[int]) -> None:
    """Double the sliding friction of geoms."""
    model.geom_friction[list(geoms), 0] *= 2


def add_torsional_friction(model: mujoco.MjModel, geoms: Sequence[int]) -> None:
    """Give contacts of geoms at least four dimensions."""
    model.geom_condim[list(geoms)] = np.maximum(model.geom_condim[list(geoms)], 4)


def stiffen_geoms(model: mujoco.MjModel, geoms: Sequence[int]) -> None:
    """Halve the time constants of geoms, to at least two steps."""
    least = 2 * model.opt.timestep
    for geom in geoms:
        if model.geom_solref[geom, 0] > 0:
            model.geom_solref[geom, 0] = max(least, 0.5 * model.geom_solref[geom, 0])


def reduce_condim(model: mujoco.MjModel, least: object) -> dict[str, object]:
    """Return settings that reduce the contact dimensions of geoms."""
    return {
        f"geom_condim[{name_of(model, 'geom', int(geom))}]": least
        for geom in np.flatnonzero(model.geom_condim > as_number(least))
    }
