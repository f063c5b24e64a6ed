"""Memory for rollouts, kept between calls: fresh pages would cost a tenth of a small run."""

from dataclasses import dataclass, field

import mujoco
import numpy as np

from contactlab.contact import Floats

_ISLANDS = 20


@dataclass(frozen=True)
class Arrays:
    """Where one call records; see `Rollout` for shapes."""

    state: Floats
    sensors: Floats
    iterations: np.ndarray


@dataclass
class Buffers:
    """One block of memory for each kind of record, grown to the largest call."""

    _floats: Floats = field(default_factory=lambda: np.empty(0))
    _integers: np.ndarray = field(default_factory=lambda: np.empty(0, np.int32))

    def arrays(self, model: mujoco.MjModel, runs: int, steps: int) -> Arrays:
        """Return arrays for n runs of N steps; they share memory with those of the last call."""
        width = 1 + model.nq + model.nv + model.na
        state, sensors = runs * (steps + 1) * width, runs * steps * model.nsensordata
        if len(self._floats) < state + sensors:
            self._floats = np.empty(state + sensors)
        if len(self._integers) < runs * steps * _ISLANDS:
            self._integers = np.empty(runs * steps * _ISLANDS, np.int32)
        return Arrays(
            state=self._floats[:state].reshape(runs, steps + 1, width),
            sensors=self._floats[state : state + sensors].reshape(runs, steps, model.nsensordata),
            iterations=self._integers[: runs * steps * _ISLANDS].reshape(runs, steps, _ISLANDS),
        )


def bytes_of_run(model: mujoco.MjModel, steps: int) -> int:
    """Return the memory that one run of N steps records into [bytes]."""
    width = 1 + model.nq + model.nv + model.na + model.nsensordata
    return 8 * width * (steps + 1) + 4 * _ISLANDS * steps
