"""A policy with LeRobot's interface, as contactlab calls policies: `reset`, then `select_action`.

    contactlab success push.py:make --drive lerobot_policy.py:Policy --allow-code

Let `load_policy` return `ACTPolicy.from_pretrained(...)` or another policy of LeRobot, and name the
observations as in its training.
"""

from typing import Any

import numpy as np


def load_policy() -> Any:  # noqa: ANN401 - of another package
    """Return a policy with `reset()` and `select_action(batch)`."""
    return Reaching()


class Policy:
    """Acts on each observation of an environment, as a policy of LeRobot does."""

    def __init__(self, model: Any) -> None:  # noqa: ANN401 - mujoco.MjModel
        del model
        self.policy = load_policy()
        self.policy.reset()  # forgets the actions that it planned in the last episode

    def act(self, observation: Any) -> np.ndarray:  # noqa: ANN401 - as the environment observes
        """Return the action for an observation."""
        batch = {"observation.state": as_batch(observation)}
        return np.asarray(self.policy.select_action(batch))[0]


def as_batch(values: Any) -> Any:  # noqa: ANN401 - an array, or a tensor
    """Return an observation as a batch of one; use `torch.as_tensor(...)[None]` for LeRobot."""
    return np.asarray(values, dtype=np.float32)[None]


class Reaching:
    """Stands for a trained policy: pushes in chunks of four actions."""

    def reset(self) -> None:
        """Forget planned actions."""
        self.planned: list[np.ndarray] = []

    def select_action(self, batch: dict[str, np.ndarray]) -> np.ndarray:
        """Return the next action of the chunk, (1, n)."""
        if not self.planned:
            distance = 0.4 - batch["observation.state"][:, :1]
            self.planned = [20 * distance] * 4
        return self.planned.pop()
