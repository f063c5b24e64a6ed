"""What the command line changes in a sweep file: `--set`, `--only` and `--limit`."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from contactlab.errors import did_you_mean
from contactlab.plan.diagnostics import Place, SourceText
from contactlab.plan.names import SweepContext
from contactlab.plan.yaml_document import Document, KeyPath, read_argument
from contactlab.schema import FORMS, Sweep

_ENTRIES = ("sample", "effects", "tolerances", "thresholds", "accuracy", "timing")
_CALL = re.compile(r"(\w+)\((.*)\)")


@dataclass(frozen=True)
class Overrides:
    """Options of the command line, as typed.

    Attributes:
        assign: `NAME=VALUES` or `NAME=FORM(...)`: replaces or adds an axis or a key of the file.
        only: `AXIS=VALUES`: keeps the runs that have one of the values; all must hold.
        limit: keeps the first so many runs.
    """

    assign: Sequence[str] = ()
    only: Sequence[str] = ()
    limit: int | None = None


@dataclass(frozen=True)
class ParsedOption:
    """One option, parsed: its name and value, and where each is."""

    name: str
    value: str
    key: Place
    place: Place


@dataclass(frozen=True)
class Filter:
    """Values of an axis that runs must have one of."""

    name: str
    values: tuple[object, ...]
    place: Place


def apply_settings(document: Document, settings: Sequence[str]) -> None:
    """Apply every `--set` to the document, with the places of its parts in the argument."""
    for text in settings:
        option = _option(document, "--set", text)
        if option is None:
            continue
        path = _path(option.name)
        if path[0] == "axes" and _in_zip(document, option.name):
            message = f"'{option.name}' advances with others in a zip block"
            document.add("set-zipped", option.key, message, "change the block in the file")
            continue
        value, other = _value(document, option, path)
        document.replace(path, value, other, option.key)


def read_filters(
    context: SweepContext, texts: Sequence[str], swept: Sequence[str]
) -> tuple[Filter, ...]:
    """Return every `--only` with canonical values; add their mistakes to the document.

    Args:
        context: the file and its names.
        texts: the options.
        swept: the axes that they may name.
    """
    filters: list[Filter] = []
    for text in texts:
        option = _option(context.document, "--only", text)
        if option is None or not _is_swept(context.document, option, swept):
            continue
        other = _pieces(option)
        context.document.found.extend(other.found)
        raw = cast("list[object]", other.data) if isinstance(other.data, list) else []
        values = [
            context.canonical(option.name, value, other.value((index,)))
            for index, value in enumerate(raw)
        ]
        filters.append(Filter(option.name, tuple(values), option.place))
    return tuple(filters)


def _is_swept(document: Document, option: ParsedOption, swept: Sequence[str]) -> bool:
    if option.name in swept:
        return True
    close = did_you_mean(option.name, swept).removeprefix("; ")
    hint = close or f"swept: {', '.join(swept) or 'nothing'}"
    document.add(
        "axis-not-swept", option.key, f"'{option.name}' is not an axis of this sweep", hint
    )
    return False


def check_values(
    document: Document, filters: Sequence[Filter], taken: Mapping[str, Mapping[object, None]]
) -> None:
    """Add a mistake for every filter whose axis never takes any of its values."""
    for each in filters:
        values = list(taken.get(each.name, ()))
        if not set(values).intersection(each.values):
            shown = ", ".join(str(value) for value in values[:8])
            more = ", ..." if len(values) > 8 else ""
            message = f"'{each.name}' never takes this value in this sweep"
            document.add("value-not-swept", each.place, message, f"it takes {shown}{more}")


def _option(document: Document, flag: str, text: str) -> ParsedOption | None:
    source = SourceText("command line", (f"{flag} {text}",), numbered=False)
    name, equals, value = text.partition("=")
    start = len(flag) + 2
    if not (name and equals and value.strip()):
        place = Place(source, 1, start, max(len(text), 1))
        document.add("bad-option", place, "an option takes a name and values", "NAME=VALUE,VALUE")
        return None
    place = Place(source, 1, start + len(name) + 1, len(value))
    return ParsedOption(name, value, Place(source, 1, start, len(name)), place)


def _path(name: str) -> KeyPath:
    head, _, rest = name.partition(".")
    if head in _ENTRIES and rest:
        return (head, rest)
    return (name,) if name in Sweep.model_fields else ("axes", name)


def _in_zip(document: Document, name: str) -> bool:
    blocks = document.at(("zip",))
    count = len(cast("list[object]", blocks)) if isinstance(blocks, list) else 0
    return any(name in document.mapping("zip", index) for index in range(count))


def _value(document: Document, option: ParsedOption, path: KeyPath) -> tuple[object, Document]:
    """Return the data that an option gives, and the places of its parts."""
    call = _CALL.fullmatch(option.value) if path[0] == "axes" else None
    value, other = _form(option, call) if call else _listed(option, path)
    document.found.extend(other.found)
    if other.found:
        # The name stays known, and nothing else is said of it.
        document.unreadable.update({option.key, option.place})
        return None, Document(other.source, None, {(): option.place})
    role = document.mapping(*path).get("role")
    if path[0] != "axes" or role is None:
        return value, other
    if isinstance(value, list):
        value, other = {"values": value}, _below(other, "values", option.place)
    return {**cast("dict[str, object]", value), "role": role}, other


def _listed(option: ParsedOption, path: KeyPath) -> tuple[object, Document]:
    other = _pieces(option)
    value = other.data
    if path[0] != "axes" and isinstance(value, list) and len(cast("list[object]", value)) == 1:
        return cast("list[object]", value)[0], _only_item(other)
    return value, other


def _form(option: ParsedOption, call: re.Match[str]) -> tuple[object, Document]:
    name = call.group(1)
    start = option.place.column + len(name) + 1
    other = read_argument(f"[{call.group(2)}]", option.place.source, start)
    below = _below(other, name, option.place)
    below.keys[(name,)] = option.place.part(0, len(name))
    if name not in FORMS:
        hint = did_you_mean(name, FORMS).removeprefix("; ") or f"one of: {', '.join(FORMS)}"
        below.add("unknown-key", below.keys[(name,)], f"no form '{name}'", hint)
    return {name: other.data}, below


def _pieces(option: ParsedOption) -> Document:
    return read_argument(f"[{option.value}]", option.place.source, option.place.column)


def _only_item(other: Document) -> Document:
    def lifted(places: dict[KeyPath, Place]) -> dict[KeyPath, Place]:
        return {path[1:]: place for path, place in places.items() if path}

    return Document(other.source, None, lifted(other.values), lifted(other.keys), other.found)


def _below(other: Document, name: str, place: Place) -> Document:
    def lowered(places: dict[KeyPath, Place]) -> dict[KeyPath, Place]:
        return {(name, *path): each for path, each in places.items()}

    values = {**lowered(other.values), (): place}
    return Document(other.source, None, values, lowered(other.keys), other.found)
