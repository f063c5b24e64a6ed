"""`contactlab init`: a sweep file to start from."""

from pathlib import Path
from typing import Annotated

from contactlab.command_line.declaration import Argument, Option, command
from contactlab.command_line.surroundings import say
from contactlab.errors import OutputError
from contactlab.printable import shell_word


@command("run", examples=("init robot.xml -o robot.yaml",), codes="0 written, 2 bad input")
def init(
    scene: Annotated[
        str | Path,
        Argument("SCENE", "Scene, scene folder, .xml or .urdf file, or menagerie:ROBOT.", kind=str),
    ] = "ball_drop",
    *,
    output: Annotated[
        str | Path, Option("FILE", "Sweep file to write.", kind=Path, short="-o")
    ] = Path("sweep.yaml"),
) -> Path:
    """Write a starter sweep file for a model, with its JSON Schema.

    The path of the sweep file is returned.

    Raises:
        OutputError: the file exists, or cannot be written.
        SceneError: there is no such scene.
    """
    from contactlab.plan.starter import SCHEMA_NAME
    from contactlab.plan.sweep_file import read_sweep
    from contactlab.run.sweep_request import SceneLoader, starter_sweep
    from contactlab.scene.scene_source import reference_from
    from contactlab.schema.json_schemas import schema_texts
    from contactlab.store.atomic_files import write_errors

    path = Path(output)
    if path.exists():
        raise OutputError(f"{path} exists; choose another file with -o")
    with write_errors(path):
        path.parent.stat()
    loader, reference = SceneLoader(path.parent), reference_from(path.parent, str(scene))
    text = starter_sweep(reference, loader)
    plan = read_sweep(text, loader.vocabulary).plan
    schema_file = path.parent / SCHEMA_NAME
    with write_errors(path):
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
        schema_file.write_text(schema_texts()["sweep.schema.json"], encoding="utf-8")
    say(f"wrote {path}, {plan.count} runs of {plan.sweep.duration:g} s each, and {schema_file}")
    say(f"next: contactlab sweep {shell_word(path)}")
    return path
