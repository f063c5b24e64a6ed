"""The published JSON Schemas; their record is the folder `schemas`.

Keys, types and limits are results, titles and descriptions are words.
"""

import json
from collections.abc import Mapping
from pathlib import Path

from tests.guards.reading import nested_facts, parted
from tests.guards.records import Facts, Items

FOLDER = Path(__file__).parents[2] / "schemas"
_WORDS = {"title", "description"}


def made_schemas() -> dict[str, str]:
    """Return the text of every schema that the package makes, by file name."""
    from contactlab.schema.json_schemas import (  # noqa: PLC0415 - collection is quick without
        schema_texts,
    )

    return schema_texts()


def published_schemas(folder: Path = FOLDER) -> dict[str, str]:
    """Return the text of every schema in a folder, by file name."""
    files = sorted(folder.glob("*.schema.json"))
    return {file.name: file.read_text(encoding="utf-8") for file in files}


def schema_items(texts: Mapping[str, str]) -> tuple[Items, Items]:
    """Return the keys and limits of schemas, and their words."""
    results, words = dict[str, Facts](), dict[str, Facts]()
    for name, text in texts.items():
        results[name], words[name] = parted(nested_facts(json.loads(text)), _is_said)
    return {"schema": results}, {"schema": words}


def _is_said(name: str, value: object) -> bool:
    # A property may have one of these names, too, and is not a text then.
    return name in _WORDS and isinstance(value, str)


def reordered(published: Mapping[str, str], made: Mapping[str, str]) -> list[str]:
    """Return the schemas that differ from those that are made in order and layout alone."""
    return [
        name
        for name, text in published.items()
        if name in made and text != made[name] and json.loads(text) == json.loads(made[name])
    ]
