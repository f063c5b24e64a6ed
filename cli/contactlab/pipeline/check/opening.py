"""Open a model for its checks."""

import math
from collections.abc import Mapping
from pathlib import Path

from contactlab.errors import SceneError
from contactlab.pipeline.vocabulary import Scenes
from contactlab.scene import Scene, find_scene, scene_inertia_faults


def opened(scenes: Scenes, asked: str) -> Scene:
    """Open a scene.

    Raises:
        SceneError: there is none, or it does not compile; says also which inertias no body has.
    """
    try:
        return scenes.open(asked)
    except SceneError as error:
        faults = _faults(asked)
        if not faults:
            raise
        raise SceneError("\n".join([str(error), *faults])) from error


def _faults(asked: str) -> list[str]:
    try:
        faults = scene_inertia_faults(find_scene(asked, Path()))
    except SceneError:
        return []
    return [f"  body '{each.body}': {each.reason}" for each in faults]


def check_timestep(scene: Scene, values: Mapping[str, object]) -> None:
    """Raise SceneError unless the timestep is one that time can go on by."""
    timestep = scene.resolve(values, 0, None).timestep
    if not 0 < timestep < math.inf:
        raise SceneError(
            f"{scene.source.model}: its timestep is {timestep:g} s; write one above 0 there, "
            "or `--set timestep=`"
        )
