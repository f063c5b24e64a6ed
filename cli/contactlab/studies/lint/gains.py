"""Checks that actuator and spring gains are stable at the model's time step."""

import math
from collections.abc import Iterator

import mujoco

from contactlab.closed_loop.linear_model import (
    HOLDS,
    linearize_model,
    list_linear_forces,
    name_integrator,
)
from contactlab.scene.model_names import name_of
from contactlab.studies.lint.linted_model import Fault, LintedModel
from contactlab.studies.lint.rules import rule

_INTEGRATOR = mujoco.mjtIntegrator
_EULERDAMP = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)


@rule("gain-step", "gate", cause="numerics")
def find_unstable_gains(linted: LintedModel) -> Iterator[Fault]:
    """One step of the integrator cannot hold the gains of servos, springs or tendons.

    Near the start, the step is a linear map of positions and velocities, with an eigenvalue above
    1, so any motion grows. Semi-implicit Euler holds a spring k and a damping c on a mass m for `2
    h c/m + h^2 k/m < 4` and `h c/m < 2`. The integrator `discrete` is not judged. Fix:
    `implicitfast` if that holds it, otherwise the largest timestep that does.
    """
    model = linted.model
    integrator, timestep = int(model.opt.integrator), float(model.opt.timestep)
    discrete = int(getattr(_INTEGRATOR, "mjINT_DISCRETE", -1))
    if not model.nv or integrator == discrete or not 0 < timestep < math.inf:
        return
    start, data = next(iter(linted.starts.items()))
    late = integrator == _INTEGRATOR.mjINT_RK4 or bool(model.opt.disableflags & _EULERDAMP)
    pulled = any(spring or damper for _, spring, damper in list_linear_forces(model, data))
    if not pulled and not (late and model.dof_damping.any()):
        return  # joint damping is implicit, and stable at any step
    linear = linearize_model(model, data)
    if not linear.weighs or (growth := linear.find_growth()) <= HOLDS:
        return
    # The largest stable step, by bisection, rounded down to two digits.
    low, high = 0.0, timestep
    halvings = 20
    for _ in range(halvings):
        middle = (low + high) / 2
        low, high = (middle, high) if linear.holds_step(middle) else (low, middle)
    holds = float(f"{0.98 * low:.1e}")
    implicit = linear.holds_step(integrator=int(_INTEGRATOR.mjINT_IMPLICITFAST))
    values = {"integrator": "implicitfast"} if implicit else {"timestep": f"{holds:g}"}
    name = name_integrator(integrator)
    dof = int(linear.find_growing_dofs().argmax())
    joint = name_of(model, "joint", int(model.dof_jntid[dof]))
    yield Fault(
        f"a step of {timestep * 1e3:g} ms with {name} does not hold joint '{joint}': from {start}, "
        f"a small motion grows {growth:.3g}-fold, without any control; {holds * 1e3:g} ms holds it",
        linted.place("joint", joint),
        linted.set_in("option", **values),
    )
