"""A clock that counts work instead of time, so that searches which time models repeat.

The time of a step follows from the degrees of freedom, the rows of constraints, the iterations of
the solver and the stages of the integrator. A look at the clock takes a microsecond, and nothing
else takes time. So the same calls take the same time on any machine and under any load.
"""

import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import mujoco

LOOK = 1e-6  # s, so that a loop until some time ends
# Seconds of a step, about those of a core of 2020: by itself, for each degree of freedom, and for
# each row of a constraint in each iteration of the solver.
STEP, OF_DOF, OF_ROW = 5e-6, 2e-7, 1e-7


class CountedClock:
    """The time that counted work has taken [s].

    Looks of other threads, such as those of a test runner, do not advance it.
    """

    def __init__(self) -> None:
        self.now, self._thread = 0.0, threading.get_ident()

    def read(self) -> float:
        """Return the time, which a look advances."""
        self.now += LOOK if threading.get_ident() == self._thread else 0.0
        return self.now

    def read_ns(self) -> int:
        """Return the time in nanoseconds."""
        return round(1e9 * self.read())

    def add_steps(self, model: mujoco.MjModel, data: mujoco.MjData, count: int) -> None:
        """Add the time of steps that ended in a state."""
        iterations = 1 + int(data.solver_niter.sum())
        spent = STEP + OF_DOF * model.nv + OF_ROW * data.nefc * iterations
        self.now += count * _stages(model) * spent


def _stages(model: mujoco.MjModel) -> int:
    return 4 if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 else 1


@contextmanager
def counted_time() -> Generator[CountedClock]:
    """Have this process, which must have one thread, read the time off counted work."""
    from contactlab.engines.mujoco_batch import Batch  # noqa: PLC0415 - collection is quick without

    clock, step, rollout = CountedClock(), mujoco.mj_step, Batch.rollout

    def counted_step(model: mujoco.MjModel, data: mujoco.MjData, nstep: int = 1) -> None:
        step(model, data, nstep)
        clock.add_steps(model, data, nstep)

    def counted_rollout(self: Batch, steps: int, *args: Any, **given: Any) -> Any:
        runs = len(given["ids"]) if given.get("ids") is not None else self.nsim
        model = self.get_model(0)
        clock.now += runs * steps * _stages(model) * (STEP + OF_DOF * model.nv)
        return rollout(self, steps, *args, **given)

    with (
        patch.object(mujoco, "mj_step", counted_step),
        patch.object(Batch, "rollout", counted_rollout),
        patch.object(time, "monotonic", clock.read),
        patch.object(time, "process_time", clock.read),
        patch.object(time, "thread_time", clock.read),
        patch.object(time, "thread_time_ns", clock.read_ns),
    ):
        yield clock
