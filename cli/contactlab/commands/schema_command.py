"""`contactlab schema`: print or check the published JSON Schemas."""

from pathlib import Path
from typing import Annotated

import typer

from contactlab.commands.terminal import print_json, say
from contactlab.errors import ExpectationError, SweepFileError, did_you_mean

_SUFFIX = ".schema.json"


def schema(
    name: Annotated[str | None, typer.Argument(help="Which one; all names if left out.")] = None,
    write: Annotated[Path | None, typer.Option(help="Write all of them into a folder.")] = None,
    check: Annotated[Path | None, typer.Option(help="Check a folder of them.")] = None,
) -> None:
    """Print, write or check the JSON Schemas of the files that contactlab reads and writes."""
    from contactlab.schema import json_schemas, schema_drift, write_json_schemas

    if write is not None:
        from contactlab.store import write_error

        try:
            names = [path.name for path in write_json_schemas(write)]
        except OSError as error:
            raise write_error(write, error) from error
        say(f"wrote {', '.join(names)}")
    elif check is not None:
        differs = schema_drift(check)
        if differs:
            raise ExpectationError(
                f"{check} is out of date: {', '.join(differs)}; write it anew with "
                f"`contactlab schema --write {check}`"
            )
    elif name is None:
        for each in json_schemas():
            typer.echo(each)
    else:
        known = json_schemas()
        found = known.get(name) or known.get(name + _SUFFIX)
        if found is None:
            names = [each.removesuffix(_SUFFIX) for each in known]
            raise SweepFileError(f"no schema '{name}'{did_you_mean(name, names)}")
        print_json(found)
