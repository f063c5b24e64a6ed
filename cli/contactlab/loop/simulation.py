"""Where environments keep the model and data of MuJoCo that they step."""

from typing import Any

import mujoco

from contactlab.errors import SceneError

_PARTS = ("nq", "nv", "na", "nu", "nbody", "njnt", "ngeom", "ntendon", "nmocap", "names")


def simulation(env: Any) -> tuple[mujoco.MjModel, mujoco.MjData]:  # noqa: ANN401 - any environment
    """Return the model and data of MuJoCo that an environment steps; a SceneError if it has none.

    Those of dm_control and robosuite are wrapped once more.
    """
    for holder in (env, *(getattr(env, name, None) for name in ("physics", "sim", "_physics"))):
        model, data = (getattr(holder, name, None) for name in ("model", "data"))
        if model is not None and data is not None:
            return _unwrapped(model, "_model"), _unwrapped(data, "_data")
    raise SceneError(
        f"{type(env).__name__} has no MuJoCo model and data; give those that it steps to "
        "contactlab.record"
    )


def bare(env: Any) -> Any:  # noqa: ANN401 - likewise
    """Return an environment without the wrappers of Gymnasium."""
    return getattr(env, "unwrapped", env)


def other_parts(model: mujoco.MjModel, known: mujoco.MjModel) -> str:
    """Return which parts of a model are not those of another; empty if all are."""
    return ", ".join(part for part in _PARTS if getattr(model, part) != getattr(known, part))


def _unwrapped(wrapped: Any, own: str) -> Any:  # noqa: ANN401 - likewise
    """Return what dm_control and robosuite wrap."""
    return getattr(wrapped, "ptr", getattr(wrapped, own, wrapped))
