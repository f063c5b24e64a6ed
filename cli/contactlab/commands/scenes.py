"""`contactlab scenes`: the shipped scenes, and the axes of a scene."""

from pathlib import Path
from typing import Annotated

from contactlab.command_line.declaration import Argument, command
from contactlab.command_line.listing import LISTED, Listing


@command("list", examples=("scenes", "scenes grasp_mug"), formats=LISTED)
def scenes(
    scene: Annotated[
        str | Path | None,
        Argument("[SCENE]", "Scene, scene folder or model file.", kind=str),
    ] = None,
) -> Listing:
    """List the shipped scenes, or every axis that one scene offers.

    Raises:
        SceneError: there is no such scene.
    """
    if scene is not None:
        return _axes(str(scene))
    from contactlab import resources
    from contactlab.scene.scene_source import find_scene

    sources = [find_scene(name) for name in resources.scene_names()]
    rows = [
        (source.name, source.manifest.title, source.manifest.duration)
        for source in sources
        if source.manifest
    ]
    return Listing(("scene", "title", "duration"), rows, {"duration": "s"})


def _axes(name: str) -> Listing:
    from contactlab.run.sweep_request import SceneLoader

    catalogue = SceneLoader(None).open(name).catalogue
    rows = [
        (axis.name, axis.unit, axis.description, ", ".join(axis.choices))
        for axis in map(catalogue.find, catalogue.names)
        if axis
    ]
    return Listing(("axis", "unit", "description", "values"), rows)
