"""`contactlab list`: all names for a sweep, a gate or an option."""

import builtins
import json
from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Arguments, Option, command
from contactlab.command_line.listing import LISTED, Listing
from contactlab.command_line.report_formats import formats_by_type
from contactlab.command_line.surroundings import say
from contactlab.command_line.terminal import echo
from contactlab.errors import SweepFileError, did_you_mean


def _list_scenes() -> Listing:
    from contactlab import resources
    from contactlab.scene.scene_source import find_scene

    sources = [find_scene(name) for name in resources.scene_names()]
    rows = [
        (source.name, source.manifest.title, source.manifest.duration)
        for source in sources
        if source.manifest
    ]
    return Listing(("scene", "title", "duration"), rows, {"duration": "s"})


def _list_sweeps() -> Listing:
    from contactlab import resources

    # To count the runs of a file that is not indexed takes the engine.
    index = resources.sweep_index()
    files = map(resources.sweep_file, resources.sweep_names())
    rows = [index.get(sha256(path.read_bytes()).hexdigest()) or sweep_row(path) for path in files]
    return Listing(("sweep", "scene", "runs", "description"), rows)


def sweep_row(path: Path) -> tuple[str, str, int, str]:
    """Return name, scene, number of runs and description of a sweep file."""
    from contactlab.plan.sweep_file import read_sweep
    from contactlab.run.sweep_request import SceneLoader

    sweep_file = read_sweep(path, SceneLoader(path.parent).vocabulary)
    return (
        path.stem,
        sweep_file.sweep.scene,
        sweep_file.plan.count,
        sweep_file.sweep.description or "",
    )


def _list_metrics() -> Listing:
    from contactlab.measure import METRICS

    rows = [
        (metric.name, metric.unit, metric.better, metric.version, metric.definition)
        for metric in METRICS.values()
    ]
    return Listing(("metric", "unit", "better", "version", "definition"), rows)


def _list_labels() -> Listing:
    from contactlab.measure import LABELS

    rows = [
        (label.name, label.meaning, ", ".join(limit.name for limit in label.thresholds))
        for label in LABELS.values()
    ]
    return Listing(("label", "meaning", "thresholds"), rows)


def _list_limits() -> Listing:
    from contactlab.measure import THRESHOLDS

    rows = [
        (threshold.name, threshold.default, threshold.unit, threshold.source)
        for threshold in THRESHOLDS.values()
    ]
    return Listing(("threshold", "default", "unit", "source"), rows)


def _list_engines() -> Listing:
    from contactlab.engines import ENGINES
    from contactlab.engines.adapted_engine import AdaptedEngine

    rows: builtins.list[tuple[object, ...]] = []
    for engine in ENGINES.values():
        version, size = engine.version or "not installed", None
        if isinstance(engine, AdaptedEngine):
            size = round(engine.size / 1e6) or None
        rows.append((engine.name, version, size, engine.summary))
    say("install more by `contactlab parity --install NAME`")
    return Listing(("engine", "version", "size", "summary"), rows, {"size": "MB"})


def _list_schemas(name: str | None, folder: str | Path | None) -> Listing | dict[str, Any]:
    from contactlab.schema.json_schemas import schema_texts
    from contactlab.store.atomic_files import write_errors

    suffix, texts = ".schema.json", schema_texts()
    if folder is not None:
        place = Path(folder)
        with write_errors(place):
            place.mkdir(parents=True, exist_ok=True)
            for file, text in texts.items():
                (place / file).write_text(text, encoding="utf-8")
    schemas = {file.removesuffix(suffix): json.loads(text) for file, text in texts.items()}
    if name is None:
        rows = [
            (each, one.get("title", ""), one.get("description", "").partition("\n\n")[0])
            for each, one in schemas.items()
        ]
        return Listing(("schema", "title", "description"), rows)
    name = name.removesuffix(suffix)
    there = f"; there are {', '.join(schemas)}"
    SweepFileError.unless_known(name, schemas, f"no schema '{name}'", there)
    return schemas[name]


def _print_schema(schema: dict[str, Any], arguments: Arguments) -> None:
    del arguments
    echo(json.dumps(schema, indent=2))


_KINDS: Mapping[str, tuple[str, Callable[[], Listing]]] = {
    "scenes": ("the shipped scenes", _list_scenes),
    "sweeps": ("the shipped sweeps, with their number of runs", _list_sweeps),
    "metrics": ("unit, direction, version and definition of each metric", _list_metrics),
    "labels": ("the outcomes of runs, worst first", _list_labels),
    "limits": ("limits of labels, which a scene or sweep may set", _list_limits),
    "engines": ("the simulation engines, with version and size if installed", _list_engines),
}
_OF_SCENE, _SCHEMAS = "axes", "schemas"
_EXTENDED = {"metrics", "labels", "limits", "engines"}  # by plug-ins


@command(
    "extend",
    examples=("list", "list labels", "list axes grasp_mug", "list schemas sweep"),
    formats=formats_by_type({"Listing": LISTED, "dict": {"text": _print_schema}}),
)
def list(
    what: Annotated[
        str | None,
        Argument("[WHAT]", "scenes, sweeps, metrics, labels, limits, engines, schemas, or axes."),
    ] = None,
    of: Annotated[
        str | Path | None,
        Argument(
            "[SCENE|SCHEMA]",
            "With axes: scene, scene folder or model file. With schemas: the one to print.",
            kind=str,
        ),
    ] = None,
    *,
    write: Annotated[
        str | Path | None, Option("FOLDER", "Write all schemas into a folder.", kind=Path)
    ] = None,
    plugin: opt.Plugins = (),
) -> Listing | Any:  # noqa: ANN401 - so that a caller without a schema has a listing
    """List scenes, axes, sweeps, metrics, labels, limits or schemas.

    A single schema is returned as data.

    Raises:
        SweepFileError: there is no list or schema of that name.
        SceneError: there is no such scene.
        OutputError: the folder cannot be written.
    """
    if write is not None and what != _SCHEMAS:
        raise SweepFileError(
            "--write writes schemas; write `contactlab list schemas --write FOLDER`"
        )
    if what == _SCHEMAS:
        return _list_schemas(None if of is None else str(of), write)
    if plugin or what in _EXTENDED:
        opt.load_plugins(plugin)
    if what == _OF_SCENE:
        if of is None:
            raise SweepFileError("list axes: name a scene too; write `contactlab list axes SCENE`")
        from contactlab.run.sweep_request import SceneLoader

        catalogue = SceneLoader(None).open(str(of)).catalogue
        axes = [axis for axis in map(catalogue.find_axis, catalogue.names) if axis]
        return Listing(
            ("axis", "unit", "description", "values"),
            [(axis.name, axis.unit, axis.description, ", ".join(axis.choices)) for axis in axes],
        )
    if of is not None:
        raise SweepFileError(f"only axes belong to a scene; write `contactlab list axes {of}`")
    if what is None:
        rows = [(name, summary) for name, (summary, _) in _KINDS.items()]
        return Listing(
            ("list", "of"),
            [
                *rows,
                (_SCHEMAS, "the JSON Schemas of all files, for editors and checks"),
                (f"{_OF_SCENE} SCENE", "the parameters that a sweep can set in a scene"),
            ],
        )
    if what not in _KINDS:
        list_names = (*_KINDS, _SCHEMAS, _OF_SCENE)
        raise SweepFileError(
            f"there is no list '{what}'{did_you_mean(what, list_names)}; there are "
            f"{', '.join(list_names)}"
        )
    return _KINDS[what][1]()
