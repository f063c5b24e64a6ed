"""`contactlab schema`: the JSON Schemas of files."""

import json
from pathlib import Path
from typing import Annotated, Any

from contactlab.command_line.declaration import Argument, Given, Option, command
from contactlab.command_line.surroundings import say
from contactlab.command_line.terminal import echo
from contactlab.errors import SweepFileError

_SUFFIX = ".schema.json"


def _text(found: dict[str, Any], given: Given) -> None:
    """Print one published schema, or the names of all."""
    from contactlab.schema.json_schemas import schema_texts

    if given["name"] is not None:
        text = schema_texts()
        echo((text.get(given["name"]) or text[given["name"] + _SUFFIX]).rstrip())
    elif given["write"] is None:
        echo("\n".join(found))


@command("extend", examples=("schema --write schemas",), formats={"text": _text})
def schema(
    name: Annotated[
        str | None, Argument("NAME", "Schema to print; lists all names by default.")
    ] = None,
    *,
    write: Annotated[
        str | Path | None, Option("FOLDER", "Write all schemas into a folder.", kind=Path)
    ] = None,
) -> dict[str, Any]:
    """Print or write the JSON Schemas of all files.

    A schema is returned as data; without a name all of them, by the names of their files.

    Raises:
        SweepFileError: there is no such schema.
        OutputError: the folder cannot be written.
    """
    from contactlab.schema.json_schemas import schema_texts
    from contactlab.store.atomic_files import write_errors

    known = schema_texts()
    if write is not None:
        folder = Path(write)
        with write_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
            for file, text in known.items():
                (folder / file).write_text(text, encoding="utf-8")
        say(f"wrote {', '.join(known)}")
    if name is None:
        return {file: json.loads(text) for file, text in known.items()}
    by_name = {file.removesuffix(_SUFFIX): text for file, text in known.items()}
    name = name.removesuffix(_SUFFIX)
    there = f"; there are {', '.join(by_name)}"
    SweepFileError.unless_known(name, by_name, f"no schema '{name}'", there)
    return json.loads(by_name[name])
