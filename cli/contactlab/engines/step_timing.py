"""Count what a run takes of MuJoCo, and time its steps by the CPU time of this thread."""

import time

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import SEGMENTS, Segments, Watch, Work, no_limit
from contactlab.engines.mujoco_batch import Batch, driven, start_batch
from contactlab.engines.older_mujoco import SimulationError
from contactlab.scene.initial_states import InitialStates, apply_inputs

_INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_CLOCK_SAMPLES = 200
_WARM_STEPS = 10
_BLOCK = 1 << 14
_FIELDS = ("solver_niter", "ncon", "nefc")


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
        for done in range(begin, end, _BLOCK):
            watch()
            counted = _count(batch, model, start, range(done, min(done + _BLOCK, end)))
            if counted is None:
                return None
            counts += counted
    iterations, contacts, rows = counts.tolist()
    return Work(steps, iterations, contacts, rows, tuple(places), np.array(states))


def _count(
    batch: Batch, model: mujoco.MjModel, start: InitialStates, steps: range
) -> np.ndarray | None:
    inputs = driven(model, start, 0, len(steps), steps.start)
    try:
        out = batch.rollout(len(steps), record=list(_FIELDS), **inputs)
    except SimulationError:
        return None
    if batch.warning.any():
        return None
    # MuJoCo gives as many islands as it could need; there is at most one a tree.
    out["solver_niter"] = out["solver_niter"][..., : max(1, model.ntree)]
    return np.array([int(out[name].sum(dtype=np.int64)) for name in _FIELDS])


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
