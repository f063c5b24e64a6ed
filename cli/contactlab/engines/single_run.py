"""One run by itself, unrecorded: integrated for long, its work counted, its steps timed.

Few states are kept, so that memory does not grow with the steps.
"""

import copy
import time
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import SEGMENTS, SampledStates, Segments, Watch, Work, no_limit
from contactlab.engines.mujoco_batch import STATE, Batch, driven, start_batch
from contactlab.engines.older_mujoco import SimulationError
from contactlab.scene.initial_states import InitialStates, apply_inputs

_BLOCK_BYTES = 4 << 20
# A time within this fraction of a step of a step's end counts as that end.
_SNAP = 1e-6
_INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_CLOCK_SAMPLES = 200
_WARM_STEPS = 10
_BLOCK_STEPS = 1 << 14
_FIELDS = ("solver_niter", "ncon", "nefc")


class _Run(NamedTuple):
    """What is stepped; `first` is the number of steps up to where it starts."""

    model: mujoco.MjModel
    start: InitialStates
    first: float


class _Grid(NamedTuple):
    """Where times lie: after so many whole steps, and so much of another [s]."""

    steps: NDArray[np.intp]
    rest: Floats


def integrate_to(
    model: mujoco.MjModel,
    start: InitialStates,
    times: Floats,
    *,
    begin: float = 0.0,
    state: Floats | None = None,
    watch: Watch = no_limit,
) -> SampledStates | None:
    """Return a run's states at some times, as `SolvesReferences.integrate_to` says.

    A time between two steps is reached by a shorter step from the one before, with the same
    integrator: this adds no error of a lower order, as interpolation would.
    """
    timestep = float(model.opt.timestep)
    grid = _grid((times - begin) / timestep, timestep)
    run = _Run(model, start, begin / timestep)
    batch = start_batch([model], start)
    if state is not None:
        _set_state(batch, model, state)
    width = mujoco.mj_stateSize(model, int(STATE))
    states = np.empty((len(times), width))
    _fill(states, grid, 0, _state_of(batch)[None])
    size = max(1, _BLOCK_BYTES // (8 * width))
    impacts, contacts = 0, None
    for done in range(0, int(grid.steps[-1]), size):
        watch()
        block = _block(batch, run, range(done, min(done + size, int(grid.steps[-1]))))
        if block is None:
            return None
        rows, found = block
        _fill(states, grid, done + 1, rows)
        found = found if contacts is None else np.concatenate([[contacts], found])
        impacts, contacts = impacts + int(np.count_nonzero(np.diff(found))), found[-1]
    if not _finish(run, states, grid):
        return None
    end = 1 + model.nq
    return SampledStates(states, states[:, 1:end], states[:, end : end + model.nv], impacts)


def _grid(exact: Floats, timestep: float) -> _Grid:
    steps = np.floor(exact + _SNAP)
    rest = np.where(exact - steps > _SNAP, exact - steps, 0.0)
    return _Grid(steps.astype(np.intp), rest * timestep)


def _set_state(batch: Batch, model: mujoco.MjModel, state: Floats) -> None:
    ends = np.cumsum([1, model.nq, model.nv])
    parts = zip(("time", "qpos", "qvel", "act"), np.split(state, ends), strict=True)
    for name, part in parts:
        batch.bind(name)[:] = part


def _state_of(batch: Batch) -> Floats:
    parts = [batch.bind(name)[0].ravel() for name in ("time", "qpos", "qvel", "act")]
    return np.concatenate(parts)


def _block(batch: Batch, run: _Run, steps: range) -> tuple[Floats, np.ndarray] | None:
    """Return the states and contacts after each of some steps; None if MuJoCo stopped."""
    inputs = driven(run.model, run.start, 0, len(steps), run.first + steps.start)
    before = float(batch.bind("time")[0])
    try:
        out = batch.rollout(len(steps), record=[int(STATE), "ncon"], **inputs)
    except SimulationError:
        return None
    states = out[int(STATE)][0]
    clock = np.concatenate([[before], states[:, 0]])
    if (np.diff(clock) <= 0).any() or not np.isfinite(states).all():
        return None
    return states, out["ncon"][0].ravel()


def _fill(states: Floats, grid: _Grid, first: int, rows: Floats) -> None:
    """Keep the rows at which times lie; the first row is the state after `first` steps."""
    wanted = (grid.steps >= first) & (grid.steps < first + len(rows))
    states[wanted] = rows[grid.steps[wanted] - first]


def _finish(run: _Run, states: Floats, grid: _Grid) -> bool:
    """Where a time lies within a step, go there from the last whole step, in place."""
    model, timestep = copy.copy(run.model), float(run.model.opt.timestep)
    data = mujoco.MjData(model)
    for place in np.flatnonzero(grid.rest):
        model.opt.timestep = grid.rest[place]
        mujoco.mj_resetData(model, data)
        mujoco.mj_setState(model, data, states[place], int(STATE))
        step = np.array([run.first + grid.steps[place]])
        apply_inputs(model, data, run.start.inputs(0, timestep, step)[0])
        mujoco.mj_step(model, data)
        mujoco.mj_getState(model, data, states[place], int(STATE))
    return bool(np.isfinite(states).all())


def count_work(
    model: mujoco.MjModel, start: InitialStates, steps: int, watch: Watch = no_limit
) -> Work | None:
    """Simulate one run, untimed, and count, as `TimesSteps.count_work` says."""
    batch = start_batch([model], start)
    places = np.unique(np.linspace(0, steps, SEGMENTS, endpoint=False).astype(int)).tolist()
    counts = np.zeros(len(_FIELDS), np.int64)
    states: list[Floats] = []
    for begin, end in zip(places, [*places[1:], steps], strict=True):
        states.append(np.array(batch.state[0]))
        for done in range(begin, end, _BLOCK_STEPS):
            watch()
            block = min(_BLOCK_STEPS, end - done)
            try:
                inputs = driven(model, start, 0, block, done)
                out = batch.rollout(block, record=list(_FIELDS), **inputs)
            except SimulationError:
                return None
            if batch.warning.any():
                return None
            # MuJoCo gives as many islands as it could need; there is at most one a tree.
            out["solver_niter"] = out["solver_niter"][..., : max(1, model.ntree)]
            counts += [int(out[name].sum(dtype=np.int64)) for name in _FIELDS]
    iterations, contacts, rows = counts.tolist()
    return Work(steps, iterations, contacts, rows, tuple(places), np.array(states))


def time_segments(segments: Segments, most: int, repeats: int) -> tuple[float, int]:
    """Return the CPU time of stepping [s], and the steps, as `TimesSteps.time_segments` says."""
    batch = start_batch([segments.model], segments.start)
    lengths = segments.lengths(most)
    # The first steps pay for memory that was never touched.
    _time_segment(batch, segments, 0, min(_WARM_STEPS, lengths[0]))
    seconds = sum(
        _time_segment(batch, segments, place, steps)
        for _ in range(repeats)
        for place, steps in enumerate(lengths)
    )
    return seconds, repeats * sum(lengths)


def time_steps(segments: Segments, most: int) -> Floats:
    """Return the CPU time of single steps [s], as `TimesSteps.time_steps` says."""
    model, data = segments.model, mujoco.MjData(segments.model)
    clock = time.thread_time_ns
    own = np.median([-(clock() - clock()) for _ in range(_CLOCK_SAMPLES)])
    times: list[int] = []
    for place, state, length in zip(
        segments.places, segments.states, segments.lengths(most), strict=True
    ):
        mujoco.mj_resetData(model, data)
        mujoco.mj_setState(model, data, state, _INTEGRATION)
        inputs = segments.start.inputs(0, model.opt.timestep, place + np.arange(length))
        for row in inputs:
            apply_inputs(model, data, row)
            begin = clock()
            mujoco.mj_step(model, data)
            times.append(clock() - begin)
    return np.maximum(np.array(times, np.float64) - own, 0.0) * 1e-9


def _time_segment(batch: Batch, segments: Segments, place: int, steps: int) -> float:
    inputs = driven(segments.model, segments.start, 0, steps, segments.places[place])
    batch.state[0] = segments.states[place]
    begin = time.thread_time()
    batch.rollout(steps, record=[], **inputs)
    return time.thread_time() - begin
