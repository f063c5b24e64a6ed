"""A policy of LeRobot, as contactlab calls policies.

    contactlab success push.py:make --drive lerobot_policy.py:Policy --allow-code

Put the folder of a checkpoint next to a copy of this file as `checkpoint`, and name the
observations as in its training. Without a checkpoint, a policy with the same interface pushes.
"""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

CHECKPOINT = Path(__file__).with_name("checkpoint")


class Policy:
    """Acts on each observation of an environment by `select_action` of a policy of LeRobot."""

    def __init__(self, model: Any) -> None:  # noqa: ANN401 - mujoco.MjModel
        del model
        is_trained = CHECKPOINT.is_dir()
        self.policy, self.preprocess, self.postprocess = (
            load_checkpoint(str(CHECKPOINT)) if is_trained else (Reaching(), add_batch, lambda a: a)
        )
        self.policy.reset()  # forgets the actions that it planned in the last episode

    def act(self, observation: Any) -> np.ndarray:  # noqa: ANN401 - as the environment observes
        """Return the action for an observation."""
        batch = self.preprocess(name_observations(observation))
        return np.asarray(self.postprocess(self.policy.select_action(batch)))[0]


def name_observations(observation: Any) -> dict[str, np.ndarray]:  # noqa: ANN401 - as above
    """Return an observation by its names in training; images are (3, height, width) of 0 to 1."""
    return {"observation.state": np.asarray(observation, np.float32)}


@cache
def load_checkpoint(path: str) -> tuple[Any, Any, Any]:
    """Return a trained policy on the CPU, and functions for its input and its output."""
    import torch  # noqa: PLC0415 - only with a checkpoint
    from lerobot.configs.policies import PreTrainedConfig  # noqa: PLC0415
    from lerobot.policies.factory import (  # noqa: PLC0415
        get_policy_class,
        make_pre_post_processors,
    )

    torch.set_num_threads(1)  # workers have a core each
    torch.manual_seed(0)
    config = PreTrainedConfig.from_pretrained(path)
    config.device = "cpu"
    policy = get_policy_class(config.type).from_pretrained(path, config=config).eval()
    on_cpu = {"device_processor": {"device": "cpu"}}
    before, after = make_pre_post_processors(config, path, preprocessor_overrides=on_cpu)

    def prepare_input(observation: dict[str, np.ndarray]) -> Any:  # noqa: ANN401 - of tensors
        return before({name: torch.from_numpy(value) for name, value in observation.items()})

    def prepare_output(action: Any) -> np.ndarray:  # noqa: ANN401 - a tensor
        return after(action).detach().numpy()

    return policy, prepare_input, prepare_output


def add_batch(observation: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return observations as batches of one."""
    return {name: value[None] for name, value in observation.items()}


class Reaching:
    """Stands for a trained policy: pushes in chunks of four actions."""

    def reset(self) -> None:
        """Forget planned actions."""
        self.planned: list[np.ndarray] = []

    def select_action(self, batch: dict[str, np.ndarray]) -> np.ndarray:
        """Return the next action of the chunk, (1, n)."""
        if not self.planned:
            distance = 0.6 - batch["observation.state"][:, :1]
            self.planned = [40 * distance] * 4
        return self.planned.pop()
