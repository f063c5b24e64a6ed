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
    if name is not None:
        _list_axes(name, output)
        return
    from contactlab import resources
    from contactlab.scene.scene_source import find_scene

    found = [find_scene(name) for name in resources.scene_names()]
    rows = [
        (each.name, each.manifest.title, each.manifest.duration) for each in found if each.manifest
    ]
    duration = "duration" if output == "json" else "duration [s]"
    print_rows(output, ("scene", "title", duration), rows)


def _list_axes(name: str, output: Format) -> None:
    from contactlab.run.sweep_request import SceneLoader

    scene = SceneLoader(None).open(name)
    specs = [scene.catalogue.find(each) for each in scene.catalogue.names]
    rows = [
        (each.name, each.unit, each.description, ", ".join(each.choices)) for each in specs if each
    ]
    print_rows(output, ("axis", "unit", "description", "values"), rows)


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
    print_rows(output, ("sweep", "scene", "runs", "description"), rows)


def metrics(plugin: PluginOption = None, output: FormatOption = "text") -> None:
    """List every metric: unit, direction, version and definition."""
    from contactlab.measure import METRICS

    load_plugins(plugin)
    rows = [
        (each.name, each.unit, each.better, each.version, each.definition)
        for each in METRICS.values()
    ]
    print_rows(output, ("metric", "unit", "better", "version", "definition"), rows)


def labels(plugin: PluginOption = None, output: FormatOption = "text") -> None:
    """List every label, worst first: its meaning and the thresholds that it depends on."""
    from contactlab.measure import LABELS

    load_plugins(plugin)
    rows = [
        (each.name, each.meaning, ", ".join(limit.name for limit in each.thresholds))
        for each in LABELS.values()
    ]
    print_rows(output, ("label", "meaning", "thresholds"), rows)


def thresholds(plugin: PluginOption = None, output: FormatOption = "text") -> None:
    """List every threshold that a scene or a sweep may set: its default, unit and source."""
    from contactlab.measure import THRESHOLDS

    load_plugins(plugin)
    rows = [(each.name, each.default, each.unit, each.source) for each in THRESHOLDS.values()]
    print_rows(output, ("threshold", "default", "unit", "source"), rows)
