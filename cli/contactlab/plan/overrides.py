"""Changes of a sweep file by the command line: `--set`, `--where` and `--limit`."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, cast

from pydantic import ValidationError

from contactlab.errors import SweepFileError, did_you_mean, suggestion
from contactlab.plan.diagnostics import Place, SourceText
from contactlab.plan.grid import Grid
from contactlab.plan.names import add_not_swept
from contactlab.plan.rows import SweepContext, parse_unit_range, zip_blocks
from contactlab.plan.yaml_document import Document, KeyPath, read_argument
from contactlab.schema.drive import DRIVE_WORDS, Drive, read_drive
from contactlab.schema.sweep_schema import Sweep
from contactlab.schema.vocabulary import FORMS

_ENTRIES = (
    "sample",
    "refine",
    "limit",
    "until",
    "search",
    "effects",
    "tolerances",
    "thresholds",
    "accuracy",
    "timing",
)
# Address of an object without a name, which YAML would read as a list; not within quotes.
_ADDRESS = re.compile(r"(?<![\w\"'])[a-z]+\[\d+\]")
_CALL = re.compile(r"(\w+)\((.*)\)")


class FlagSetting(str):
    """A setting `NAME=VALUE` from its own flag: `--keyframe home` is `keyframe=home`."""

    __slots__ = ("flag",)

    def __new__(cls, setting: str, flag: str) -> Self:
        """Return the setting, with the flag."""
        instance = super().__new__(cls, setting)
        instance.flag = flag
        return instance


@dataclass(frozen=True)
class Overrides:
    """Options of the command line, as typed."""

    assign: Sequence[str] = ()
    """`NAME=VALUES` or `NAME=FORM(...)`: replaces or adds an axis or a key of the file."""
    where: Sequence[str] = ()
    """`AXIS=VALUES`: keeps the runs with one of these values; several must all hold."""
    limit: int | None = None  # number of runs to keep, from the first


@dataclass(frozen=True)
class ParsedOption:
    """One option, parsed: its name and value, and the place of each."""

    name: str
    value: str
    key: Place
    place: Place


@dataclass(frozen=True)
class Filter:
    """Values of an axis; a run must have one of them."""

    name: str
    values: tuple[object, ...]
    place: Place


def drive_option(text: str | None) -> Drive | None:
    """Return the drive that `--drive` names; raise SweepFileError for other texts."""
    try:
        return None if text is None else read_drive(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = [f"{part}:" for part in first["loc"] if not str(part).startswith("@")]
        # A word that begins one of the forms is not a misspelled word.
        near = "" if text in {"noise", "kp"} else did_you_mean(text or "", DRIVE_WORDS)
        advice = first["msg"].replace("Input should be '", "write '")
        advice = advice.replace("Input should be a valid", "write a valid")
        advice = advice.replace("Input should be", "write a number")
        if first["type"] == "drive_form":
            advice = (
                f"write {', '.join(DRIVE_WORDS)}, noise=0.3,rate=10, kp=400,kd=10,rate=500, "
                "FILE.csv or FILE.py:CLASS"
            )
        problem = " ".join([f"--drive {text}:", *where, advice])
        raise SweepFileError(f"{problem}{near}") from error


def apply_settings(document: Document, settings: Sequence[str]) -> None:
    """Apply every `--set` to the document, with the places of its parts in the argument."""
    for option in filter(None, (_parse_option(document, "--set", text) for text in settings)):
        head, _, rest = option.name.partition(".")
        # An effect has the name of an entry, which is a mapping.
        effect = option.name == "limit" and not option.value.startswith("{")
        path: KeyPath = ("axes", option.name)
        if head in _ENTRIES and rest:
            path = (head, rest)
        elif option.name in Sweep.model_fields and not effect:
            path = (option.name,)
        if path[0] == "axes" and any(option.name in block for _, block in zip_blocks(document)):
            message = f"'{option.name}' is an axis of a zip block"
            document.add_mistake("set-zipped", option.key, message, "change the block in the file")
        else:
            role, mistake_count = document.mapping_at(*path).get("role"), len(document.mistakes)
            parent = document.replace_value(path, option.key)
            document.values[path] = option.place
            if path[0] == "axes":
                value = _axis_value(document, option, path, role)
            else:
                value = _listed_values(document, option, path)
                if len(value) == 1:
                    # Without the brackets, since a single value is not a list.
                    place = option.place
                    value = read_argument(
                        document, path, f" {option.value} ", place.source, place.column
                    )
            if len(document.mistakes) > mistake_count:
                # The name stays known, and no further mistakes are reported for it.
                document.unreadable |= {option.key, option.place}
                document.values[path] = option.place
                value = None
            parent[str(path[-1])] = value


def _axis_value(document: Document, option: ParsedOption, path: KeyPath, role: object) -> object:
    role_entry = {} if role is None else {"role": role}
    call, place = _CALL.fullmatch(option.value), option.place
    if option.value == "all":
        return "all"
    if form := parse_unit_range(option.value):
        return {**form, **role_entry}
    if call is None:
        values = _listed_values(document, option, (*path, "values") if role_entry else path)
        return {"values": values, **role_entry} if role_entry else values
    form = (*path, call[1])
    document.keys[form] = place.narrow_range(0, len(call[1]))
    if call[1] not in FORMS:
        hint = suggestion(call[1], FORMS) or f"one of: {', '.join(FORMS)}"
        document.add_mistake("unknown-key", document.keys[form], f"no form '{call[1]}'", hint)
    column = place.column + call.start(2)
    return {
        call[1]: read_argument(document, form, f"[{call[2]}]", place.source, column),
        **role_entry,
    }


def read_filters(
    context: SweepContext, texts: Sequence[str], swept: Sequence[str]
) -> tuple[Filter, ...]:
    """Read every `--where` of a swept axis, with canonical values; add their mistakes."""
    filters: list[Filter] = []
    options = (_parse_option(context.document, "--where", text) for text in texts)
    for option in filter(None, options):
        if option.name not in swept:
            add_not_swept(context, option.name, option.key, swept)
            continue
        path = ("--where", option.name)
        values = tuple(
            context.canonical_value(
                option.name, value, context.document.value_place((*path, index))
            )
            for index, value in enumerate(_listed_values(context.document, option, path))
        )
        filters.append(Filter(option.name, values, option.place))
    return tuple(filters)


def check_values(document: Document, filters: Sequence[Filter], grid: Grid) -> None:
    """Add a mistake for every filter with values that its axis never takes."""
    for condition in filters:
        values = grid.axis_values(condition.name)
        if not set(values).intersection(condition.values):
            first = ", ".join(str(value) for value in values[:8])
            more = ", ..." if len(values) > 8 else ""
            message = f"'{condition.name}' never takes this value in this sweep"
            document.add_mistake(
                "value-not-swept", condition.place, message, f"it takes {first}{more}"
            )


def _parse_option(document: Document, flag: str, text: str) -> ParsedOption | None:
    source = SourceText("command line", (f"{flag} {text}",), numbered=False)
    name, equals, value = text.partition("=")
    start = len(flag) + 2
    if not (name and equals and value.strip()):
        place = Place(source, 1, start, max(len(text), 1))
        document.add_mistake(
            "bad-option", place, "an option takes a name and values", "NAME=VALUE,VALUE"
        )
        return None
    quoted = _ADDRESS.sub(r'"\g<0>"', value)
    if isinstance(text, FlagSetting):
        source = SourceText("command line", (f"{text.flag} {value}",), numbered=False)
        place = Place(source, 1, len(text.flag) + 2, len(value))
        return ParsedOption(name, quoted, place, place)
    place = Place(source, 1, start + len(name) + 1, len(value))
    return ParsedOption(name, quoted, Place(source, 1, start, len(name)), place)


def _listed_values(document: Document, option: ParsedOption, path: KeyPath) -> list[object]:
    place = option.place
    data = read_argument(document, path, f"[{option.value}]", place.source, place.column)
    return cast("list[object]", data) if isinstance(data, list) else []
