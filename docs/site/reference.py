"""The reference: commands, keys of files, labels, metrics, thresholds, functions, from the code."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import contactlab
from contactlab.command_line.declaration import is_declared

ROOT = Path(__file__).parents[2]
_TOOL = Path(sys.executable).with_name("contactlab")
_FILES = {
    "sweep": "The file of a sweep",
    "scene": "scene.yaml",
    "policy": "The policy of a comparison",
}
_CLASSES = (
    "contactlab.store.finished_store.Store",
    "contactlab.store.finished_store.Runs",
)
_GROUPS = ("baseline", "engines", "traces")


def write(folder: Path) -> tuple[str, ...]:
    """Write the pages into a folder; return their names from the folder above."""
    folder.mkdir()
    pages = {
        "commands": _commands(),
        "files": _file_keys(),
        "labels": _listed("labels", "Labels, the worst first"),
        "metrics": _listed("metrics", "Metrics"),
        "thresholds": _listed("thresholds", "Thresholds"),
        "functions": _functions(),
    }
    for name, lines in pages.items():
        (folder / f"{name}.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return tuple(f"{folder.name}/{name}" for name in pages)


def _said(*words: str) -> str:
    environment = {**os.environ, "COLUMNS": "100", "TERM": "dumb"}
    done = subprocess.run(  # noqa: S603 - our own command
        [_TOOL, *words], env=environment, capture_output=True, check=True, text=True
    )
    return done.stdout


def _commands() -> Iterator[str]:
    yield "# Commands"
    for name in _command_names(_said("--help")):
        yield from _command(name)
        if name in _GROUPS:
            for inner in _command_names(_said(name, "--help")):
                yield from _command(name, inner)


def _command(*words: str) -> Iterator[str]:
    yield f"\n## contactlab {' '.join(words)}\n"
    yield f"```text\n{_said(*words, '--help').strip()}\n```"


def _command_names(text: str) -> list[str]:
    return re.findall(r"^  ([a-z]+) {2,}\S", text, re.MULTILINE)


def _listed(command: str, title: str) -> Iterator[str]:
    rows: list[dict[str, Any]] = json.loads(_said(command, "--format", "json"))
    yield f"# {title}\n"
    yield from _table(list(rows[0]), ([str(each) for each in row.values()] for row in rows))


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    yield _row(head)
    yield _row(["---"] * len(head))
    for row in rows:
        yield _row([f"`{row[0]}`", *row[1:]])


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(each.replace("|", "\\|").replace("\n", " ") for each in cells) + " |"


def _file_keys() -> Iterator[str]:
    yield "# Keys of files\n\nThe schemas themselves: `contactlab schema NAME`."
    for name, title in _FILES.items():
        schema = json.loads((ROOT / f"schemas/{name}.schema.json").read_text(encoding="utf-8"))
        yield f"\n## {title}\n"
        yield from _keys(schema)
        for part, definition in schema["definitions"].items():
            if "properties" in definition:
                yield f"\n### {part}\n\n{definition.get('description', '')}\n"
                yield from _keys(definition)


def _keys(schema: Mapping[str, Any]) -> Iterator[str]:
    required = schema.get("required", ())
    rows = (
        (name, _kind(key), _default(key, needed=name in required), key.get("description", ""))
        for name, key in schema["properties"].items()
    )
    yield from _table(("key", "is", "default", "meaning"), rows)


def _default(key: Mapping[str, Any], *, needed: bool) -> str:
    if needed:
        return "required"
    return f"`{json.dumps(key['default'])}`" if "default" in key else ""


def _kind(key: Mapping[str, Any]) -> str:
    """Return what a schema allows, in a few words."""
    for union in ("oneOf", "anyOf", "allOf"):
        if union in key:
            return " or ".join(dict.fromkeys(_kind(each) for each in key[union]))
    if "$ref" in key:
        return key["$ref"].rpartition("/")[2]
    if "const" in key or "enum" in key:
        return ", ".join(f"`{each}`" for each in key.get("enum", [key.get("const")]))
    return _container(key)


def _container(key: Mapping[str, Any]) -> str:
    items, more, kinds = (key.get(name) for name in ("items", "additionalProperties", "type"))
    if kinds == "array":
        return f"list of {_kind(items)}" if isinstance(items, dict) else "list"
    if isinstance(more, dict):
        return f"name: {_kind(more)}"
    return " or ".join(kinds) if isinstance(kinds, list) else kinds or "object"


def _functions() -> Iterator[str]:
    yield "# Functions\n\n```{eval-rst}"
    for name in contactlab.__all__:
        if isinstance(found := getattr(contactlab, name), ModuleType):
            commands = [command for command in vars(found).values() if is_declared(command)]
            yield from (f".. autofunction:: {found.__name__}.{one.__name__}" for one in commands)
        elif not name.startswith("_"):
            yield f".. autofunction:: contactlab.{name}"
    for name in _CLASSES:
        yield f".. autoclass:: {name}\n   :members:"
    yield "```"
