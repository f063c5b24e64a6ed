"""The work that forces do in each step: the books by which the energy of any model is judged.

A step changes the velocity from v to v', so a force F that acts in it does the work
h F . (v + v') / 2: with a constant mass matrix that is exactly its part of the change of kinetic
energy. Where the integrator is implicit in a force, the force at the end of the step counts.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import ACTUATORS, CONSTRAINTS, OTHERS, Floats
from contactlab.scene.initial_states import InitialStates, apply_inputs
from contactlab.scene.part_bodies import AT_JOINT
from contactlab.scene.run_setup import (
    has_moving_surfaces,
    has_others,
    is_conservative,
    is_passive,
)

_RK4 = mujoco.mjtIntegrator.mjINT_RK4
_FAST = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
_DISCRETE = getattr(mujoco.mjtIntegrator, "mjINT_DISCRETE", _FAST)
_IMPLICIT = (mujoco.mjtIntegrator.mjINT_IMPLICIT, _FAST, _DISCRETE)
_FIRST_OF_CONTACTS = int(mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS)
_EULER_IS_EXPLICIT = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
_OF_ACTUATORS = ("actuator_velocity", "actuator_force")
_FORCES_OF_OTHERS = ("qfrc_smooth", "qfrc_bias", "qfrc_spring", "qfrc_damper", "qfrc_fluid")
FORCES = ("qfrc_constraint", "qfrc_actuator", *_OF_ACTUATORS, *_FORCES_OF_OTHERS)
"""Forces that may be recorded, in the order of `find_forces` in contact_kernel.c."""


class Books:
    """The work in n runs of N steps, entered run by run: `work` and `given` as `Trace` says.

    Where nothing but gravity, springs and contacts acts, energy alone says what happened; and RK4
    keeps no forces but those of its last stage. Such runs have None. A batch records `forces`:
    arrays (rows, N, ...) by field of MjData.
    """

    def __init__(self, models: Sequence[mujoco.MjModel], steps: int, rows: int) -> None:
        """Open the books of runs of one structure, of which so many are recorded together."""
        model, fields = models[0], _fields(models)
        widths = {name: model.nu if name in _OF_ACTUATORS else model.nv for name in fields}
        self.forces = {name: np.empty((rows, steps, width)) for name, width in widths.items()}
        self.work = np.full((len(models), steps, 3), np.nan) if fields else None
        self.given = np.zeros((len(models), 4)) if fields else None
        self._data = mujoco.MjData(model) if fields else None

    def enter(
        self, run: int, row: int, model: mujoco.MjModel, starts: InitialStates, states: Floats
    ) -> None:
        """Enter a run whose forces are in a row, with its states (N + 1, nstate)."""
        if self.work is None or self.given is None or self._data is None:
            return
        velocity = states[:, 1 + model.nq : 1 + model.nq + model.nv]
        forces = {name: rows[row] for name, rows in self.forces.items()}
        self.work[run] = _work(model, velocity, forces)
        places = starts.signals[run].places
        pushed = starts.applied[run].any() or (places >= model.nu).any()
        if pushed or model.nflex or model.nplugin or _couples_branches(model):
            self.work[run, :, OTHERS] = np.nan
        moved = (places >= model.nu + 6 * model.nbody).any()
        if moved or _conveys(model):
            self.given[run] = np.nan
            return
        acts = forces["qfrc_constraint"].any(axis=1)
        given = np.concatenate(([0.0], np.cumsum(self.work[run, :, CONSTRAINTS])))
        held, free = _largest_rise(given, acts | True), _largest_rise(given, ~acts)
        inputs = starts.inputs(run, model.opt.timestep, np.array([held[0], 0]))
        # Where nothing is constrained, nothing is stored; who is driven may store at any time.
        stored, at_start, most = 0.0, 0.0, _rise(given, free) * (not acts[free[0]])
        if _rise(given, held) > max(most, 0):
            stored, _ = self._stored(model, states[held[0]], inputs[0])
        if acts[0] and is_passive(model):
            _, at_start = self._stored(model, states[0], inputs[1])
        # What begins where nothing is stored leaves less to doubt.
        more = 2 * most >= _rise(given, held) - stored
        self.given[run] = *(free if more else held), 0 if more else stored, at_start

    def _stored(self, model: mujoco.MjModel, state: Floats, inputs: Floats) -> tuple[float, float]:
        """Return the most energy that constraints, and all but contacts, can have stored [J].

        At rest a constraint is a spring that does not soften: it has stored at most half of its
        force times violation, and what it carries beside at most that force times violation
        (MuJoCo's documentation, Computation > Constraint model).
        """
        data = self._data
        assert data is not None
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
        return float(energies.sum()), float(energies[data.efc_type < _FIRST_OF_CONTACTS].sum())


def _fields(models: Sequence[mujoco.MjModel]) -> list[str]:
    models = [*{id(model): model for model in models}.values()]
    if any(model.opt.integrator == _RK4 for model in models) or all(map(is_conservative, models)):
        return []
    fields = ["qfrc_constraint"]
    if models[0].nu:
        fields.append("qfrc_actuator")
        if any(model.opt.integrator in _IMPLICIT for model in models):
            fields += _OF_ACTUATORS
    if any(map(has_others, models)):
        fields += _FORCES_OF_OTHERS
    return fields


def _conveys(model: mujoco.MjModel) -> bool:
    """Return whether contacts may do work that surfaces or adhesion put into them."""
    adheres = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_BODY).any()
    return has_moving_surfaces(model) or bool(adheres)


def _couples_branches(model: mujoco.MjModel) -> bool:
    """Return whether velocity feedback between branches is left out, as implicitfast does."""
    if model.opt.integrator not in {_FAST, _DISCRETE}:
        return False
    feeds = model.actuator_biasprm[:, 2] != 0
    return bool((feeds & ~np.isin(model.actuator_trntype, AT_JOINT)).any())


def _work(model: mujoco.MjModel, velocity: Floats, forces: dict[str, Floats]) -> Floats:
    """Return (N, 3) the work in each step; velocity (N + 1, nv)."""
    step = model.opt.timestep * (velocity[1:] + velocity[:-1]) / 2
    work = np.zeros((len(step), 3))
    work[:, CONSTRAINTS] = _dot(step, forces["qfrc_constraint"])
    if model.nu:
        work[:, ACTUATORS] = _dot(step, forces["qfrc_actuator"])
        if model.opt.integrator in _IMPLICIT:
            work[:, ACTUATORS] += _implicit_feedback(
                model, *(forces[actuator] for actuator in _OF_ACTUATORS)
            )
    if _FORCES_OF_OTHERS[0] in forces:
        smooth, bias, spring, damper, fluid = (forces[name] for name in _FORCES_OF_OTHERS)
        others = smooth + bias - spring
        if model.nu:
            others -= forces["qfrc_actuator"]
        implicit = model.opt.integrator in _IMPLICIT
        if implicit or not model.opt.disableflags & _EULER_IS_EXPLICIT:
            others += _change(damper + fluid if implicit else damper)
        work[:, OTHERS] = _dot(step, others)
    return work


def _dot(step: Floats, force: Floats) -> Floats:
    return np.einsum("ij,ij->i", step, force)


def _change(force: Floats) -> Floats:
    """Return how something changes over each step; it is not known over the last one."""
    return np.diff(force, axis=0, append=force[-1:])


def _implicit_feedback(model: mujoco.MjModel, speed: Floats, force: Floats) -> Floats:
    """Return (N,) work that velocity feedback within force limits does by speeds after a step."""
    change = _change(speed)
    low, high = model.actuator_forcerange.T
    free = ~model.actuator_forcelimited.astype(bool) | ((force > low) & (force < high))
    feedback = free * (speed + change / 2) * change
    return model.opt.timestep * feedback @ model.actuator_biasprm[:, 2]


def _largest_rise(given: Floats, starts: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the first, one of `starts` (N,), and the last step in which most was given (N + 1)."""
    least = np.minimum.accumulate(np.where(starts, given[:-1], np.inf))
    last = int((given[1:] - least).argmax())
    return int(np.where(starts[: last + 1], given[: last + 1], np.inf).argmin()), last


def _rise(given: Floats, stretch: tuple[int, int]) -> float:
    first, last = stretch
    return float(given[last + 1] - given[first])


def _forces_at_rest(model: mujoco.MjModel, data: mujoco.MjData, others: Floats) -> Floats:
    """Return (nefc,) forces of constraints if nothing moved, and others accelerated like that."""
    data.qvel[:] = 0
    mujoco.mj_fwdVelocity(model, data)
    data.qacc_smooth[:] = others
    mujoco.mj_mulM(model, data, data.qfrc_smooth, others)
    mujoco.mj_fwdConstraint(model, data)
    return np.abs(data.efc_force)
