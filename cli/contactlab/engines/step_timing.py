"""Count what a run takes of the engine, and time its steps by the CPU time of this thread."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact import Floats
from contactlab.engines.rollout import driven, start_batch
from contactlab.engines.stepping import Batch, SimulationError
from contactlab.scene import InitialStates

# States kept along a run, its start among them.
SEGMENTS = 8
_BLOCK = 1 << 14
_FIELDS = ("solver_niter", "ncon", "nefc")


class Work(NamedTuple):
    """What the engine did in all steps of a run.

    Attributes:
        steps: steps.
        iterations: solver iterations, summed over contact islands.
        contacts: contacts in the whole model.
        rows: constraint rows.
        places: (P,) steps before which states were kept.
        states: (P, nstate) these states, all that decides what follows.
    """

    steps: int
    iterations: int
    contacts: int
    rows: int
    places: tuple[int, ...]
    states: Floats


def count_work(
    model: mujoco.MjModel,
    start: InitialStates,
    steps: int,
    watch: Callable[[], None] = lambda: None,
) -> Work | None:
    """Run once, untimed, and count; None if the run does not go through.

    Args:
        model: what to step.
        start: where it starts, n being 1.
        steps: how many to make.
        watch: called before each block of steps, to start its time limit.
    """
    batch = start_batch([model], start)
    places = np.unique(np.linspace(0, steps, SEGMENTS, endpoint=False).astype(int)).tolist()
    counts = np.zeros(len(_FIELDS), np.int64)
    states: list[Floats] = []
    for begin, end in zip(places, [*places[1:], steps], strict=True):
        states.append(np.array(batch.state[0]))
        for done in range(begin, end, _BLOCK):
            watch()
            found = _counted(batch, model, start, range(done, min(done + _BLOCK, end)))
            if found is None:
                return None
            counts += found
    iterations, contacts, rows = counts.tolist()
    return Work(steps, iterations, contacts, rows, tuple(places), np.array(states))


def _counted(
    batch: Batch, model: mujoco.MjModel, start: InitialStates, steps: range
) -> np.ndarray | None:
    inputs = driven(model, start, 0, len(steps), steps.start)
    try:
        out = batch.rollout(len(steps), record=list(_FIELDS), **inputs)
    except SimulationError:
        return None
    if batch.warning.any():
        return None
    # There are as many places as the engine could need, but at most one island a tree.
    out["solver_niter"] = out["solver_niter"][..., : max(1, model.ntree)]
    return np.array([int(out[name].sum(dtype=np.int64)) for name in _FIELDS])


_INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_CLOCK_SAMPLES = 200
_WARM_STEPS = 10


@dataclass(frozen=True)
class Segments:
    """What is timed: steps of one run, from states along it.

    Attributes:
        model: the model, without the sensors that record.
        start: where the run starts, n being 1; what drives it.
        places: (P,) steps before which the states stand.
        states: (P, nstate) the states.
        steps: steps of the whole run.
    """

    model: mujoco.MjModel
    start: InitialStates
    places: tuple[int, ...]
    states: Floats
    steps: int

    def lengths(self, most: int) -> list[int]:
        """Return how many steps to make from each place: up to the next, at most so many."""
        ends = (*self.places[1:], self.steps)
        return [min(most, end - place) for place, end in zip(self.places, ends, strict=True)]


def time_segments(segments: Segments, most: int, repeats: int) -> tuple[float, int]:
    """Return the CPU time of stepping [s], and how many steps it took.

    Args:
        segments: what to time.
        most: steps from each place.
        repeats: how often to go through all places.
    """
    batch = start_batch([segments.model], segments.start)
    lengths = segments.lengths(most)
    # What comes first pays for memory that was never touched.
    _time_segment(batch, segments, 0, min(_WARM_STEPS, lengths[0]))
    seconds = sum(
        _time_segment(batch, segments, place, steps)
        for _ in range(repeats)
        for place, steps in enumerate(lengths)
    )
    return seconds, repeats * sum(lengths)


def time_steps(segments: Segments, most: int) -> Floats:
    """Return the CPU time of single steps [s], less what the clock itself takes.

    Args:
        segments: what to time.
        most: steps from each place.
    """
    model, data = segments.model, mujoco.MjData(segments.model)
    clock = time.thread_time_ns
    own = np.median([-(clock() - clock()) for _ in range(_CLOCK_SAMPLES)])
    found: list[int] = []
    for place, state, length in zip(
        segments.places, segments.states, segments.lengths(most), strict=True
    ):
        mujoco.mj_resetData(model, data)
        mujoco.mj_setState(model, data, state, _INTEGRATION)
        inputs = segments.start.inputs(0, model.opt.timestep, place + np.arange(length))
        for row in inputs:
            data.ctrl[:], data.xfrc_applied.flat[:] = row[: model.nu], row[model.nu :]
            begin = clock()
            mujoco.mj_step(model, data)
            found.append(clock() - begin)
    return np.maximum(np.array(found, np.float64) - own, 0.0) * 1e-9


def _time_segment(batch: Batch, segments: Segments, place: int, steps: int) -> float:
    inputs = driven(segments.model, segments.start, 0, steps, segments.places[place])
    batch.state[0] = segments.states[place]
    begin = time.thread_time()
    batch.rollout(steps, record=[], **inputs)
    return time.thread_time() - begin
