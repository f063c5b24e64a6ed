"""MuJoCo's second, untimed pass over runs, for what the recorded arrays cannot show."""

import copy
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats, SelfChecks, Trace
from contactlab.engines.engine import PreparedRuns, Proceed, proceed_always
from contactlab.engines.mujoco_batch import STATE, driven, start_batch
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.contact_pairs import colliding
from contactlab.scene.initial_states import InitialStates, apply_inputs

_JACOBIAN_SAMPLES = 16
_GEOMETRY_SAMPLES = 128
# Forces and accelerations below this share of the run's largest may be rounding.
_LEAST_SHARE = 1e-3
_TIGHT = 1e-12
_MOST_ITERATIONS = 1000
_DENSE = int(mujoco.mjtJacobian.mjJAC_DENSE)
_SPARSE = int(mujoco.mjtJacobian.mjJAC_SPARSE)
_NATIVE_CCD = int(getattr(mujoco.mjtDisableBit, "mjDSBL_NATIVECCD", 0))
_FIELDS = (int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_SDF))


class _Repetition(NamedTuple):
    """A second rollout: states after each step, fwdinv residuals, constraint forces."""

    state: Floats
    gap: Floats
    force: Floats


def run_checks(runs: PreparedRuns, trace: Trace, proceed: Proceed = proceed_always) -> SelfChecks:
    """Return the self-checks of runs that completed, as `ChecksRuns.check_runs` says."""
    models, starts = runs.models, runs.starts
    again = list[_Repetition]()
    for run, model in enumerate(models):
        if run and not proceed():
            break
        again.append(_repeat(model, starts.pick(run), trace.steps))
    jacobian_steps = _spread(trace.steps, _JACOBIAN_SAMPLES)
    geometry_steps = _spread(trace.steps, _GEOMETRY_SAMPLES)
    states = range(len(again))
    jacobian = [_jacobian(models[run], trace, starts, run, jacobian_steps) for run in states]
    geometry = [_geometry(runs.base, models[run], trace, run, geometry_steps) for run in states]
    return SelfChecks(
        residual=np.array([_residual(models[run], again[run]) for run in states]),
        jacobian=np.array(jacobian),
        jacobian_steps=jacobian_steps,
        overlap=np.array([overlap for overlap, _ in geometry]),
        apart=np.array([apart for _, apart in geometry]),
        geometry_steps=geometry_steps,
        repeats=np.array([_repeats(trace, run, again[run].state) for run in states]),
    )


def _spread(steps: int, most: int) -> NDArray[np.intp]:
    return np.unique(np.linspace(0, steps - 1, min(steps, most)).astype(np.intp))


def _repeat(model: mujoco.MjModel, start: InitialStates, steps: int) -> _Repetition:
    checked = copy.copy(model)
    checked.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_FWDINV)
    fields = [int(STATE), "solver_fwdinv", "qfrc_constraint"]
    out = start_batch([checked], start).rollout(
        steps, record=fields, **driven(checked, start, 0, steps)
    )
    return _Repetition(*(out[field][0] for field in fields))


def _residual(model: mujoco.MjModel, again: _Repetition) -> Floats:
    """Return (N,) how far forward and inverse dynamics disagree, as a share of the forces.

    NaN with noslip, which changes forces after the solver on purpose.
    """
    gap = again.gap[:, 1]
    if model.opt.noslip_iterations:
        return np.full(len(gap), np.nan)
    force = np.linalg.norm(again.force, axis=1)
    return gap / np.maximum(force, max(_LEAST_SHARE * force.max(initial=0), np.finfo(float).tiny))


def _jacobian(
    model: mujoco.MjModel, trace: Trace, starts: InitialStates, run: int, steps: NDArray[np.intp]
) -> Floats:
    """Return (K,) how far accelerations with a dense and a sparse Jacobian differ, as ratios."""
    dense, sparse = (
        _accelerations(model, kind, trace, starts, run, steps) for kind in (_DENSE, _SPARSE)
    )
    size = np.abs(dense).max(axis=(1, 2), initial=0)
    # Near rest, or without gravity, an acceleration may be rounding alone.
    scale = np.maximum(size, max(_LEAST_SHARE * size.max(initial=0), np.finfo(float).tiny))
    return np.abs(dense[:, 0] - sparse[:, 0]).max(axis=1, initial=0) / scale


def _accelerations(
    model: mujoco.MjModel,
    kind: int,
    trace: Trace,
    starts: InitialStates,
    run: int,
    steps: NDArray[np.intp],
) -> Floats:
    """Return (K, 2, nv) accelerations with and without constraints, from a cold start."""
    model = copy.copy(model)
    model.opt.jacobian = kind
    model.opt.tolerance = _TIGHT
    model.opt.iterations = _MOST_ITERATIONS
    data = mujoco.MjData(model)
    accelerations: list[Floats] = []
    acting = starts.inputs(run, model.opt.timestep, steps)
    for step, inputs in zip(steps, acting, strict=True):
        apply_inputs(model, data, inputs)
        data.qpos[:], data.qvel[:] = trace.qpos[run, step], trace.qvel[run, step]
        data.qacc_warmstart[:] = 0
        mujoco.mj_forward(model, data)
        accelerations.append(np.stack((data.qacc, data.qacc_smooth)))
    return np.array(accelerations)


def _geometry(
    base: CompiledScene, model: mujoco.MjModel, trace: Trace, run: int, steps: NDArray[np.intp]
) -> tuple[Floats, Floats]:
    """Return (L,) overlaps without contact [m], and distances beyond those of contacts [m]."""
    data = mujoco.MjData(model)
    overlap, apart = np.zeros(len(steps)), np.zeros(len(steps))
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT):
        return overlap, apart
    speculative = _is_speculative(model)
    # Effects that are off where nothing needs them take the function that measures distances along.
    own = base.model.opt.disableflags & _NATIVE_CCD
    model = copy.copy(model)
    model.opt.disableflags = model.opt.disableflags & ~_NATIVE_CCD | own
    collided = (
        (colliding(model, pair), made) for pair, made in zip(base.pairs, trace.pairs, strict=True)
    )
    monitored = [each for each in collided if each[0] and not _has_fields(model, each[0])]
    for sample, step in enumerate(steps):
        data.qpos[:] = trace.qpos[run, step]
        mujoco.mj_kinematics(model, data)
        for geoms, recorded in monitored:
            distance = _distance(model, data, geoms)
            slots = recorded.slots[run, step]
            touching = slots[:, 0] > 0
            if not touching.any():
                overlap[sample] = max(overlap[sample], -distance)
            elif distance > 0 and not speculative:
                apart[sample] = max(apart[sample], distance - slots[touching, 7].min())
    return overlap, apart


def _has_fields(model: mujoco.MjModel, geoms: list[tuple[int, int]]) -> bool:
    """Return whether some geoms are height or distance fields, which have no convex distance."""
    return bool(np.isin(model.geom_type[np.array(geoms)], _FIELDS).any())


def _distance(model: mujoco.MjModel, data: mujoco.MjData, pairs: list[tuple[int, int]]) -> float:
    """Return the signed distance of geoms by a function that shares nothing with contacts."""
    return min(mujoco.mj_geomDistance(model, data, *pair, 1.0, None) for pair in pairs)


def _is_speculative(model: mujoco.MjModel) -> bool:
    bit = getattr(mujoco.mjtEnableBit, "mjENBL_SPECULATIVE", None)
    return bit is not None and bool(model.opt.enableflags & int(bit))


def _repeats(trace: Trace, run: int, again: Floats) -> bool:
    first = [trace.time[run][:, None], trace.qpos[run], trace.qvel[run]]
    columns = sum(part.shape[1] for part in first)
    return bool((np.concatenate(first, axis=1)[1:] == again[:, :columns]).all())
