"""Do policies succeed inside of their margins of rate and delay, and fail outside?

    python -m bench.loop_policies                           # two policies of a pole
    ROBOT_WHEELS=... python -m bench.loop_policies reach    # a scripted one of Meta-World

A linear policy and a network with a filter balance a pole. Episodes start from 20 random tilts; one
succeeds if the pole is upright for 20 s. Each border is tried 10 % inside and outside.

Meta-World's policy reaches for 20 random goals: at 80 Hz it moves a mocap body by a hundredth of
its action, and a weld pulls the hand. An episode of plain MuJoCo succeeds if the hand is within the
environment's 5 cm throughout its last 2 s, which a swinging hand is not.
"""

import importlib
import math
import os
import sys
from collections import deque
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
from tests.cart_pole import cart_pole

from contactlab.closed_loop.control_loop import INTEGRATION, ControlLoop, LoopRows, find_modes
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


METAWORLD = "metaworld/metaworld"
LOW, HIGH = np.array([-0.5, 0.4, 0.05]), np.array([0.5, 1.0, 0.5])  # of the mocap body [m]
GRIPPER = (0.0, -0.0)  # effort of the policy at both fingers
RATE = 80.0


class Reach:
    """Meta-World's own policy, and the environment's step from its action to the mocap body."""

    goal = np.array([-0.1, 0.8, 0.2])

    def __init__(self, model: mujoco.MjModel) -> None:
        """Load the policy without the package around it, which needs Gymnasium."""
        package = ModuleType("metaworld")
        package.__path__ = [str(Path(os.environ["ROBOT_WHEELS"]) / METAWORLD)]
        sys.modules.setdefault("metaworld", package)
        module: Any = importlib.import_module("metaworld.policies.sawyer_reach_v3_policy")
        self._script = module.SawyerReachV3Policy()
        self._model, self._hand = model, int(model.body("hand").id)
        self._placed: Floats | None = None

    def __call__(self, *seen: Floats) -> Floats:
        """Return (n, 5): efforts of the fingers, and the position of the mocap body."""
        rows, data = len(seen[1]), mujoco.MjData(self._model)
        placed = np.empty((rows, 3)) if self._placed is None else self._placed.copy()
        for row, qpos in enumerate(seen[1]):
            data.qpos[:] = qpos
            mujoco.mj_kinematics(self._model, data)
            hand = data.xpos[self._hand]
            if self._placed is None:
                placed[row] = hand
            observed = np.concatenate([hand, np.zeros(33), self.goal])
            action = np.clip(self._script.get_action(observed)[:3], -1, 1)
            placed[row] = np.clip(placed[row] + 0.01 * action, LOW, HIGH)
        self._placed = placed
        return np.concatenate([np.broadcast_to(GRIPPER, (rows, 2)), placed], axis=1)


class ReachStudy(LoopStudy):
    """The study of a controller of increments, which is stronger if it is called more often."""

    @cached_property
    def natural_growth(self) -> float:
        """Growth of the loop as it is [1/s]."""
        return max(0.0, find_modes(self.loop, np.array(self.times))[0])


def open_reach() -> mujoco.MjModel:
    """Return the model of the environment, with the welds that it sets."""
    folder = Path(os.environ["ROBOT_WHEELS"]) / METAWORLD / "assets" / "sawyer_xyz"
    model = mujoco.MjModel.from_xml_path(str(folder / "sawyer_reach_v3.xml"))
    welds = np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_WELD)
    model.eq_data[welds, :11] = [0, 0, 0, 0, 0, 0, -1, 0, 0, 0, 5]
    return model


def reset_reach(model: mujoco.MjModel) -> mujoco.MjData:
    """Return the state after the environment's reset: the hand has moved to its first place."""
    data = mujoco.MjData(model)
    data.mocap_pos[0], data.mocap_quat[0] = (0.0, 0.6, 0.2), (1, 0, 1, 0)
    data.ctrl[:] = -1, 1
    mujoco.mj_step(model, data, 250)
    return data


def run_episode(model: mujoco.MjModel, rate: float, delay: float, goal: Floats) -> bool:
    """Return whether the hand comes to stay at a goal in 400 calls, or 40 s if that is longer."""
    data, policy = reset_reach(model), Reach(model)
    policy.goal = goal
    period, late = round(1 / rate / model.opt.timestep), round(delay / model.opt.timestep)
    wanted = np.concatenate([data.ctrl, data.mocap_pos[0]])
    waiting, far = deque[Floats]([wanted] * late), 0.0
    steps = round(max(400 / rate, 40.0) / model.opt.timestep)
    for step in range(steps):
        if step % period == 0:
            wanted = policy(np.zeros(1), data.qpos[None], data.qvel[None])[0]
        waiting.append(wanted)
        control = waiting.popleft()
        data.ctrl[:], data.mocap_pos[0] = control[:2], control[2:]
        mujoco.mj_step(model, data)
        if (steps - step) * model.opt.timestep <= 2:
            far = max(far, float(np.linalg.norm(data.body("hand").xpos - goal)))
    return far <= 0.05


def check_reach() -> None:
    """Print the margins of Meta-World's policy, and its successes on both sides."""
    model = open_reach()
    data = reset_reach(model)
    mujoco.mj_step(model, data, 4000)  # its elbow comes to rest, too
    Reach.goal = data.body("hand").xpos.copy()
    start = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, data, start, INTEGRATION)
    study = ReachStudy(ControlLoop(model, Reach, start, RATE, moves_mocap=True))
    goals = np.random.default_rng(0).uniform((-0.1, 0.8, 0.05), (0.1, 0.9, 0.3), (20, 3))
    for axis in study.list_axes():
        if axis.name not in ("rate", "delay"):
            continue
        linear = axis.find_border(study.holds_linear, None)
        border = axis.find_border(study.holds_simulated, linear)
        print(f"reach: {axis.name}: border {border} {axis.unit}, linear {linear}", flush=True)
        tried = [80.0, 10.0] if axis.name == "rate" else [0.0]
        if border is not None:
            tried = [share * border for share in (0.9, 1.1)]
        for value in tried:
            rate, delay = (value, 0.0) if axis.name == "rate" else (RATE, value)
            good = sum(run_episode(model, rate, delay, goal) for goal in goals)
            print(f"reach: {axis.name} {value:.4g}: {good} of 20 succeed", flush=True)


if __name__ == "__main__":
    if sys.argv[1:] == ["reach"]:
        check_reach()
    else:
        check_policy(LinearPolicy)
        check_policy(NetworkPolicy)
