"""MuJoCo's second, untimed pass over runs, for what the recorded arrays cannot show."""

import copy
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import REFINEMENT, Floats, SelfChecks, Trace, motion_at_rest
from contactlab.engines.engine import Buffers, PreparedRuns, Proceed, proceed_always
from contactlab.engines.mujoco_batch import STATE, driven, record_starts, recorded, start_batch
from contactlab.engines.older_mujoco import SimulationError
from contactlab.engines.passages import Passages
from contactlab.engines.rollout_trace import make_trace
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.contact_pairs import colliding
from contactlab.scene.initial_states import InitialStates, apply_inputs

_JACOBIAN_SAMPLES = 16
_GEOMETRY_SAMPLES = 128
# Forces and accelerations below this share of the run's largest may be rounding.
_LEAST_SHARE = 1e-3
_TIGHT = 1e-12
_MOST_ITERATIONS = 1000
# How the solver of a refined copy is tightened, and how far off a perturbed one starts.
_FEWEST_ITERATIONS, _FEWEST_LINE_SEARCHES, _REFINED_TOLERANCE = 100, 50, 1e-10
_PERTURBATION = 1e-9
# Steps of a run that a copy is recorded through at once: finer rows are not kept.
_BLOCK = 256
_DENSE = int(mujoco.mjtJacobian.mjJAC_DENSE)
_SPARSE = int(mujoco.mjtJacobian.mjJAC_SPARSE)
_NATIVE_CCD = int(getattr(mujoco.mjtDisableBit, "mjDSBL_NATIVECCD", 0))
_FIELDS = (int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_SDF))


class _Rolled(NamedTuple):
    """How a rollout ended.

    Attributes:
        rest: (2, nv) motion at rest, by its own steps; NaN if it did not complete.
        travel: (nbody,) how far bodies are from their start [mean body sizes]; likewise.
        warnings: how often each was raised.
        error: why it failed.
    """

    rest: Floats
    travel: Floats
    warnings: np.ndarray
    error: str | None


class _Repetition(NamedTuple):
    """A second rollout: states after each step, fwdinv residuals, constraint forces, its end."""

    state: Floats
    gap: Floats
    force: Floats
    end: _Rolled


class _Copies:
    """The copies of runs, made run by run: where each ended, beside the run itself."""

    def __init__(self, runs: PreparedRuns) -> None:
        """Make room for them."""
        model, count = runs.models[0], len(runs.models)
        self._runs, self._arrays = runs, Buffers().arrays(model, count, runs.steps)
        record_starts(runs.starts, self._arrays)
        self._passages = Passages(model, count, runs.steps)
        self.ends: list[tuple[_Rolled, _Rolled, _Rolled]] = []

    def make(self, run: int, own: _Rolled) -> None:
        """Make the copies of the next run, given its own end."""
        model, start, arrays = self._runs.models[run], self._runs.starts.pick(run), self._arrays
        kept: dict[Any, np.ndarray] = {
            int(STATE): arrays.state[run, 1:],
            "sensordata": arrays.sensors[run],
            "solver_niter": arrays.iterations[run],
            **{name: rows[0] for name, rows in self._passages.poses.items()},
        }
        refined = _roll(_refined(model), start, self._runs.steps, kept, REFINEMENT)
        if not refined.error:
            velocities = slice(1 + model.nq, 1 + model.nq + model.nv)
            self._passages.enter(run, model, arrays.state[run, :, velocities])
        noise = np.random.default_rng(0).standard_normal(start.qvel.shape)
        nearby = start._replace(qvel=start.qvel + _PERTURBATION * noise)
        self.ends.append((own, refined, _roll(model, nearby, self._runs.steps, {})))

    def refined(self) -> Trace:
        """Return the refined copies, in the steps of their runs."""
        runs, count = self._runs, len(self.ends)
        warnings, errors = zip(
            *((each.warnings, each.error) for _, each, _ in self.ends), strict=True
        )
        rollout = recorded(self._arrays, np.full(count, np.nan), np.array(warnings), errors)
        rollout = replace(rollout, passages=tuple(self._passages.found[:count]))
        return make_trace(runs.base, runs.prepared[:count], rollout)


def run_checks(runs: PreparedRuns, trace: Trace, proceed: Proceed = proceed_always) -> SelfChecks:
    """Return the self-checks of runs that completed, as `ChecksRuns.check_runs` says."""
    models, starts = runs.models, runs.starts
    again, copies = list[_Repetition](), _Copies(runs)
    for run, model in enumerate(models):
        if run and not proceed():
            break
        again.append(_repeat(model, starts.pick(run), trace.steps))
        copies.make(run, again[run].end)
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
        refined=copies.refined(),
        rest=np.array([[each.rest for each in ends] for ends in copies.ends]),
        travel=np.array([[each.travel for each in ends] for ends in copies.ends]),
        bodies=tuple(models[0].body(each).name for each in range(models[0].nbody)),
    )


def _spread(steps: int, most: int) -> NDArray[np.intp]:
    return np.unique(np.linspace(0, steps - 1, min(steps, most)).astype(np.intp))


def _repeat(model: mujoco.MjModel, start: InitialStates, steps: int) -> _Repetition:
    checked = copy.copy(model)
    checked.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_FWDINV)
    state = np.empty((steps, 1 + model.nq + model.nv + model.na))
    gap, force = np.empty((steps, 2)), np.empty((steps, model.nv))
    kept = {int(STATE): state, "solver_fwdinv": gap, "qfrc_constraint": force}
    return _Repetition(state, gap, force, _roll(checked, start, steps, kept))


def _refined(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a model at a quarter of its step, with a solver that goes on until it is done."""
    refined, option = copy.copy(model), model.opt
    refined.opt.timestep = option.timestep / REFINEMENT
    refined.opt.iterations = max(option.iterations, _FEWEST_ITERATIONS)
    refined.opt.ls_iterations = max(option.ls_iterations, _FEWEST_LINE_SEARCHES)
    refined.opt.tolerance = min(option.tolerance, _REFINED_TOLERANCE)
    return refined


def _roll(
    model: mujoco.MjModel,
    start: InitialStates,
    steps: int,
    kept: Mapping[Any, np.ndarray],
    every: int = 1,
) -> _Rolled:
    """Step a model through a run of N steps, each `every` of its own; keep (N, ...) rows of it."""
    batch, late = start_batch([model], start), list[Floats]()
    rest, travel = np.full((2, model.nv), np.nan), np.full(model.nbody, np.nan)
    places, error = np.empty((0, model.nbody, 3)), None
    for begin in range(0, steps, _BLOCK):
        count = min(_BLOCK, steps - begin) * every
        inputs = driven(model, start, 0, count, begin * every)
        try:
            out = batch.rollout(count, record=list({"qvel", "xpos", *kept}), **inputs)
        except SimulationError:
            error = batch.error(0)
            break
        for name, rows in kept.items():
            # A state follows its step; all else belongs to the state before it.
            first = every - 1 if name == int(STATE) else 0
            rows[begin : begin + _BLOCK] = out[name][0, first::every]
        places = np.concatenate((places[:1], out["xpos"][0]))
        late.append(out["qvel"][0])
    if not error and not batch.warning.any():
        rest = motion_at_rest(np.concatenate(late))
        travel = np.linalg.norm(places[-1] - places[0], axis=1)
        travel /= max(model.stat.meansize, np.finfo(float).tiny)
    return _Rolled(rest, travel, batch.warning[0, :, 1], error)


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
    model = copy.copy(model)
    model.opt.disableflags &= ~_NATIVE_CCD | base.model.opt.disableflags
    collided = (
        (colliding(model, pair), made) for pair, made in zip(base.pairs, trace.pairs, strict=True)
    )
    fields = np.flatnonzero(np.isin(model.geom_type, _FIELDS))
    monitored = [each for each in collided if each[0] and not np.isin(each[0], fields).any()]
    for sample, step in enumerate(steps):
        data.qpos[:] = trace.qpos[run, step]
        mujoco.mj_kinematics(model, data)
        for geoms, traced in monitored:
            # A function that shares nothing with contacts.
            distance = min(mujoco.mj_geomDistance(model, data, *each, 1, None) for each in geoms)
            slots = traced.slots[run, step]
            touching = slots[:, 0] > 0
            if not touching.any():
                overlap[sample] = max(overlap[sample], -distance)
            elif distance > 0 and not speculative:
                apart[sample] = max(apart[sample], distance - slots[touching, 7].min())
    return overlap, apart


def _is_speculative(model: mujoco.MjModel) -> bool:
    bit = getattr(mujoco.mjtEnableBit, "mjENBL_SPECULATIVE", None)
    return bit is not None and bool(model.opt.enableflags & int(bit))


def _repeats(trace: Trace, run: int, again: Floats) -> bool:
    first = [trace.time[run][:, None], trace.qpos[run], trace.qvel[run]]
    columns = sum(part.shape[1] for part in first)
    return bool((np.concatenate(first, axis=1)[1:] == again[:, :columns]).all())
