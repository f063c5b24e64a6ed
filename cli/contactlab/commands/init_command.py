"""`contactlab init`: a commented sweep file to start from, and its schema for editors."""

import errno
import json
from pathlib import Path
from typing import Annotated

import typer

from contactlab.commands.terminal import say
from contactlab.errors import OutputError


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
    from contactlab.run.starter_sweep import starter_sweep
    from contactlab.run.sweep_request import SceneLoader
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
    schema = path.parent / SCHEMA_NAME
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
        published_text = json.dumps(json_schemas()["sweep.schema.json"], indent=2) + "\n"
        schema.write_text(published_text, encoding="utf-8")
    except OSError as error:
        raise write_error(path, error) from error
    say(f"wrote {path}, {plan.count} runs of {plan.sweep.duration:g} s each, and {schema}")
    say(f"next: contactlab sweep {path}")
