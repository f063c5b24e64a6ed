"""Environments of Gymnasium over MuJoCo; each episode becomes a run of a store."""

from pathlib import Path
from typing import Any, cast

from gymnasium import Wrapper  # pyright: ignore[reportMissingImports] - an extra

from contactlab.loop.recording import Recording, record
from contactlab.loop.simulation import find_simulation, read_success


class Evidence(Wrapper):  # pyright: ignore[reportUntypedBaseClass] - likewise
    """Records each episode of an environment that steps MuJoCo.

    The environment, without its wrappers, has `model` and `data`, or a `physics` or `sim` with
    both. All steps by `mujoco.mj_step` within its own `step` are recorded, with any frame skip. An
    episode's success is the last `success` or `is_success` of its infos.

    Args:
        env: the environment.
        store: the folder of the store.
        how: further arguments of `contactlab.record`.
    """

    def __init__(self, env: Any, store: str | Path, **how: Any) -> None:  # noqa: ANN401 - as given
        super().__init__(env)
        model, data = find_simulation(env.unwrapped)
        self.recording: Recording = record(model, data, store, **how)
        self._begin_episode()

    def reset(self, **how: Any) -> Any:  # noqa: ANN401 - as the environment takes and returns them
        """Reset the environment, and begin another episode."""
        self._end_episode()
        answer = self.env.reset(**how)
        self.recording.follow(*find_simulation(self.env.unwrapped))
        return answer

    def step(self, action: Any) -> Any:  # noqa: ANN401 - likewise
        """Step the environment, and record its steps."""
        with self.recording.listening():
            answer = self.env.step(action)
        _, reward, terminated, truncated, info = answer
        self._reward += float(reward)
        success = read_success(self.env, info)
        self._success = self._success if success is None else success
        if terminated or truncated:
            self._end_episode()
        return answer

    def close(self) -> None:
        """End the last episode, finish the store, and close the environment."""
        self._end_episode()
        try:
            self.recording.close()
        finally:
            self.env.close()

    def _begin_episode(self) -> None:
        self._reward, self._success = 0.0, cast("bool | None", None)

    def _end_episode(self) -> None:
        self.recording.reset(success=self._success, total_reward=self._reward)
        self._begin_episode()
