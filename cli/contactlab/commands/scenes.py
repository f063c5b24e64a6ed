"""`contactlab scenes`: the shipped scenes, and what each offers to vary."""

from typing import Annotated

import typer

from contactlab.commands.output import Format, FormatOption, print_json, print_table


def scenes(
    name: Annotated[str | None, typer.Argument(help="A scene, a folder or a model file.")] = None,
    output: FormatOption = Format.text,
) -> None:
    """List the shipped scenes, or every axis that one scene offers."""
    if name is None:
        _list_scenes(output)
    else:
        _list_axes(name, output)


def _list_scenes(output: Format) -> None:
    from contactlab import resources
    from contactlab.scene import find_scene

    found = [find_scene(name) for name in resources.scene_names()]
    rows = [
        (each.name, each.manifest.title, each.manifest.duration) for each in found if each.manifest
    ]
    if output is Format.json:
        print_json([dict(zip(("scene", "title", "duration"), row, strict=True)) for row in rows])
    else:
        print_table(("scene", "what it is", "duration [s]"), rows)


def _list_axes(name: str, output: Format) -> None:
    from contactlab.run import Scenes

    scene = Scenes(None).open(name)
    specs = [scene.catalogue.find(each) for each in scene.catalogue.names]
    rows = [
        (each.name, each.unit, each.description, ", ".join(each.choices)) for each in specs if each
    ]
    keys = ("axis", "unit", "description", "values")
    if output is Format.json:
        print_json([dict(zip(keys, row, strict=True)) for row in rows])
    else:
        print_table(keys, rows)
