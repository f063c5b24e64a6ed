"""One run alone, unrecorded: integrated over long times, its work counted, its steps timed.

Few states are kept, so that memory does not grow with the steps.
"""

import copy
import time

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import SEGMENTS, SampledStates, Segments, Watch, Work, no_limit
from contactlab.engines.mujoco_batch import STATE, Batch, driven_inputs, start_batch
from contactlab.engines.older_mujoco import SimulationError
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.initial_states import InitialStates, apply_inputs

_BLOCK_BYTES = 4 << 20
_INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_WORK_FIELDS = ("solver_niter", "ncon", "nefc")


def integrate_to(
    model: mujoco.MjModel,
    start: InitialStates,
    times: Floats,
    *,
    begin: float = 0.0,
    state: Floats | None = None,
    watch: Watch = no_limit,
) -> SampledStates | None:
    """Return a run's states at some times; see `SolvesReferences.integrate_to`.

    A time between two steps is reached by a shorter step from the one before, with the same
    integrator: unlike interpolation, this adds no error of a lower order.
    """
    timestep = float(model.opt.timestep)
    exact, first = (times - begin) / timestep, begin / timestep
    steps = np.floor(exact + COARSE_ROUNDING).astype(np.intp)
    rest = np.where(exact - steps > COARSE_ROUNDING, exact - steps, 0.0) * timestep
    batch = start_batch([model], start)
    parts = [batch.bind(name) for name in ("time", "qpos", "qvel", "act")]
    speed, activation = 1 + model.nq, 1 + model.nq + model.nv
    if state is not None:
        for part, own in zip(parts, np.split(state, [1, speed, activation]), strict=True):
            part[:] = own
    last, contacts = np.concatenate([part[0].ravel() for part in parts]), np.empty(0)
    states, impacts = np.tile(last, (len(times), 1)), 0
    size = max(1, _BLOCK_BYTES // (8 * len(last)))
    for first_step in range(0, int(steps[-1]), size):
        watch()
        count = min(size, int(steps[-1]) - first_step)
        inputs = driven_inputs(model, start, 0, count, first + first_step)
        try:
            out = batch.rollout(count, record=[int(STATE), "ncon"], **inputs)
        except SimulationError:
            return None
        rows = out[int(STATE)][0]
        if (np.diff(rows[:, 0], prepend=last[0]) <= 0).any() or not np.isfinite(rows).all():
            return None
        is_here = (steps > first_step) & (steps <= first_step + count)
        states[is_here], last = rows[steps[is_here] - first_step - 1], rows[-1]
        contact_counts = np.concatenate([contacts, out["ncon"][0].ravel()])
        impacts, contacts = (
            impacts + int(np.count_nonzero(np.diff(contact_counts))),
            contact_counts[-1:],
        )
    # Continue after whole steps, for the rest of another one.
    steps = first + steps
    short, data = copy.copy(model), mujoco.MjData(model)
    for place in np.flatnonzero(rest):
        short.opt.timestep = rest[place]
        mujoco.mj_resetData(short, data)
        mujoco.mj_setState(short, data, states[place], int(STATE))
        acting = start.input_rows(0, model.opt.timestep, steps[[place]])
        apply_inputs(short, data, acting[0])
        mujoco.mj_step(short, data)
        mujoco.mj_getState(short, data, states[place], int(STATE))
    if not np.isfinite(states).all():
        return None
    return SampledStates(states, states[:, 1:speed], states[:, speed:activation], impacts)


def count_work(
    model: mujoco.MjModel, start: InitialStates, steps: int, watch: Watch = no_limit
) -> Work | None:
    """Simulate one run, untimed, and count its work; see `TimesSteps.count_work`."""
    batch = start_batch([model], start)
    places = np.unique(np.linspace(0, steps, SEGMENTS, endpoint=False).astype(int)).tolist()
    counts = np.zeros(len(_WORK_FIELDS), np.int64)
    states: list[Floats] = []
    block_steps = 1 << 14  # between two looks at the time limit
    for begin, end in zip(places, [*places[1:], steps], strict=True):
        states.append(np.array(batch.state[0]))
        for first_step in range(begin, end, block_steps):
            watch()
            block = min(block_steps, end - first_step)
            try:
                inputs = driven_inputs(model, start, 0, block, first_step)
                out = batch.rollout(block, record=list(_WORK_FIELDS), **inputs)
            except SimulationError:
                return None
            if batch.warning.any():
                return None
            # MuJoCo returns the largest possible number of islands; there is at most one per tree.
            out["solver_niter"] = out["solver_niter"][..., : max(1, model.ntree)]
            counts += [int(out[name].sum(dtype=np.int64)) for name in _WORK_FIELDS]
    iterations, contacts, rows = counts.tolist()
    return Work(steps, iterations, contacts, rows, tuple(places), np.array(states))


def time_segments(segments: Segments, most: int, repeats: int) -> tuple[float, int]:
    """Return the CPU time of stepping [s], and the steps; see `TimesSteps.time_segments`."""
    batch = start_batch([segments.model], segments.start)
    lengths = segments.lengths(most)
    warm_steps = 10  # the first steps are slow, because they touch new memory
    _time_segment(batch, segments, 0, min(warm_steps, lengths[0]))
    seconds = sum(
        _time_segment(batch, segments, place, steps)
        for _ in range(repeats)
        for place, steps in enumerate(lengths)
    )
    return seconds, repeats * sum(lengths)


def time_steps(segments: Segments, most: int) -> Floats:
    """Return the CPU time of single steps [s]; see `TimesSteps.time_steps`."""
    model, data = segments.model, mujoco.MjData(segments.model)
    clock = time.thread_time_ns
    clock_samples = 200  # of the time that reading the clock takes
    own = np.median([-(clock() - clock()) for _ in range(clock_samples)])
    times: list[int] = []
    for place, state, length in zip(
        segments.work.places, segments.work.states, segments.lengths(most), strict=True
    ):
        mujoco.mj_resetData(model, data)
        mujoco.mj_setState(model, data, state, _INTEGRATION)
        inputs = segments.start.input_rows(0, model.opt.timestep, place + np.arange(length))
        for row in inputs:
            apply_inputs(model, data, row)
            begin = clock()
            mujoco.mj_step(model, data)
            times.append(clock() - begin)
    return np.maximum(np.array(times, np.float64) - own, 0.0) * 1e-9


def _time_segment(batch: Batch, segments: Segments, place: int, steps: int) -> float:
    inputs = driven_inputs(segments.model, segments.start, 0, steps, segments.work.places[place])
    batch.state[0] = segments.work.states[place]
    begin = time.thread_time()
    batch.rollout(steps, record=[], **inputs)
    return time.thread_time() - begin
