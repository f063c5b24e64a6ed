"""The work of forces in each step: the ledger for the energy balance of any model.

A step changes the velocity from v to v', so a force F that acts in it does the work
h F . (v + v') / 2: with a constant mass matrix that is exactly its part of the change of kinetic
energy. If the integrator is implicit in a force, the force at the end of the step counts.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import ACTUATORS, CONSTRAINTS, OTHERS, Floats
from contactlab.scene.initial_states import InitialStates, apply_inputs
from contactlab.scene.model_edits import read_flag
from contactlab.scene.part_bodies import AT_JOINT
from contactlab.scene.run_setup import (
    has_moving_surfaces,
    has_other_forces,
    is_conservative,
    is_passive,
)

_RK4 = mujoco.mjtIntegrator.mjINT_RK4
_IMPLICIT_FAST = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
_DISCRETE = getattr(mujoco.mjtIntegrator, "mjINT_DISCRETE", _IMPLICIT_FAST)
_IMPLICIT = (mujoco.mjtIntegrator.mjINT_IMPLICIT, _IMPLICIT_FAST, _DISCRETE)
_FIRST_CONTACT_TYPE = int(mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS)
_EULER_IS_EXPLICIT = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
_ACTUATOR_FIELDS = ("actuator_velocity", "actuator_force")
_OTHER_FORCE_FIELDS = ("qfrc_smooth", "qfrc_bias", "qfrc_spring", "qfrc_damper", "qfrc_fluid")
FORCES = ("qfrc_constraint", "qfrc_actuator", *_ACTUATOR_FIELDS, *_OTHER_FORCE_FIELDS)
"""Forces that may be recorded, in the order of `find_forces` in contact_kernel.c."""


class EnergyLedger:
    """The work in n runs of N steps, entered run by run: `work` and `given`, see `Trace`.

    They are left out if only gravity, springs and contacts act, because energy alone is sufficient
    then. They are left out with RK4, too: it keeps only the forces of its last stage. A batch
    records `forces`: arrays (rows, N, ...) by field of MjData.
    """

    def __init__(self, models: Sequence[mujoco.MjModel], steps: int, rows: int) -> None:
        """Open the ledger of runs of one structure, with `rows` of them recorded together."""
        model, fields = models[0], _recorded_fields(models)
        widths = {name: model.nu if name in _ACTUATOR_FIELDS else model.nv for name in fields}
        self.forces = {name: np.empty((rows, steps, width)) for name, width in widths.items()}
        self.work = np.full((len(models), steps, 3), np.nan) if fields else None
        self.given = np.zeros((len(models), 4)) if fields else None
        self._data = mujoco.MjData(model) if fields else None

    def enter_run(
        self, run: int, row: int, model: mujoco.MjModel, starts: InitialStates, states: Floats
    ) -> None:
        """Enter a run with forces in a row, and with its states (N + 1, nstate)."""
        if self.work is None or self.given is None or self._data is None:
            return
        velocity = states[:, 1 + model.nq : 1 + model.nq + model.nv]
        forces = {name: rows[row] for name, rows in self.forces.items()}
        self.work[run] = _step_work(model, velocity, forces)
        places = starts.signals[run].places
        pushed = starts.applied[run].any() or (places >= model.nu).any()
        # Some integrators omit velocity feedback between branches.
        feeds = model.actuator_biasprm[:, 2] != 0
        couples = bool((feeds & ~np.isin(model.actuator_trntype, AT_JOINT)).any())
        omits = couples and model.opt.integrator in {_IMPLICIT_FAST, _DISCRETE}
        if pushed or model.nflex or model.nplugin or omits:
            self.work[run, :, OTHERS] = np.nan
        # Contacts may do work of mocap bodies, moving surfaces or adhesion.
        moved = (places >= model.nu + 6 * model.nbody).any()
        adheres = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_BODY).any()
        if moved or adheres or has_moving_surfaces(model):
            self.given[run] = np.nan
            return
        acts = forces["qfrc_constraint"].any(axis=1)
        summed_work = np.concatenate(([0.0], np.cumsum(self.work[run, :, CONSTRAINTS])))
        acting_stretch, free = (
            _largest_rise(summed_work, acts | True),
            _largest_rise(summed_work, ~acts),
        )
        inputs = starts.input_rows(run, model.opt.timestep, np.array([acting_stretch[0], 0]))
        # Without constraints, no energy is stored; driven models may store energy at any time.
        stored, at_start, most = 0.0, 0.0, _stretch_rise(summed_work, free) * (not acts[free[0]])
        if _stretch_rise(summed_work, acting_stretch) > max(most, 0):
            stored, _ = self._stored_energy(model, states[acting_stretch[0]], inputs[0])
        if acts[0] and is_passive(model):
            _, at_start = self._stored_energy(model, states[0], inputs[1])
        # A stretch that begins without stored energy is less uncertain.
        more = 2 * most >= _stretch_rise(summed_work, acting_stretch) - stored
        self.given[run] = *(free if more else acting_stretch), 0 if more else stored, at_start

    def _stored_energy(
        self, model: mujoco.MjModel, state: Floats, inputs: Floats
    ) -> tuple[float, float]:
        """Return the most energy that constraints, and all except contacts, can have stored [J].

        At rest a constraint is a spring that does not soften: it has stored at most half of its
        force times violation, and for additional carried force at most that force times violation
        (MuJoCo's documentation, Computation > Constraint model).
        """
        data = self._data
        assert data is not None
        # Bodies that another run left asleep would keep its contacts.
        if read_flag(model, "sleep"):
            mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:], data.act[:] = np.split(
            state[1:], [model.nq, model.nq + model.nv]
        )
        apply_inputs(model, data, inputs)
        mujoco.mj_forward(model, data)
        violation, others = np.abs(data.efc_pos - data.efc_margin), data.qacc_smooth.copy()
        carried, sprung = (
            _forces_at_rest(model, data, controls) for controls in (others, 0 * others)
        )
        energies = violation * (sprung / 2 + np.maximum(carried - sprung, 0))
        return float(energies.sum()), float(energies[data.efc_type < _FIRST_CONTACT_TYPE].sum())


def _recorded_fields(models: Sequence[mujoco.MjModel]) -> list[str]:
    models = [*{id(model): model for model in models}.values()]
    if any(model.opt.integrator == _RK4 for model in models) or all(map(is_conservative, models)):
        return []
    fields = ["qfrc_constraint"]
    if models[0].nu:
        fields.append("qfrc_actuator")
        if any(model.opt.integrator in _IMPLICIT for model in models):
            fields += _ACTUATOR_FIELDS
    if any(map(has_other_forces, models)):
        fields += _OTHER_FORCE_FIELDS
    return fields


def _step_work(model: mujoco.MjModel, velocity: Floats, forces: dict[str, Floats]) -> Floats:
    """Return (N, 3) the work in each step; velocity (N + 1, nv)."""
    step = model.opt.timestep * (velocity[1:] + velocity[:-1]) / 2
    work = np.zeros((len(step), 3))
    work[:, CONSTRAINTS] = _row_dot(step, forces["qfrc_constraint"])
    if model.nu:
        work[:, ACTUATORS] = _row_dot(step, forces["qfrc_actuator"])
        if model.opt.integrator in _IMPLICIT:
            # Velocity feedback within force limits acts by speeds after a step.
            speed, force = (forces[actuator] for actuator in _ACTUATOR_FIELDS)
            change = _step_change(speed)
            low, high = model.actuator_forcerange.T
            free = ~model.actuator_forcelimited.astype(bool) | ((force > low) & (force < high))
            feedback = free * (speed + change / 2) * change
            work[:, ACTUATORS] += model.opt.timestep * feedback @ model.actuator_biasprm[:, 2]
    if _OTHER_FORCE_FIELDS[0] in forces:
        smooth, bias, spring, damper, fluid = (forces[name] for name in _OTHER_FORCE_FIELDS)
        others = smooth + bias - spring
        if model.nu:
            others -= forces["qfrc_actuator"]
        implicit = model.opt.integrator in _IMPLICIT
        if implicit or not model.opt.disableflags & _EULER_IS_EXPLICIT:
            others += _step_change(damper + fluid if implicit else damper)
        work[:, OTHERS] = _row_dot(step, others)
    return work


def _row_dot(step: Floats, force: Floats) -> Floats:
    return np.einsum("ij,ij->i", step, force)


def _step_change(force: Floats) -> Floats:
    """Return the change over each step; it is unknown over the last one."""
    return np.diff(force, axis=0, append=force[-1:])


def _largest_rise(summed_work: Floats, starts: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the first, one of `starts` (N,), and the last step of the largest rise in (N + 1)."""
    least = np.minimum.accumulate(np.where(starts, summed_work[:-1], np.inf))
    last = int((summed_work[1:] - least).argmax())
    return int(np.where(starts[: last + 1], summed_work[: last + 1], np.inf).argmin()), last


def _stretch_rise(summed_work: Floats, stretch: tuple[int, int]) -> float:
    first, last = stretch
    return float(summed_work[last + 1] - summed_work[first])


def _forces_at_rest(model: mujoco.MjModel, data: mujoco.MjData, others: Floats) -> Floats:
    """Return (nefc,) constraint forces at zero velocity with `others` as smooth acceleration."""
    data.qvel[:] = 0
    mujoco.mj_fwdVelocity(model, data)
    data.qacc_smooth[:] = others
    mujoco.mj_mulM(model, data, data.qfrc_smooth, others)
    mujoco.mj_fwdConstraint(model, data)
    return np.abs(data.efc_force)
