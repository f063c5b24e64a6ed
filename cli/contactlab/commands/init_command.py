"""`contactlab init`: a commented sweep file to start from, and its schema for editors."""

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
    from contactlab.plan.starter import SCHEMA_NAME, starter
    from contactlab.run.sweep_request import SceneLoader
    from contactlab.schema.json_schemas import json_schemas
    from contactlab.store.atomic_files import write_error

    text = starter(scene, SceneLoader(path.parent).vocabulary(scene))
    schema = path.parent / SCHEMA_NAME
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
        published_text = json.dumps(json_schemas()["sweep.schema.json"], indent=2) + "\n"
        schema.write_text(published_text, encoding="utf-8")
    except FileExistsError as error:
        raise OutputError(f"{path} exists; choose another file with -o") from error
    except OSError as error:
        raise write_error(path, error) from error
    say(f"wrote {path} and {schema}\nnext: contactlab sweep {path}")
