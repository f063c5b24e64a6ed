"""MuJoCo's second, untimed pass over runs, for checks beyond the recorded arrays."""

import copy
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import (
    BY_RUN,
    DISTANCE,
    FORCE,
    FOUND,
    SLOT_WIDTH,
    BackwardError,
    Floats,
    SelfChecks,
    Trace,
)
from contactlab.engines.engine import (
    BackwardErrorFunction,
    PreparedRuns,
    Proceed,
    proceed_always,
)
from contactlab.engines.mujoco_batch import driven_inputs, start_batch
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.contact_pairs import colliding_geoms
from contactlab.scene.equation_error import measure_equation_error
from contactlab.scene.initial_states import InitialStates, apply_inputs
from contactlab.scene.model_edits import read_flag
from contactlab.scene.run_setup import lighter_mass

_MEMORY_WARNINGS = mujoco.mjtWarning.mjWARN_CONTACTFULL, mujoco.mjtWarning.mjWARN_CNSTRFULL
_WHOLE_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_DENSE_JACOBIAN = int(mujoco.mjtJacobian.mjJAC_DENSE)
_SPARSE_JACOBIAN = int(mujoco.mjtJacobian.mjJAC_SPARSE)
# Until 3.3.6 one flag was for springs and dampers.
_SPRING_FLAG = "SPRING" if hasattr(mujoco.mjtDisableBit, "mjDSBL_SPRING") else "PASSIVE"
_ALL_EXCEPT_CONTACTS = sum(
    int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    for flag in ("ACTUATION", "EQUALITY", "FRICTIONLOSS", "GRAVITY", "LIMIT", _SPRING_FLAG)
)
_FIELD_SHAPES = (int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_SDF))


def run_checks(
    runs: PreparedRuns,
    trace: Trace,
    proceed: Proceed = proceed_always,
    judge: BackwardErrorFunction | None = None,
) -> SelfChecks:
    """Return the self-checks of completed runs; see `ChecksRuns.check_runs`."""
    steps = trace.steps
    geometry_samples = 128  # evenly spread: a wrong distance lasts for many steps
    geometry_steps = np.linspace(0, steps - 1, min(steps, geometry_samples)).astype(np.intp)
    check_rows, backward = list[tuple[Any, ...]](), list[BackwardError]()
    # Forces and accelerations below this share of the run's largest may be rounding.
    min_share_of_largest = 1e-3
    # Complete each run before the next one, so that its time limit covers nothing else.
    for run, model in enumerate(runs.models):
        if run and not proceed():
            break
        states, again = _roll_out_again(model, runs.starts.select_run(run), trace.steps)
        geometry = _distance_errors(runs.base, model, trace, run, geometry_steps)
        squeeze = _squeeze_forces(runs.base, model, trace.qpos[run, -1])
        parts = trace.time[run][:, None], trace.qpos[run], trace.qvel[run]
        first = np.concatenate(parts, axis=1)[1:]
        repeats = bool((first == states[1:, : first.shape[1]]).all())
        gap = again["solver_fwdinv"][:, 1]
        # Noslip intentionally changes forces after the solver.
        gap = np.full(len(gap), np.nan) if model.opt.noslip_iterations else gap
        force = np.linalg.norm(again["qfrc_constraint"], axis=1)
        weight = np.linalg.norm(model.opt.gravity) * np.linalg.norm(model.dof_M0)
        floor = max(min_share_of_largest * weight, np.finfo(float).tiny)
        least = max(min_share_of_largest * force.max(initial=0), floor)
        residual = gap / np.maximum(force, least)
        jacobian = _jacobian_errors(model, trace, runs.starts, run, gap / np.maximum(force, floor))
        check_rows.append((residual, *jacobian, *geometry, squeeze, repeats))
        if judge is not None:
            backward.append(judge(runs, run, states))
    return SelfChecks(
        backward=tuple(backward),
        geometry_steps=geometry_steps,
        **dict(zip(BY_RUN, map(np.array, zip(*check_rows, strict=True)), strict=True)),
    )


def _roll_out_again(
    model: mujoco.MjModel, start: InitialStates, steps: int
) -> tuple[Floats, dict[Any, Floats]]:
    """Roll a run out a second time.

    Returns:
        (N + 1, nstate) states of mjSTATE_INTEGRATION, before each step and after the last.
        fwdinv residuals and constraint forces of each step, by field.
    """
    # The second run measures nothing as it steps.
    checked = copy.copy(model)
    checked.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    checked.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_FWDINV)
    batch = start_batch([checked], start)
    states = np.empty((steps + 1, batch.state.shape[1]))
    states[0] = batch.state[0]
    fields: dict[Any, Floats] = {
        _WHOLE_STATE: states[None, 1:],
        "solver_fwdinv": np.empty((1, steps, 2)),
        "qfrc_constraint": np.empty((1, steps, model.nv)),
    }
    batch.rollout(steps, record=list(fields), out=fields, **driven_inputs(checked, start, 0, steps))
    return states, {field: array[0] for field, array in fields.items()}


def _jacobian_errors(
    model: mujoco.MjModel, trace: Trace, starts: InitialStates, run: int, residual: Floats
) -> tuple[NDArray[np.intp], Floats]:
    """Return the (K,) steps with the largest of (N,) residuals, and the parts left by the Jacobian.

    A part is the residual if the form of the Jacobian that the run uses does not solve the equation
    of motion and the other form does; 0 if the run's form does; and NaN if the other form does not
    either, or overflows. All solutions together take at most as many iterations as the run.
    """
    jacobian_samples = 4  # steps of a run, those with the largest residuals
    worst = np.argsort(-np.nan_to_num(residual, nan=np.inf), kind="stable")[:jacobian_samples]
    errors = np.zeros(len(worst))
    iterations = int(trace.iterations[run].sum()) // max(2 * len(worst), 1)
    acting = starts.input_rows(run, model.opt.timestep, worst)
    own_form, other_form = _DENSE_JACOBIAN, _SPARSE_JACOBIAN
    if mujoco.mj_isSparse(model):
        own_form, other_form = other_form, own_form

    def solve_step(form: int, inputs: Floats, step: int) -> tuple[float, bool]:
        solved = copy.copy(model)
        # To rounding; a solver that needs more iterations is stuck.
        solved.opt.jacobian, solved.opt.tolerance = form, 1e-12
        solved.opt.iterations = min(iterations, 1000)
        solved.opt.noslip_iterations = 0
        data = mujoco.MjData(solved)
        apply_inputs(solved, data, inputs)
        data.qpos[:], data.qvel[:] = trace.qpos[run, step], trace.qvel[run, step]
        mujoco.mj_forward(solved, data)
        full = any(data.warning[kind].number for kind in _MEMORY_WARNINGS)
        return measure_equation_error(solved, data), full

    negligible_residual = 0.01  # a tenth of the tolerance: such steps are not solved again
    # Residual of a solved equation of motion; wrong factors leave 1e-2 or more, right ones 1e-12.
    most_left = 1e-6
    for place, (step, inputs) in enumerate(zip(worst.tolist(), acting, strict=True)):
        if residual[step] <= negligible_residual:
            continue
        error_left, _ = solve_step(own_form, inputs, step)
        if error_left <= most_left:
            continue
        others, full = solve_step(other_form, inputs, step)
        decided = others <= most_left and not full
        known_error = error_left if np.isnan(residual[step]) else residual[step]
        errors[place] = known_error if decided else np.nan
    return worst, errors


def _distance_errors(
    base: CompiledScene, model: mujoco.MjModel, trace: Trace, run: int, steps: NDArray[np.intp]
) -> tuple[Floats, Floats]:
    """Return (L,) overlaps without contact [m], and distances beyond those of contacts [m]."""
    data = mujoco.MjData(model)
    overlap, apart = np.zeros(len(steps)), np.zeros(len(steps))
    if not read_flag(model, "contact"):
        return overlap, apart
    speculative = read_flag(model, "speculative")
    # Effects that are left out as unused would also change the function that measures distances.
    model = copy.copy(model)
    native_ccd = int(getattr(mujoco.mjtDisableBit, "mjDSBL_NATIVECCD", 0))
    model.opt.disableflags &= ~native_ccd | base.model.opt.disableflags
    fields = np.flatnonzero(np.isin(model.geom_type, _FIELD_SHAPES))
    monitored = [
        (np.array(geoms), pair_trace.slots[run, steps])
        for geoms, pair_trace in zip(colliding_geoms(model, base.pairs), trace.pairs, strict=True)
        if geoms and not np.isin(geoms, fields).any()
    ]
    if not monitored:
        return overlap, apart
    slots = [pair_slots for _, pair_slots in monitored]
    touching = np.array([each[..., FOUND].any(axis=1) for each in slots])
    # Contacts in a gap zone carry nothing, whatever their distance.
    bearing = np.array([(each[..., FORCE.start] > 0).any(axis=1) for each in slots])
    bearing &= not speculative
    every = np.concatenate([geoms for geoms, _ in monitored])
    begins = np.cumsum([0, *(len(geoms) for geoms, _ in monitored)])
    radii = model.geom_rbound[every]
    reach = np.where(radii.all(axis=1), radii.sum(axis=1), np.inf) ** 2
    for sample, step in enumerate(steps):
        data.qpos[:] = trace.qpos[run, step]
        mujoco.mj_kinematics(model, data)
        between = data.geom_xpos[every[:, 0]] - data.geom_xpos[every[:, 1]]
        gaps = np.einsum("ij,ij->i", between, between) - reach
        near = np.minimum.reduceat(gaps, begins[:-1]) <= 0
        touches = touching[:, sample]
        for pair in np.flatnonzero(np.where(touches, bearing[:, sample], near)).tolist():
            geoms, gap = monitored[pair][0], gaps[begins[pair] : begins[pair + 1]]
            order = np.argsort(gap, kind="stable")
            # This function shares no code with contacts.
            distances = (
                mujoco.mj_geomDistance(model, data, first, second, 1, None)
                for first, second in geoms[order if touches[pair] else gap <= 0].tolist()
            )
            if not touches[pair]:
                overlap[sample] = max(overlap[sample], -min(distances))
                continue
            # One overlap explains the contact; geoms that are near come first.
            least = 1.0
            while least > 0 and (distance := next(distances, None)) is not None:
                least = min(least, distance)
            if least > 0:
                recorded = slots[pair][sample]
                recorded = recorded[recorded[:, FORCE.start] > 0, DISTANCE].min()
                apart[sample] = max(apart[sample], least - recorded)
    return overlap, apart


def _squeeze_forces(base: CompiledScene, model: mujoco.MjModel, qpos: Floats) -> Floats:
    """Return (P,) the force of each monitored pair [N] after only contacts have acted for a while.

    NaN if the force could move nothing: contacts at a hinge press its bearing, not their bodies.
    """
    alone = copy.copy(model)
    alone.opt.disableflags |= _ALL_EXCEPT_CONTACTS
    data = mujoco.MjData(alone)
    data.qpos[:] = qpos
    relaxing_steps = 200  # enough steps to separate bodies that only loads press together
    mujoco.mj_step(alone, data, nstep=relaxing_steps)
    slots = (
        data.sensordata[address : address + pair.slots * SLOT_WIDTH].reshape(-1, SLOT_WIDTH)
        for pair, address in zip(base.pairs, base.layout.pairs, strict=True)
    )
    carried = np.array([slot[:, FORCE.start].sum() for slot in slots])
    owners = data.contact.geom[data.efc_id] if data.ncon else np.zeros((0, 2))
    # Smallest ratio of the lighter mass to the effective mass of a contact; 3 at a rod's end.
    min_mass_ratio = 0.01
    for index in np.flatnonzero(carried).tolist():
        pair, generalized, moved = base.pairs[index], np.zeros(model.nv), np.zeros((1, model.nv))
        own = np.isin(owners, [geom for side in pair.geoms for geom in side]).all(axis=1)
        mujoco.mj_mulJacTVec(alone, data, generalized, data.efc_force * own)
        mujoco.mj_solveM(alone, data, moved, generalized[None])
        mass = lighter_mass(model, pair)
        if mass * float(moved[0] @ generalized) < min_mass_ratio * carried[index] ** 2:
            carried[index] = np.nan
    return carried
