"""`contactlab init` and `schema`: a sweep file to start from, and the schemas of all files."""

import errno
import json
from pathlib import Path
from typing import Annotated

import typer

from contactlab.commands.terminal import echo, print_json, say
from contactlab.errors import ExpectationError, OutputError, SweepFileError, did_you_mean


def init(
    scene: Annotated[
        str, typer.Argument(help="Scene, scene folder, .xml or .urdf file, or menagerie:ROBOT.")
    ] = "ball_drop",
    path: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="Sweep file to write.")
    ] = Path("sweep.yaml"),
) -> None:
    """Write a starter sweep file for a scene, and its JSON Schema beside it."""
    from contactlab.plan.starter import SCHEMA_NAME
    from contactlab.plan.sweep_file import read_sweep
    from contactlab.run.sweep_request import SceneLoader, starter_sweep
    from contactlab.scene.scene_source import reference_from
    from contactlab.schema.json_schemas import json_schemas
    from contactlab.store.atomic_files import write_error

    if path.exists():
        raise OutputError(f"{path} exists; choose another file with -o")
    if not path.parent.is_dir():
        raise write_error(path, FileNotFoundError(errno.ENOENT, ""))
    loader, reference = SceneLoader(path.parent), reference_from(path.parent, scene)
    text = starter_sweep(reference, loader)
    plan = read_sweep(text, loader.vocabulary).plan
    beside = path.parent / SCHEMA_NAME
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
        published = json.dumps(json_schemas()["sweep.schema.json"], indent=2) + "\n"
        beside.write_text(published, encoding="utf-8")
    except OSError as error:
        raise write_error(path, error) from error
    say(f"wrote {path}, {plan.count} runs of {plan.sweep.duration:g} s each, and {beside}")
    say(f"next: contactlab sweep {path}")


_SUFFIX = ".schema.json"


def schema(
    name: Annotated[
        str | None, typer.Argument(help="Schema to print; lists all names by default.")
    ] = None,
    write: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Write all schemas into a folder.")
    ] = None,
    check: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Fail unless a folder holds the current schemas."),
    ] = None,
) -> None:
    """Print, write or check the JSON Schemas of the files that contactlab reads and writes."""
    from contactlab.schema.json_schemas import json_schemas, schema_drift

    if write is not None:
        say(f"wrote {', '.join(_written(write))}")
    elif check is not None:
        if differing := schema_drift(check):
            raise ExpectationError(
                f"{check} is out of date: {', '.join(differing)}; update it with "
                f"`contactlab schema --write {check}`"
            )
    elif name is None:
        for each in json_schemas():
            echo(each)
    else:
        known = json_schemas()
        found = known.get(name) or known.get(name + _SUFFIX)
        if found is None:
            names = [each.removesuffix(_SUFFIX) for each in known]
            raise SweepFileError(f"no schema '{name}'{did_you_mean(name, names)}")
        print_json(found)


def _written(folder: Path) -> list[str]:
    from contactlab.schema.json_schemas import write_json_schemas
    from contactlab.store.atomic_files import write_error

    try:
        return [path.name for path in write_json_schemas(folder)]
    except OSError as error:
        raise write_error(folder, error) from error
