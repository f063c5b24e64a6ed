"""Commands that list or write what comes along: scenes, metrics, engines, schemas, a sweep."""

from hashlib import sha256
from pathlib import Path

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import echo, print_rows, say
from contactlab.errors import EngineError, OutputError, SweepFileError, did_you_mean

_SUFFIX = ".schema.json"


def scenes(
    name: str | None = typer.Argument(
        None, metavar="[SCENE]", help="Scene, scene folder or model file."
    ),
    output: opt.TableFormat = opt.FORMAT,
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


def _list_axes(name: str, output: opt.TableFormat) -> None:
    from contactlab.run.sweep_request import SceneLoader

    scene = SceneLoader(None).open(name)
    specs = [scene.catalogue.find(each) for each in scene.catalogue.names]
    rows = [
        (each.name, each.unit, each.description, ", ".join(each.choices)) for each in specs if each
    ]
    print_rows(output, ("axis", "unit", "description", "values"), rows)


def sweeps(output: opt.TableFormat = opt.FORMAT) -> None:
    """List the shipped sweeps."""
    from contactlab import resources

    # To count the runs of a file that is not indexed takes the engine.
    index = resources.sweep_index()
    files = map(resources.sweep_file, resources.sweep_names())
    rows = [index.get(sha256(path.read_bytes()).hexdigest()) or sweep_row(path) for path in files]
    print_rows(output, ("sweep", "scene", "runs", "description"), rows)


def sweep_row(path: Path) -> tuple[str, str, int, str]:
    """Return name, scene, number of runs and description of a sweep file."""
    from contactlab.plan.sweep_file import read_sweep
    from contactlab.run.sweep_request import SceneLoader

    read = read_sweep(path, SceneLoader(path.parent).vocabulary)
    return path.stem, read.sweep.scene, read.plan.count, read.sweep.description or ""


def metrics(plugin: list[Path] | None = opt.PLUGIN, output: opt.TableFormat = opt.FORMAT) -> None:
    """List every metric: unit, direction, version and definition."""
    from contactlab.measure import METRICS

    opt.load_plugins(plugin)
    rows = [
        (each.name, each.unit, each.better, each.version, each.definition)
        for each in METRICS.values()
    ]
    print_rows(output, ("metric", "unit", "better", "version", "definition"), rows)


def labels(plugin: list[Path] | None = opt.PLUGIN, output: opt.TableFormat = opt.FORMAT) -> None:
    """List every label, worst first: its meaning and the thresholds that it depends on."""
    from contactlab.measure import LABELS

    opt.load_plugins(plugin)
    rows = [
        (each.name, each.meaning, ", ".join(limit.name for limit in each.thresholds))
        for each in LABELS.values()
    ]
    print_rows(output, ("label", "meaning", "thresholds"), rows)


def thresholds(
    plugin: list[Path] | None = opt.PLUGIN, output: opt.TableFormat = opt.FORMAT
) -> None:
    """List every threshold that a scene or a sweep may set: its default, unit and source."""
    from contactlab.measure import THRESHOLDS

    opt.load_plugins(plugin)
    rows = [(each.name, each.default, each.unit, each.source) for each in THRESHOLDS.values()]
    print_rows(output, ("threshold", "default", "unit", "source"), rows)


def init(
    scene: str = typer.Argument(
        "ball_drop", help="Scene, scene folder, .xml or .urdf file, or menagerie:ROBOT."
    ),
    path: Path = opt.output_option("FILE", "Sweep file to write.", Path("sweep.yaml")),
) -> None:
    """Write a starter sweep file for a scene, and its JSON Schema beside it."""
    from contactlab.plan.starter import SCHEMA_NAME
    from contactlab.plan.sweep_file import read_sweep
    from contactlab.run.sweep_request import SceneLoader, starter_sweep
    from contactlab.scene.scene_source import reference_from
    from contactlab.schema.json_schemas import schema_texts
    from contactlab.store.atomic_files import write_errors

    if path.exists():
        raise OutputError(f"{path} exists; choose another file with -o")
    with write_errors(path):
        path.parent.stat()
    loader, reference = SceneLoader(path.parent), reference_from(path.parent, scene)
    text = starter_sweep(reference, loader)
    plan = read_sweep(text, loader.vocabulary).plan
    beside = path.parent / SCHEMA_NAME
    with write_errors(path):
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
        beside.write_text(schema_texts()["sweep.schema.json"], encoding="utf-8")
    say(f"wrote {path}, {plan.count} runs of {plan.sweep.duration:g} s each, and {beside}")
    say(f"next: contactlab sweep {path}")


def schema(
    name: str | None = typer.Argument(None, help="Schema to print; lists all names by default."),
    write: Path | None = opt.option("FOLDER", "Write all schemas into a folder."),
) -> None:
    """Print or write the JSON Schemas of the files that contactlab reads and writes."""
    from contactlab.schema.json_schemas import schema_texts
    from contactlab.store.atomic_files import write_errors

    known = schema_texts()
    if write is not None:
        with write_errors(write):
            write.mkdir(parents=True, exist_ok=True)
            for each, text in known.items():
                (write / each).write_text(text, encoding="utf-8")
        say(f"wrote {', '.join(known)}")
    elif name is None:
        echo("\n".join(known))
    else:
        found = known.get(name) or known.get(name + _SUFFIX)
        if found is None:
            names = [each.removesuffix(_SUFFIX) for each in known]
            raise SweepFileError(f"no schema '{name}'{did_you_mean(name, names)}")
        echo(found.rstrip())


engines = typer.Typer(help="Engines that can simulate.", invoke_without_command=True)


@engines.callback()
def list_engines(context: typer.Context, output: opt.TableFormat = opt.FORMAT) -> None:
    """List the engines: what each is, and the version that is installed."""
    if context.invoked_subcommand is not None:
        return
    from contactlab.engines import ENGINES
    from contactlab.engines.adapted_engine import AdaptedEngine

    known = ENGINES.values()
    why = {each.name: each.refused for each in known if isinstance(each, AdaptedEngine)}
    rows = [
        (each.name, "refused", f"{each.summary}: {why[each.name]}")
        if why.get(each.name)
        else (each.name, each.version or "not installed", each.summary)
        for each in known
    ]
    print_rows(output, ("engine", "version", "what computes"), rows)
    say("more by `contactlab engines add NAME`")


@engines.command()
def add(name: str = typer.Argument(help="Engine to install.")) -> None:
    """Install an engine in an environment of its own, in the user's cache."""
    from contactlab.engines import find_engine
    from contactlab.engines.adapted_engine import AdaptedEngine
    from contactlab.run.mujoco_environment import make_environment

    engine = find_engine(name)
    if isinstance(engine, AdaptedEngine) and engine.refused:
        raise EngineError(engine.absence)
    if not isinstance(engine, AdaptedEngine) or engine.version:
        echo(f"{name} {engine.version} is here")
        return
    say(f"setting up {name} in {engine.environment}, once")
    advice = f"look whether this machine can have {' and '.join(engine.requirements)}"
    make_environment(engine.environment, engine.requirements, name, advice, lambda _: None)
    echo(f"{name} {engine.version}")
