"""Conventions of environments: their model and data of MuJoCo, their seeds and successes."""

import inspect
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from contactlab.errors import SceneError

SUCCESS = ("success", "is_success")
"""Names of an episode's success in infos."""
_PART_FIELDS = ("nq", "nv", "na", "nu", "nbody", "njnt", "ngeom", "ntendon", "nmocap", "names")


def find_simulation(env: Any) -> tuple[mujoco.MjModel, mujoco.MjData]:  # noqa: ANN401 - any environment
    """Return the model and data of MuJoCo that an environment steps; a SceneError if it lacks one.

    Those of dm_control and robosuite have another wrapper.
    """
    for holder in (env, *(getattr(env, name, None) for name in ("physics", "sim", "_physics"))):
        model, data = (getattr(holder, name, None) for name in ("model", "data"))
        if model is not None and data is not None:
            return _unwrap_object(model, "_model"), _unwrap_object(data, "_data")
    raise SceneError(
        f"{type(env).__name__} has no MuJoCo model and data; pass those that it steps to "
        "contactlab.record"
    )


def unwrap_environment(env: Any) -> Any:  # noqa: ANN401 - likewise
    """Return an environment without the wrappers of Gymnasium."""
    return getattr(env, "unwrapped", env)


def reset_with_seed(env: Any, seed: int) -> Any:  # noqa: ANN401 - whatever it observes
    """Reset an environment with a seed, and return its answer.

    Those of robosuite draw from a generator of their own, `rng`, and take no seed.
    """
    rng = getattr(unwrap_environment(env), "rng", None)
    if isinstance(rng, np.random.Generator) and not inspect.signature(env.reset).parameters:
        rng.bit_generator.state = np.random.default_rng(seed).bit_generator.state
        return env.reset()
    return env.reset(seed=seed)


def read_success(env: Any, info: Mapping[str, Any]) -> bool | None:  # noqa: ANN401 - likewise
    """Return whether an episode succeeds now, by its info or by robosuite's `_check_success`.

    None stands for an environment with neither.
    """
    successes = [bool(info[name]) for name in SUCCESS if name in info]
    check = getattr(unwrap_environment(env), "_check_success", None)
    return successes[0] if successes else bool(check()) if callable(check) else None


def differing_parts(model: mujoco.MjModel, other: mujoco.MjModel) -> str:
    """Return the parts of a model that differ from those of another; empty if none do."""
    return ", ".join(part for part in _PART_FIELDS if getattr(model, part) != getattr(other, part))


def _unwrap_object(wrapped: Any, own: str) -> Any:  # noqa: ANN401 - likewise
    return getattr(wrapped, "ptr", getattr(wrapped, own, wrapped))
