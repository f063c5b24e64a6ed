"""Finds the model and data of MuJoCo that an environment steps."""

from typing import Any

import mujoco

from contactlab.errors import SceneError

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


def differing_parts(model: mujoco.MjModel, known: mujoco.MjModel) -> str:
    """Return the parts of a model that differ from those of another; empty if none do."""
    return ", ".join(part for part in _PART_FIELDS if getattr(model, part) != getattr(known, part))


def _unwrap_object(wrapped: Any, own: str) -> Any:  # noqa: ANN401 - likewise
    return getattr(wrapped, "ptr", getattr(wrapped, own, wrapped))
