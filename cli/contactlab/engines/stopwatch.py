"""Time the stepping of one run, by the CPU time of this thread."""

import time
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.contact import Floats
from contactlab.engines.rollout import driven, start_batch
from contactlab.engines.stepping import Batch
from contactlab.scene import Starts

_INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_CLOCK_SAMPLES = 200
_WARM_STEPS = 10


@dataclass(frozen=True)
class Course:
    """What is timed: steps of one run, from states along it.

    Attributes:
        model: the model, without the sensors that record.
        start: where the run starts, n being 1; what drives it.
        places: (P,) steps before which the states stand.
        states: (P, nstate) the states.
        steps: steps of the whole run.
    """

    model: mujoco.MjModel
    start: Starts
    places: tuple[int, ...]
    states: Floats
    steps: int

    def lengths(self, most: int) -> list[int]:
        """Return how many steps to make from each place: up to the next, at most so many."""
        ends = (*self.places[1:], self.steps)
        return [min(most, end - place) for place, end in zip(self.places, ends, strict=True)]


def time_course(course: Course, most: int, repeats: int) -> tuple[float, int]:
    """Return the CPU time of stepping [s], and how many steps it took.

    Args:
        course: what to time.
        most: steps from each place.
        repeats: how often to go through all places.
    """
    batch = start_batch([course.model], course.start)
    lengths = course.lengths(most)
    # What comes first pays for memory that was never touched.
    _stretch(batch, course, 0, min(_WARM_STEPS, lengths[0]))
    seconds = sum(
        _stretch(batch, course, place, steps)
        for _ in range(repeats)
        for place, steps in enumerate(lengths)
    )
    return seconds, repeats * sum(lengths)


def time_steps(course: Course, most: int) -> Floats:
    """Return the CPU time of single steps [s], less what the clock itself takes.

    Args:
        course: what to time.
        most: steps from each place.
    """
    model, data = course.model, mujoco.MjData(course.model)
    clock = time.thread_time_ns
    own = np.median([-(clock() - clock()) for _ in range(_CLOCK_SAMPLES)])
    found: list[int] = []
    for place, state, length in zip(
        course.places, course.states, course.lengths(most), strict=True
    ):
        mujoco.mj_resetData(model, data)
        mujoco.mj_setState(model, data, state, _INTEGRATION)
        inputs = course.start.inputs(0, model.opt.timestep, place + np.arange(length))
        for row in inputs:
            data.ctrl[:], data.xfrc_applied.flat[:] = row[: model.nu], row[model.nu :]
            begin = clock()
            mujoco.mj_step(model, data)
            found.append(clock() - begin)
    return np.maximum(np.array(found, np.float64) - own, 0.0) * 1e-9


def _stretch(batch: Batch, course: Course, place: int, steps: int) -> float:
    inputs = driven(course.model, course.start, 0, steps, course.places[place])
    batch.state[0] = course.states[place]
    begin = time.thread_time()
    batch.rollout(steps, record=[], **inputs)
    return time.thread_time() - begin
