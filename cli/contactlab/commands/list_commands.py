"""`contactlab scenes`: the shipped scenes, and what each offers to vary."""

from collections.abc import Sequence
from typing import Annotated

import typer

from contactlab.commands.terminal import Format, FormatOption, print_json, print_table


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
    from contactlab.run import SceneLoader

    scene = SceneLoader(None).open(name)
    specs = [scene.catalogue.find(each) for each in scene.catalogue.names]
    rows = [
        (each.name, each.unit, each.description, ", ".join(each.choices)) for each in specs if each
    ]
    keys = ("axis", "unit", "description", "values")
    if output is Format.json:
        print_json([dict(zip(keys, row, strict=True)) for row in rows])
    else:
        print_table(keys, rows)


def sweeps(output: FormatOption = Format.text) -> None:
    """List the shipped sweeps."""
    from contactlab import resources
    from contactlab.plan import read_sweep
    from contactlab.run import SceneLoader

    rows: list[tuple[str, str, int, str]] = []
    for name in resources.sweep_names():
        path = resources.sweep_file(name)
        read = read_sweep(path, SceneLoader(path.parent).vocabulary)
        rows.append((name, read.sweep.scene, read.plan.count, read.sweep.description or ""))
    keys = ("sweep", "scene", "runs", "description")
    if output is Format.json:
        print_json([dict(zip(keys, row, strict=True)) for row in rows])
    else:
        print_table(keys, rows)


def metrics(output: FormatOption = Format.text) -> None:
    """List every metric: unit, direction, version and definition."""
    from contactlab.measure import METRICS

    keys = ("metric", "unit", "better", "version", "definition")
    rows = [
        (each.name, each.unit, each.better, each.version, each.definition)
        for each in METRICS.values()
    ]
    _print_rows(keys, rows, output)


def labels(output: FormatOption = Format.text) -> None:
    """List every label, worst first, with its meaning and the thresholds that it reads."""
    from contactlab.measure import LABELS

    rows = [
        (each.name, each.meaning, ", ".join(limit.name for limit in each.thresholds))
        for each in LABELS.values()
    ]
    _print_rows(("label", "meaning", "thresholds"), rows, output)


def thresholds(output: FormatOption = Format.text) -> None:
    """List every threshold that a scene or a sweep may set, with its default and source."""
    from contactlab.measure import THRESHOLDS

    rows = [(each.name, each.default, each.unit, each.source) for each in THRESHOLDS.values()]
    _print_rows(("threshold", "default", "unit", "source"), rows, output)


def _print_rows(keys: tuple[str, ...], rows: Sequence[Sequence[object]], output: Format) -> None:
    if output is Format.json:
        print_json([dict(zip(keys, row, strict=True)) for row in rows])
    else:
        print_table(keys, rows)
