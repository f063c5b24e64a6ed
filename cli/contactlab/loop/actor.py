"""Actors of an episode: a policy at its rate, or actions drawn with the seed of the run."""

import copy
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from contactlab.accuracy.reference import PlannedModel
from contactlab.engines.engine import Policy, PolicyClass
from contactlab.schema.drive import PolicyDrive

Act = Callable[[Any], Any]
"""Returns an action, given what the environment observed last."""
_USUAL_RATE = PolicyDrive.model_fields["rate"].default
_SNAP = 1e-6  # a time so little before that of a call, in periods, is that of the call


class FailureError(Exception):
    """An episode cannot be what its run asks for; the message says why."""


def actor_of(
    env: Any,  # noqa: ANN401 - any environment
    policy: PolicyClass | None,
    plan: PlannedModel,
    model: mujoco.MjModel,
    data: mujoco.MjData,
) -> Act:
    """Return what acts in the episode of a run that begins now; a FailureError if nothing can."""
    if policy is not None:
        assert isinstance(plan.run.drive, PolicyDrive)
        return _policy_actor(policy(copy.copy(model)), plan.run.drive.rate, data)
    space: Any = getattr(env, "action_space", None)
    if not (hasattr(space, "seed") and hasattr(space, "sample")):
        raise FailureError(
            "the environment has no action_space with seed() and sample(); give the sweep a "
            "`drive: {policy: FILE.py:CLASS}`"
        )
    space.seed(plan.run.seed)
    return lambda _: space.sample()


def _policy_actor(policy: Any, rate: float, data: mujoco.MjData) -> Act:  # noqa: ANN401 - code
    """Return a policy that acts on each observation, or else on the state at its rate."""
    if not hasattr(policy, "act"):
        return _StateActor(policy, rate, data)
    if rate != _USUAL_RATE:
        raise FailureError(
            "a policy with act() acts in each step of the environment: leave out rate"
        )
    return policy.act


class _StateActor:
    """Asks a policy at its rate what it does in a state; its action stays until the next one."""

    def __init__(self, policy: Policy, rate: float, data: mujoco.MjData) -> None:
        self._policy, self._rate, self._data, self._start = policy, rate, data, data.time
        self._calls, self._action = 0, None

    def __call__(self, _: object) -> Any:  # noqa: ANN401 - as environments take them
        time = self._data.time - self._start
        due = int(np.floor(time * self._rate + _SNAP)) + 1
        if due > self._calls + 1:
            raise FailureError(
                f"the policy is to act at {self._rate:g} Hz, but the environment asks for actions "
                f"at {self._calls / time:g} Hz; lower the rate of the drive"
            )
        if due > self._calls:
            self._calls, self._action = due, self._asked(time)
        return self._action

    def _asked(self, time: float) -> Any:  # noqa: ANN401 - likewise
        data = self._data
        parts = (np.array(time), data.qpos, data.qvel, data.sensordata)
        returned = np.asarray(self._policy(*(part.copy()[None] for part in parts)))
        if returned.ndim == 0 or len(returned) != 1 or not np.isfinite(returned).all():
            raise FailureError(
                f"the policy returned {returned.tolist()} at {time:g} s; an action is one row "
                "of finite numbers"
            )
        return returned[0]
