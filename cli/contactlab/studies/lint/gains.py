"""Checks that actuator and spring gains are stable at the model's time step.

Without contacts, gravity and controls, a model near a pose is ``M a = -K x - C v - D v``: K and C
are of servos, springs and tendons, D is of the damping that the integrator takes implicitly. One
step is then a linear map of (x, v), which grows if an eigenvalue of it exceeds 1. With
``W = M + h D`` and ``P = I - h W^-1 (C + D)``,

* the Euler family has ``v' = P v - h W^-1 K x`` and ``x' = x + h v'``;
* RK4 has ``1 + z + z^2/2 + z^3/6 + z^4/24`` of the step times the eigenvalues of the system.

Source: MuJoCo's documentation, Computation > Numerical integration; LaSalle, The stability and
control of discrete processes.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.numerical_tolerance import COARSE_ROUNDING, SUM_ROUNDING
from contactlab.scene.model_names import name_of
from contactlab.studies.lint.linted_model import Fault, LintedModel
from contactlab.studies.lint.rules import rule

Ids = NDArray[np.int32]
# An eigenvalue of exactly 1 is a uniform motion; rounding makes it slightly larger.
_GROWS = 1 + COARSE_ROUNDING
_INTEGRATOR = mujoco.mjtIntegrator
_SPRING, _DAMPER = (
    int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}", 0)) for name in ("SPRING", "DAMPER")
)
_EULERDAMP = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
_SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
_AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)


class Linear(NamedTuple):
    """A model near a pose: matrices (n, n) of its degrees of freedom.

    `explicit` and `implicit` are the damping that Euler takes explicitly and implicitly.
    """

    mass: Floats
    stiffness: Floats
    explicit: Floats
    implicit: Floats


def growth(linear: Linear, timestep: float, integrator: int) -> float:
    """Return the largest magnitude of an eigenvalue of one step [s]; above 1, a motion grows."""
    return float(np.abs(_find_modes(linear, timestep, integrator)).max(initial=0.0))


def _find_modes(linear: Linear, timestep: float, integrator: int) -> np.ndarray:
    """Return the eigenvalues (2n,) of one step."""
    mass, stiffness, explicit, implicit = linear
    unit, h = np.eye(len(mass)), timestep
    if integrator == _INTEGRATOR.mjINT_RK4:
        inverse = np.linalg.inv(mass)
        rates = np.block(
            [[0 * unit, unit], [-inverse @ stiffness, -inverse @ (explicit + implicit)]]
        )
        z = h * np.linalg.eigvals(rates)
        return 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24
    if integrator != _INTEGRATOR.mjINT_EULER:
        implicit, explicit = implicit + explicit, 0 * explicit
    inverse = np.linalg.inv(mass + h * implicit)
    pull, keep = -h * inverse @ stiffness, unit - h * inverse @ (explicit + implicit)
    return np.linalg.eigvals(np.block([[unit + h * pull, h * keep], [pull, keep]]))


def linear_model(model: mujoco.MjModel, data: mujoco.MjData) -> Linear:
    """Return a model near its state, from `mj_forward`, without directions that equalities hold."""
    flags, size = int(model.opt.disableflags), (model.nv, model.nv)
    mass = np.empty(size)
    for row, unit in zip(mass, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    stiffness, explicit = np.zeros(size), np.zeros(size)
    damping = np.diag(np.asarray(model.dof_damping)) * (not flags & _DAMPER)
    for row, spring, damper in _linear_forces(model, data):
        stiffness += spring * np.outer(row, row)
        explicit += damper * np.outer(row, row)
    late = bool(flags & _EULERDAMP)
    free = _free_directions(model, data)
    parts = (mass, stiffness, explicit + late * damping, (not late) * damping)
    return Linear(*(free.T @ part @ free for part in parts))


def _linear_forces(
    model: mujoco.MjModel, data: mujoco.MjData
) -> Iterator[tuple[Floats, float, float]]:
    """Yield Jacobian (nv,), stiffness and damping of springs, tendons and servos."""
    flags = int(model.opt.disableflags)
    springs, dampers = not flags & _SPRING, not flags & _DAMPER
    for joint in np.flatnonzero(model.jnt_stiffness).tolist():
        if springs and model.jnt_type[joint] in _SCALAR:
            row = np.zeros(model.nv)
            row[model.jnt_dofadr[joint]] = 1
            yield row, float(model.jnt_stiffness[joint]), 0.0
    owner: Any = model if hasattr(model, "ten_J_colind") else data  # since 4.0
    sparse = owner.ten_J_rownnz, owner.ten_J_rowadr, owner.ten_J_colind
    for tendon in np.flatnonzero(model.tendon_stiffness + model.tendon_damping).tolist():
        low, high = model.tendon_lengthspring[tendon]
        taut = springs and not low < data.ten_length[tendon] < high
        row = _dense_row(model.nv, data.ten_J, *sparse, tendon)
        stiffness = float(model.tendon_stiffness[tendon])
        yield row, taut * stiffness, dampers * float(model.tendon_damping[tendon])
    alone = getattr(model, "nout", model.nu) == model.nu  # of actuators with a single moment
    if flags & int(mujoco.mjtDisableBit.mjDSBL_ACTUATION) or not alone:
        return
    sparse = data.moment_rownnz, data.moment_rowadr, data.moment_colind
    for actuator in np.flatnonzero(model.actuator_biastype == _AFFINE).tolist():
        _, length, speed = model.actuator_biasprm[actuator, :3].tolist()
        row = _dense_row(model.nv, data.actuator_moment, *sparse, actuator)
        yield row, max(-length, 0.0), max(-speed, 0.0)


def _dense_row(
    width: int, values: Floats, counts: Ids, starts: Ids, columns: Ids, row: int
) -> Floats:
    """Return a row of a sparse matrix as a dense one."""
    found, start = np.zeros(width), int(starts[row])
    some = slice(start, start + int(counts[row]))
    found[np.ravel(columns)[some]] = np.ravel(values)[some]
    return found


def _free_directions(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    """Return (nv, k) the directions that no equality constrains."""
    rows = np.zeros((data.ne, model.nv))
    if not data.ne:
        return np.eye(model.nv)
    if mujoco.mj_isSparse(model):
        for place, row in enumerate(rows):
            row[:] = _dense_row(
                model.nv,
                data.efc_J,
                data.efc_J_rownnz,
                data.efc_J_rowadr,
                data.efc_J_colind,
                place,
            )
    else:
        rows[:] = np.reshape(data.efc_J, (-1, model.nv))[: data.ne]
    _, sizes, directions = np.linalg.svd(rows)
    held = int(np.sum(sizes > SUM_ROUNDING * sizes.max(initial=0.0)))
    return directions[held:].T


@rule("gain-step", "gate")
def gain_step(linted: LintedModel) -> Iterator[Fault]:
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
    pulled = any(spring or damper for _, spring, damper in _linear_forces(model, data))
    if not pulled and not (late and model.dof_damping.any()):
        return  # joint damping is implicit, and stable at any step
    linear = linear_model(model, data)
    weighs = linear.mass.size and np.linalg.eigvalsh(linear.mass).min() > mujoco.mjMINVAL
    if not weighs or not (found := growth(linear, timestep, integrator)) > _GROWS:
        return
    # The largest stable step, by bisection, rounded down to two digits.
    low, high = 0.0, timestep
    halvings = 20
    for _ in range(halvings):
        middle = (low + high) / 2
        low, high = (low, middle) if growth(linear, middle, integrator) > _GROWS else (middle, high)
    holds = float(f"{0.98 * low:.1e}")
    implicit = growth(linear, timestep, int(_INTEGRATOR.mjINT_IMPLICITFAST)) <= _GROWS
    values = {"integrator": "implicitfast"} if implicit else {"timestep": f"{holds:g}"}
    name = _INTEGRATOR(integrator).name.removeprefix("mjINT_")
    joint = _stiffest_joint(model, data, timestep)
    yield Fault(
        f"from {start}, a step of {timestep * 1e3:g} ms with {name} lets a small motion of "
        f"joint '{joint}' grow {found:.3g}-fold, without any control; {holds * 1e3:g} ms holds it",
        linted.place("joint", joint),
        linted.set_in("option", **values),
    )


def _stiffest_joint(model: mujoco.MjModel, data: mujoco.MjData, timestep: float) -> str:
    """Return the joint with the largest springs and damping for its inertia, in one step."""
    load, mass = np.zeros(model.nv), np.empty((model.nv, model.nv))
    for row, unit in zip(mass, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    for row, spring, damper in _linear_forces(model, data):
        load += (timestep**2 * spring + 2 * timestep * damper) * row**2
    return name_of(model, "joint", int(model.dof_jntid[int(np.argmax(load / np.diag(mass)))]))
