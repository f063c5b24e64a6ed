"""`contactlab schema`: print, write or check the published JSON Schemas."""

from pathlib import Path
from typing import Annotated

import typer

from contactlab.commands.terminal import echo, print_json, say
from contactlab.errors import ExpectationError, SweepFileError, did_you_mean

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
        _write(write)
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


def _write(folder: Path) -> None:
    from contactlab.schema.json_schemas import write_json_schemas
    from contactlab.store.atomic_files import write_error

    try:
        names = [path.name for path in write_json_schemas(folder)]
    except OSError as error:
        raise write_error(folder, error) from error
    say(f"wrote {', '.join(names)}")
