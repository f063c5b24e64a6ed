"""Commands that list what there is: scenes, sweeps, metrics, labels, thresholds."""

from typing import Annotated

import typer

from contactlab.commands.options import Format, FormatOption, PluginOption, load_plugins
from contactlab.commands.terminal import print_rows


def scenes(
    name: Annotated[
        str | None, typer.Argument(metavar="[SCENE]", help="Scene, scene folder or model file.")
    ] = None,
    output: FormatOption = "text",
) -> None:
    """List the shipped scenes, or every axis that one scene offers."""
    if name is None:
        _list_scenes(output)
    else:
        _list_axes(name, output)


def _list_scenes(output: Format) -> None:
    from contactlab import resources
    from contactlab.scene.scene_source import find_scene

    found = [find_scene(name) for name in resources.scene_names()]
    rows = [
        (each.name, each.manifest.title, each.manifest.duration) for each in found if each.manifest
    ]
    if output == "json":
        print_rows(("scene", "title", "duration"), rows, as_json=True)
    else:
        print_rows(("scene", "title", "duration [s]"), rows, as_json=False)


def _list_axes(name: str, output: Format) -> None:
    from contactlab.run.sweep_request import SceneLoader

    scene = SceneLoader(None).open(name)
    specs = [scene.catalogue.find(each) for each in scene.catalogue.names]
    rows = [
        (each.name, each.unit, each.description, ", ".join(each.choices)) for each in specs if each
    ]
    keys = ("axis", "unit", "description", "values")
    print_rows(keys, rows, as_json=output == "json")


def sweeps(output: FormatOption = "text") -> None:
    """List the shipped sweeps."""
    from contactlab import resources
    from contactlab.plan.sweep_file import read_sweep
    from contactlab.run.sweep_request import SceneLoader

    rows: list[tuple[str, str, int, str]] = []
    for name in resources.sweep_names():
        path = resources.sweep_file(name)
        read = read_sweep(path, SceneLoader(path.parent).vocabulary)
        rows.append((name, read.sweep.scene, read.plan.count, read.sweep.description or ""))
    keys = ("sweep", "scene", "runs", "description")
    print_rows(keys, rows, as_json=output == "json")


def metrics(plugin: PluginOption = None, output: FormatOption = "text") -> None:
    """List every metric: unit, direction, version and definition."""
    from contactlab.measure import METRICS

    load_plugins(plugin)
    keys = ("metric", "unit", "better", "version", "definition")
    rows = [
        (each.name, each.unit, each.better, each.version, each.definition)
        for each in METRICS.values()
    ]
    print_rows(keys, rows, as_json=output == "json")


def labels(plugin: PluginOption = None, output: FormatOption = "text") -> None:
    """List every label, worst first: its meaning and the thresholds that it depends on."""
    from contactlab.measure import LABELS

    load_plugins(plugin)
    rows = [
        (each.name, each.meaning, ", ".join(limit.name for limit in each.thresholds))
        for each in LABELS.values()
    ]
    print_rows(("label", "meaning", "thresholds"), rows, as_json=output == "json")


def thresholds(plugin: PluginOption = None, output: FormatOption = "text") -> None:
    """List every threshold that a scene or a sweep may set: its default, unit and source."""
    from contactlab.measure import THRESHOLDS

    load_plugins(plugin)
    rows = [(each.name, each.default, each.unit, each.source) for each in THRESHOLDS.values()]
    keys = ("threshold", "default", "unit", "source")
    print_rows(keys, rows, as_json=output == "json")
