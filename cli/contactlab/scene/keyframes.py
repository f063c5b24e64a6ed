"""Keyframes of a model, and the start state of each."""

import mujoco
import numpy as np

from contactlab.errors import SceneError
from contactlab.scene.task import default_start_keyframe, keyframe_names
from contactlab.schema.scene_manifest import SceneManifest
from contactlab.schema.task import QPOS0


def default_keyframe(model: mujoco.MjModel, manifest: SceneManifest | None) -> str:
    """Return the keyframe that runs start from unless their sweep sets another.

    A manifest may name it; a SceneError is raised if the model lacks it. Otherwise it is the
    model's first keyframe with controls, or its first one: in the reference configuration, links
    often intersect and joints exceed their limits.
    """
    if manifest is None or manifest.keyframe is None:
        return default_start_keyframe(model)
    model_keyframes, keyframe = keyframe_names(model), manifest.keyframe
    SceneError.unless_known(
        keyframe, (*model_keyframes, QPOS0), f"the model has no keyframe '{keyframe}'"
    )
    return keyframe


def start_data(model: mujoco.MjModel, keyframe: str) -> mujoco.MjData:
    """Return the state of a keyframe, or of `QPOS0`."""
    data = mujoco.MjData(model)
    if keyframe != QPOS0:
        mujoco.mj_resetDataKeyframe(model, data, model.key(keyframe).id)
    return data


def place_mocap(model: mujoco.MjModel, keyframe: str) -> None:
    """Write a keyframe's poses of mocap bodies into a model, in place."""
    if not model.nmocap or keyframe == QPOS0:
        return
    data = start_data(model, keyframe)
    bodies = np.flatnonzero(model.body_mocapid >= 0)
    places = model.body_mocapid[bodies]
    model.body_pos[bodies] = data.mocap_pos[places]
    model.body_quat[bodies] = data.mocap_quat[places]
