"""The keyframes that runs may start from."""

import mujoco
import numpy as np

from contactlab.errors import SceneError, did_you_mean
from contactlab.schema import SceneManifest

OWN_START = "qpos0"
"""What stands for the model's own start, in which all joints are at their reference."""


def keyframe_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the names of a model's keyframes; those without cannot be asked for."""
    names = (model.key(index).name for index in range(model.nkey))
    return tuple(name for name in names if name)


def usual_keyframe(model: mujoco.MjModel, manifest: SceneManifest | None) -> str:
    """Return the keyframe that runs start from unless their sweep says otherwise.

    It is the manifest's. Without a manifest it is the model's first: reference positions are
    often no posture to be in, with links in each other and joints beyond their limits.

    Raises:
        SceneError: the manifest names a keyframe that the model lacks.
    """
    known = keyframe_names(model)
    if manifest is None:
        return next(iter(known), OWN_START)
    if manifest.keyframe is not None and manifest.keyframe not in known:
        hint = did_you_mean(manifest.keyframe, known)
        raise SceneError(f"no keyframe '{manifest.keyframe}' in the model{hint}")
    return manifest.keyframe or OWN_START


def start_data(model: mujoco.MjModel, keyframe: str) -> mujoco.MjData:
    """Return the state of a keyframe, or the model's own."""
    data = mujoco.MjData(model)
    if keyframe != OWN_START:
        mujoco.mj_resetDataKeyframe(model, data, model.key(keyframe).id)
    return data


def place_mocap(model: mujoco.MjModel, keyframe: str) -> None:
    """Make a keyframe's places of mocap bodies those that a model starts from, in place."""
    if not model.nmocap or keyframe == OWN_START:
        return
    data = start_data(model, keyframe)
    bodies = np.flatnonzero(model.body_mocapid >= 0)
    places = model.body_mocapid[bodies]
    model.body_pos[bodies] = data.mocap_pos[places]
    model.body_quat[bodies] = data.mocap_quat[places]
