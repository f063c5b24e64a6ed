"""Write the pages of docs/reference that list names: `python -m docs.generate`, by `make schemas`.

Each page is read from the entries that it lists, where an entry is declared once.
"""

import json
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import contactlab.plugin  # noqa: F401 - fills the registries  # pyright: ignore[reportUnusedImport]
from contactlab.command_line.declaration import TITLES, Command
from contactlab.command_line.modules import command_modules, commands_of
from contactlab.command_line.parser import adapt_command
from contactlab.measure import LABELS, METRICS, THRESHOLDS
from contactlab.modifications.catalogue import CATALOGUE
from contactlab.modifications.modification import Modification
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.parameters import PARAMETERS
from contactlab.store.table_layout import FIXED_COLUMNS, LOOP_COLUMNS, PLUGINS_COLUMN
from contactlab.studies.explain.glossary import read_glossary
from contactlab.studies.lint.linting import RULES

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs/reference"
FILES = {"sweep": "Sweep file", "scene": "scene.yaml", "policy": "Policy of `compare`"}
LEVELS = {"gate": "Error", "warn": "Warning", "note": "Note"}
CONTEXTS = frozenset(
    {
        "verdict of a model",
        "error budget",
        "task",
    }
)
"""Contexts of terms that more than one page uses; `contactlab explain WORD` has all terms."""
KNOWN_ARGUMENTS = frozenset({"STORE", "MODEL", "MODEL...", "SCENE"})
"""Arguments that the head of the page explains."""
KINDS = {"computation": "The same model, computed differently", "model": "Another model"}
"""Kinds of modifications, as headings."""
REPEATED = "; may be repeated"
"""Part of the help of options that the page marks by dots."""
SHARED = 3
"""An option of at least this number of commands is described once, before all commands."""


@dataclass(frozen=True)
class Page:
    """A page: its title, its first sentences, and the function that yields its lines."""

    title: str
    introduction: str
    lines: Callable[[], Iterator[str]]


@dataclass(frozen=True)
class CommandOption:
    """An option: its usage, with dots if it may be repeated, and its help."""

    flags: str
    help: str


def list_commands() -> Iterator[str]:
    """Yield the lines of the page of commands: shared options first, then each command."""
    commands = [command for module in command_modules() for command in commands_of(module)]
    users = defaultdict[CommandOption, list[str]](list)
    for command in commands:
        for option in read_options(command):
            users[option].append(command.name)
    shared = {option: names for option, names in users.items() if len(names) >= SHARED}
    yield "Options of several commands, most studies unless some are named:\n"
    for option, names in sorted(shared.items(), key=lambda each: each[0].flags):
        some = f" ({', '.join(sorted(names))})" if len(names) <= SHARED + 1 else ""
        yield f"`{option.flags}`{some}: {option.help}\n"
    for group, title in TITLES.items():
        yield f"\n## {title}"
        for command in sorted(commands, key=lambda each: each.name):
            if command.group == group:
                yield from list_command(command, shared)


def list_command(command: Command, shared: Iterable[CommandOption]) -> Iterator[str]:
    """Yield usage, summary and own options of a command."""
    summary = (command.function.__doc__ or "").partition("\n")[0]
    parameters = adapt_command(command).__dict__["__signature__"].parameters.values()
    arguments = [each for each in parameters if not getattr(each.default, "param_decls", None)]
    usage = " ".join([command.name, *(each.default.metavar for each in arguments)])
    yield f"\n### {command.name}\n\n`{usage}` {summary}\n"
    yield from (
        f"{each.default.metavar}: {each.default.help}\n"
        for each in arguments
        if each.default.metavar not in KNOWN_ARGUMENTS
    )
    yield from (
        f"`{option.flags}`: {option.help}\n"
        for option in read_options(command)
        if option not in shared
    )


def read_options(command: Command) -> Iterator[CommandOption]:
    """Yield the options of a command."""
    for name, parameter in adapt_command(command).__dict__["__signature__"].parameters.items():
        option = parameter.default
        flags = getattr(option, "param_decls", None)
        if flags and flags[-1] != "--format":
            value = option.metavar or ("" if isinstance(option.default, bool) else name.upper())
            usage = " ".join([*flags[-1:], *filter(None, [value])])
            dots = "..." if REPEATED in option.help else ""
            yield CommandOption(f"{usage}{dots}", option.help.replace(REPEATED, ""))


def list_keys() -> Iterator[str]:
    """Yield the keys of the files that people write, each shared part once."""
    parts, known = dict[str, Mapping[str, Any]](), dict[tuple[str, str], str]()
    for name, title in FILES.items():
        schema = json.loads((ROOT / f"schemas/{name}.schema.json").read_text(encoding="utf-8"))
        parts |= {part: each for part, each in schema["definitions"].items() if part not in parts}
        yield f"\n## {title}\n"
        yield from describe_keys(schema, title, known)
    yield "\n## Parts"
    for part, schema in sorted(parts.items()):
        if "properties" in schema:
            summary = schema.get("description", "").partition("\n")[0]
            yield f"\n### {part}\n\n{summary}\n"
            yield from describe_keys(schema, part, known)


def describe_keys(
    schema: Mapping[str, Any], part: str, known: dict[tuple[str, str], str]
) -> Iterator[str]:
    """Yield each key of a mapping: its form, default and meaning, unless that is known already."""
    for name, key in schema["properties"].items():
        if name in ("version", "description", "title", "sha256"):
            continue
        meaning = key.get("description", "")
        default = key.get("default")
        kind = spell_kind(key)
        # A word of a part leads to its keys; a meaning says its own kind.
        notes = [kind] if not meaning or not kind.islower() else []
        if name in schema.get("required", ()):
            notes.append("required")
        elif default not in (None, "", [], {}):
            notes.append(f"default {default}")
        before = known.setdefault((name, meaning), part)
        text = f"as in {before}" if before != part and meaning else meaning
        note = f" ({', '.join(notes)})" if notes else ""
        yield f"`{name}`{note}{': ' if text else ''}{text}\n"


def spell_kind(key: Mapping[str, Any]) -> str:
    """Return the values that a schema allows, in few words."""
    for union in ("oneOf", "anyOf", "allOf"):
        if union in key:
            kinds = dict.fromkeys(spell_kind(each) for each in key[union])
            # Every value of an axis may be of several kinds, which its text says.
            return "|".join(kinds) if len(kinds) <= 3 else "any"
    if "$ref" in key:
        return key["$ref"].rpartition("/")[2]
    if "const" in key or "enum" in key:
        return "|".join(f"{each}" for each in key.get("enum", [key.get("const")]))
    if isinstance(more := key.get("additionalProperties"), dict):
        return f"name: {spell_kind(more)}"
    if key.get("type") == "array" and isinstance(key.get("items"), dict):
        return f"list of {spell_kind(key['items'])}"
    kinds = key.get("type", "object")
    return "|".join(kinds) if isinstance(kinds, list) else kinds


def list_columns() -> Iterator[str]:
    """Yield all columns of a table that records have."""
    for column in (*FIXED_COLUMNS, PLUGINS_COLUMN, *LOOP_COLUMNS):
        unit = f" [{column.unit}]" if column.unit not in ("", "1") else ""
        yield f"`{column.name}`{unit}: {column.description}\n"


def list_terms() -> Iterator[str]:
    """Yield the terms of the glossary, by the place where they are printed."""
    context = ""
    for term in read_glossary():
        if term.context not in CONTEXTS:
            continue
        if term.context != context:
            context = term.context
            yield f"\n## {context[0].upper()}{context[1:]}\n"
        yield f"**{term.word}**: {term.definition}\n"


def list_labels() -> Iterator[str]:
    """Yield the labels, and the limits that they read."""
    for label in LABELS.values():
        limits = f" (`{'`, `'.join(each.name for each in label.thresholds)}`)"
        meaning = first_sentence(label.meaning)
        yield f"`{label.name}`{limits if label.thresholds else ''}: {meaning}\n"
    yield "\n## Limits\n\nA sweep or a scene replaces a default by its key `thresholds`.\n"
    for limit in THRESHOLDS.values():
        unit = f" {limit.unit}" if limit.unit != "1" else ""
        default = "unset" if limit.default is None else f"{limit.default:g}{unit}"
        yield f"`{limit.name}` ({default}): {limit.source}\n"


def list_metrics() -> Iterator[str]:
    """Yield the metrics with their units."""
    for metric in METRICS.values():
        unit = f" [{metric.unit}]" if metric.unit != "1" else ""
        yield f"`{metric.name}`{unit}: {first_sentence(metric.definition)}\n"


def first_sentence(text: str) -> str:
    """Return the first sentence; a period in an abbreviation has no space and capital behind it."""
    return re.split(r"(?<=\.) (?=[A-Z])", text)[0]


def list_parameters() -> Iterator[str]:
    """Yield the axes that every scene has, and the effects that a sweep can switch."""
    for axis in PARAMETERS.values():
        unit = f" [{axis.unit}]" if axis.unit not in ("", "1") else ""
        words = f" ({', '.join(axis.choices)})" if axis.choices else ""
        yield f"`{axis.name}`{unit}: {axis.description}{words}\n"
    yield "\n## Effects\n\nThe key `effects` switches these.\n"
    for effect in EFFECTS.values():
        yield f"`{effect.name}`: {effect.what}\n"


def list_modifications() -> Iterator[str]:
    """Yield the entries of the catalogue by kind, with their edits and their uses."""
    for kind, title in KINDS.items():
        yield f"\n## {title}\n"
        yield from (
            f"{describe_modification(entry)}\n"
            for entry in CATALOGUE.values()
            if entry.kind == kind
        )


def describe_modification(entry: Modification) -> str:
    """Return an entry of the catalogue as a line."""
    notes = [*(["safeguard"] if entry.safeguard else []), *(f"`{name}`" for name in entry.edits)]
    uses = "; ".join(list_uses(entry)) or "not tried yet"
    labels = f" Against {', '.join(entry.labels)}." if entry.labels else ""
    return f"**{entry.name}** ({', '.join(notes)}): {entry.summary} {uses}.{labels}"


def list_uses(entry: Modification) -> Iterator[str]:
    """Yield each use of a modification: rows, fixes, and the commands that try it."""
    uses = {
        "row": [row.name for row in entry.rows],
        "fix": [fix.name for fix in entry.fixes],
        "`--apply`": [fix.apply for fix in entry.part_fixes],
        "`tune --apply`": [one.name for one in entry.reductions if not one.is_exact],
    }
    yield from (f"{use} {', '.join(names)}" for use, names in uses.items() if names)
    commands = {
        "tune": entry.levers,
        "effects": [*entry.features, *entry.removals],
        "grip": entry.grip_fixes,
        "success": entry.variants,
    }
    if names := [name for name, uses in commands.items() if uses]:
        yield f"by {', '.join(names)}"


def list_rules() -> Iterator[str]:
    """Yield the rules of lint, each under its name, the target of links in findings."""
    for rule in RULES.values():
        fix = "".join(rule.details.partition("Fix: ")[1:])
        yield f"\n## {rule.name}\n\n{LEVELS[rule.level]}. {rule.about} {fix}".rstrip()


PAGES: Mapping[str, Page] = {
    "commands": Page(
        "Commands",
        "A MODEL or SCENE is a shipped scene, a folder, an .xml or .urdf file or menagerie:ROBOT; "
        "a STORE a folder or s3://BUCKET/PREFIX. `--format json` prints results for programs; "
        "`--help` has the formats of a command. An option with dots may be repeated. Exit codes: "
        "0 success, 1 not as expected, 2 bad input, 3 unreadable evidence, 4 runs crashed or timed "
        "out, 70 internal fault, 130 interrupted.",
        list_commands,
    ),
    "parameters": Page(
        "Parameters and effects",
        "The axes of every scene. `contactlab list axes SCENE` adds those of a scene.",
        list_parameters,
    ),
    "metrics": Page(
        "Metrics",
        "Units are SI. A metric that does not apply to a run is null. `contactlab explain METRIC` "
        "has the whole definition.",
        list_metrics,
    ),
    "labels": Page(
        "Labels, the worst first",
        "A run has each label that applies; the worst is its `label`. In brackets are its limits. "
        "`contactlab explain LABEL` has the whole meaning and the recommended change.",
        list_labels,
    ),
    "columns": Page(
        "Columns of runs.parquet",
        "Each axis and each metric has a column, too. Many are null in a whole store: `contactlab "
        "show STORE --format csv` prints the numbers and labels that have a value. `plugins` is "
        "in tables of sweeps with plug-ins, the last three in those of recorded loops.",
        list_columns,
    ),
    "lint": Page(
        "Rules of lint",
        "`contactlab lint` prints them with lines ([how-to](../how-to/lint.md)), `contactlab "
        "explain RULE` the criterion. An error fails the job. Runs of a model that breaks "
        "`welded-root`, `nothing-below`, `coincident-geoms`, `radians-as-degrees`, "
        "`degrees-as-radians`, or that starts from a keyframe and breaks `no-actuators` or "
        "`keyframe-length`, say nothing of the robot that its author meant: its verdict is "
        "`fails`.",
        list_rules,
    ),
    "modifications": Page(
        "Modifications",
        "A modification is one thing that a command may change in a model. In brackets are the "
        "edited settings. A *safeguard* protects runs that a task does not show, so nothing "
        "removes it.",
        list_modifications,
    ),
    "glossary": Page(
        "Glossary",
        "`contactlab explain WORD` has these words, and those of single tables.",
        list_terms,
    ),
}
"""The pages of docs/reference, by their files."""
KEYS = Page(
    "Keys of files",
    "Values with units are numbers in SI, or text: `2s`, `1mm`, `5%`.",
    list_keys,
)
"""A page of the site alone: the folder schemas has the same descriptions."""


def write_page(page: Page) -> str:
    """Return the text of a page."""
    head = f"# {page.title}\n\nWritten by `make schemas`. {page.introduction}\n"
    text = "\n".join([head, *page.lines()]) + "\n"
    return re.sub(r"\n{3,}", "\n\n", text)


if __name__ == "__main__":
    for file, contents in PAGES.items():
        (FOLDER / f"{file}.md").write_text(write_page(contents), encoding="utf-8")
