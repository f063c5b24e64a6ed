"""Do policies succeed inside of their margins of rate and delay, and fail outside?

    python -m bench.loop_policies

A linear policy and a network with a filter balance a pole. Episodes start from 20 random tilts; one
succeeds if the pole is upright for 20 s. Each border is tried 10 % inside and outside.
"""

import math
from dataclasses import replace

import mujoco
import numpy as np
from tests.cart_pole import cart_pole

from contactlab.closed_loop.control_loop import INTEGRATION, ControlLoop, LoopRows
from contactlab.closed_loop.loop_margins import LoopStudy
from contactlab.contact.trace_arrays import Floats

GAINS = np.array([2.0, 50.0, 4.0, 8.0])  # of place, tilt and their velocities


class LinearPolicy:
    """The policy of the tutorial on driving."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Need nothing of the model."""
        del model

    def __call__(self, *seen: Floats) -> Floats:
        """Return (n, 1) forces."""
        return np.concatenate(seen[1:3], axis=1) @ GAINS[:, None]


class NetworkPolicy:
    """A network of 64 units, fitted to the linear policy within its force, after a filter."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Fit the network by ridge regression of its last layer."""
        random, limit = np.random.default_rng(0), float(model.actuator_ctrlrange[0, 1])
        self._scale = np.array([2.0, 0.3, 2.0, 2.0])
        self._first, self._bias = random.standard_normal((4, 64)), random.uniform(-2, 2, 64)
        samples = random.uniform(-1, 1, (8000, 4))
        wanted = limit * np.tanh((samples * self._scale) @ GAINS / limit)
        hidden = np.tanh(samples @ self._first + self._bias)
        hidden = np.concatenate([hidden, samples], axis=1)
        self._last = np.linalg.solve(hidden.T @ hidden + 1e-3 * np.eye(68), hidden.T @ wanted)
        self._filtered: Floats | None = None

    def __call__(self, *seen: Floats) -> Floats:
        """Return (n, 1) forces."""
        observed = np.concatenate(seen[1:3], axis=1) / self._scale
        known = observed if self._filtered is None else self._filtered
        self._filtered = 0.3 * known + 0.7 * observed
        hidden = np.tanh(self._filtered @ self._first + self._bias)
        return (np.concatenate([hidden, self._filtered], axis=1) @ self._last)[:, None]


def count_successes(loop: ControlLoop) -> int:
    """Return the number of 20 episodes in which the pole is upright in the last of 20 s."""
    rows = LoopRows(loop).repeat_row(20)
    tilts = np.random.default_rng(1).uniform(-0.03, 0.03, 20)
    for data, tilt in zip(rows.data, tilts, strict=True):
        data.qpos[1] = tilt
    seconds, worst = 20.0, np.zeros(20)
    for period in range(round(seconds * loop.rate)):
        rows.make_periods()
        if period > 0.9 * seconds * loop.rate:
            worst = np.maximum(worst, [abs(data.qpos[1]) for data in rows.data])
    return int((worst < 0.03).sum())


def check_policy(policy: type[LinearPolicy | NetworkPolicy]) -> None:
    """Print the margins of a policy, and its successes on both sides."""
    model = mujoco.MjModel.from_xml_string(cart_pole(0.002))
    start = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, mujoco.MjData(model), start, INTEGRATION)
    loop = ControlLoop(model, policy, start, 50.0)
    for margin in LoopStudy(loop).measure_margins().margins:
        border = margin.border
        if border is None or margin.name not in ("rate", "delay"):
            continue
        for share in (0.9, 1.1):
            # A delay is whole steps: at least one besides the border.
            step = math.copysign(loop.timestep, share - 1) if margin.name == "delay" else 0.0
            value = share * border + step * (margin.name == "delay")
            changed = replace(loop, **{{"rate": "rate", "delay": "latency"}[margin.name]: value})
            print(
                f"{policy.__name__}: {margin.name} up to a border of {border:.4g} {margin.unit}: "
                f"at {value:.4g} {count_successes(changed)} of 20 succeed",
                flush=True,
            )


if __name__ == "__main__":
    check_policy(LinearPolicy)
    check_policy(NetworkPolicy)
