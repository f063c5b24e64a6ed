"""A model near a pose as a linear system, and one step of it.

Without contacts, gravity and controls, a model near a pose is ``M a = -K x - C v - D v``: K and C
are of servos, springs and tendons, D is of the damping that the integrator takes implicitly. One
step is then a linear map of (x, v), which grows if an eigenvalue of it exceeds 1. With
``W = M + h D`` and ``P = I - h W^-1 (C + D)``,

* the Euler family has ``v' = P v - h W^-1 K x`` and ``x' = x + h v'``;
* equalities are soft: with their Jacobian J, forces accelerate ``N = M + J^T D J``, and the Euler
  family has ``W^-1 M N^-1`` for ``W^-1``. They add ``J^T D k J`` to K and ``J^T D b J`` to C;
* RK4 has ``1 + z + z^2/2 + z^3/6 + z^4/24`` of the step times the eigenvalues of the system.

Source: MuJoCo's documentation, Computation > Numerical integration; LaSalle, The stability and
control of discrete processes.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.numerical_tolerance import COARSE_ROUNDING, SUM_ROUNDING

HOLDS = 1 + COARSE_ROUNDING
"""Largest growth of a step that holds. An eigenvalue of exactly 1 is a uniform motion, and rounding
makes it slightly larger."""
Ids = NDArray[np.int32]
_INTEGRATOR = mujoco.mjtIntegrator
_SPRING, _DAMPER = (
    int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}", 0)) for name in ("SPRING", "DAMPER")
)
_EULERDAMP = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
_SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
_AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)


class ServoForce(NamedTuple):
    """The feedback of an actuator: a spring and a damper along its moment.

    Attributes:
        actuator: its id.
        row: (nv,) derivative of its length with respect to the degrees of freedom.
        stiffness: force per length.
        damping: force per speed of the length.
    """

    actuator: int
    row: Floats
    stiffness: float
    damping: float


@dataclass(frozen=True)
class LinearModel:
    """A model near a pose: matrices (nv, nv) of its degrees of freedom, and its step.

    Attributes:
        mass: the inertia.
        stiffness: of servos, springs and tendons.
        explicit, implicit: damping that Euler takes explicitly and implicitly.
        soft_mass, soft_damping: of equalities, which resist forces like an inertia.
        free: (nv, k) directions that no equality holds.
        timestep: [s].
        integrator: as in mjtIntegrator.
    """

    mass: Floats
    stiffness: Floats
    explicit: Floats
    implicit: Floats
    soft_mass: Floats
    soft_damping: Floats
    free: Floats
    timestep: float
    integrator: int

    @property
    def weighs(self) -> bool:
        """Whether something moves, and all that moves has inertia."""
        mass = self.mass
        return bool(mass.size and np.linalg.eigvalsh(mass).min() > mujoco.mjMINVAL)

    def find_growth(self, timestep: float | None = None, integrator: int | None = None) -> float:
        """Return the largest magnitude of an eigenvalue of one step; above 1, a motion grows."""
        step = self.timestep if timestep is None else timestep
        modes, _ = self._find_modes(step, self.integrator if integrator is None else integrator)
        return float(np.abs(modes).max(initial=0.0))

    def holds_step(self, timestep: float | None = None, integrator: int | None = None) -> bool:
        """Return whether no motion grows in one step."""
        return self.find_growth(timestep, integrator) <= HOLDS

    def find_growing_dofs(self) -> Floats:
        """Return (nv,) the kinetic energy of the motion that grows most, as shares of the dofs."""
        modes, shapes = self._find_modes(self.timestep, self.integrator)
        velocity = shapes[len(self.mass) :, int(np.abs(modes).argmax())]
        energy = np.diag(self.mass) * np.abs(velocity) ** 2
        return energy / max(energy.sum(), np.finfo(float).tiny)

    def scale_servo(self, servo: ServoForce, stiffness: float, damping: float) -> "LinearModel":
        """Return the model with the stiffness and the damping of a servo times two factors."""
        square = np.outer(servo.row, servo.row)
        return replace(
            self,
            stiffness=self.stiffness + (stiffness - 1) * servo.stiffness * square,
            explicit=self.explicit + (damping - 1) * servo.damping * square,
        )

    def add_armature(self, dof: int, armature: float) -> "LinearModel":
        """Return the model with more armature of a degree of freedom."""
        mass = self.mass.copy()
        mass[dof, dof] += armature
        return replace(self, mass=mass)

    def _find_modes(self, timestep: float, integrator: int) -> tuple[np.ndarray, np.ndarray]:
        mass, whole = self.mass, self.explicit + self.implicit + self.soft_damping
        unit, h = np.eye(len(mass)), timestep
        inverse_mass = np.linalg.inv(mass + self.soft_mass)
        if integrator == _INTEGRATOR.mjINT_RK4:
            rates = np.block(
                [[0 * unit, unit], [-inverse_mass @ self.stiffness, -inverse_mass @ whole]]
            )
            values, shapes = np.linalg.eig(rates)
            z = h * values
            return 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24, shapes
        late = self.implicit
        if integrator != _INTEGRATOR.mjINT_EULER:
            late = self.implicit + self.explicit
        push = h * np.linalg.inv(mass + h * late) @ mass @ inverse_mass
        pull, keep = -push @ self.stiffness, unit - push @ whole
        return np.linalg.eig(np.block([[unit + h * pull, h * keep], [pull, keep]]))


def name_integrator(integrator: int) -> str:
    """Return the name of an integrator as a model's file has it."""
    name = _INTEGRATOR(integrator).name.removeprefix("mjINT_")
    return {"RK4": "RK4", "EULER": "Euler"}.get(name, name.lower())


def linearize_model(model: mujoco.MjModel, data: mujoco.MjData) -> LinearModel:
    """Return a model near its state, from `mj_forward`."""
    flags, size = int(model.opt.disableflags), (model.nv, model.nv)
    mass = np.empty(size)
    for row, unit in zip(mass, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    stiffness, explicit = np.zeros(size), np.zeros(size)
    damping = np.diag(np.asarray(model.dof_damping)) * (not flags & _DAMPER)
    for row, spring, damper in list_linear_forces(model, data):
        stiffness += spring * np.outer(row, row)
        explicit += damper * np.outer(row, row)
    late = bool(flags & _EULERDAMP)
    rows = _equality_rows(model, data)
    spring, damper, impedance = np.asarray(data.efc_KBIP)[: data.ne, :3].T
    hard = np.asarray(data.efc_D)[: data.ne]
    soft_mass, soft_stiffness, soft_damping = (
        (rows.T * weight) @ rows for weight in (hard, hard * spring * impedance, hard * damper)
    )
    free = np.eye(model.nv)
    if len(rows):
        _, sizes, directions = np.linalg.svd(rows)
        held_count = int(np.sum(sizes > SUM_ROUNDING * sizes.max(initial=0.0)))
        free = directions[held_count:].T
    return LinearModel(
        mass,
        stiffness + soft_stiffness,
        explicit + late * damping,
        (not late) * damping,
        soft_mass,
        soft_damping,
        free,
        float(model.opt.timestep),
        int(model.opt.integrator),
    )


def list_linear_forces(
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
    yield from ((servo.row, servo.stiffness, servo.damping) for servo in list_servos(model, data))


def list_servos(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[ServoForce]:
    """Yield the actuators with a force that answers to their length or its speed."""
    alone = getattr(model, "nout", model.nu) == model.nu  # of actuators with a single moment
    if int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_ACTUATION) or not alone:
        return
    sparse = data.moment_rownnz, data.moment_rowadr, data.moment_colind
    for actuator in np.flatnonzero(model.actuator_biastype == _AFFINE).tolist():
        _, length, speed = model.actuator_biasprm[actuator, :3].tolist()
        row = _dense_row(model.nv, data.actuator_moment, *sparse, actuator)
        if (length < 0 or speed < 0) and row.any():
            yield ServoForce(actuator, row, max(-length, 0.0), max(-speed, 0.0))


def _dense_row(
    width: int, values: Floats, counts: Ids, starts: Ids, columns: Ids, row: int
) -> Floats:
    dense, start = np.zeros(width), int(starts[row])
    some = slice(start, start + int(counts[row]))
    dense[np.ravel(columns)[some]] = np.ravel(values)[some]
    return dense


def _equality_rows(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    rows = np.zeros((data.ne, model.nv))
    if not data.ne:
        return rows
    if mujoco.mj_isSparse(model):
        sparse = data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
        for place, row in enumerate(rows):
            row[:] = _dense_row(model.nv, data.efc_J, *sparse, place)
        return rows
    rows[:] = np.reshape(data.efc_J, (-1, model.nv))[: data.ne]
    return rows
