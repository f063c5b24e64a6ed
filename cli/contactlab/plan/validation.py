"""Validates a document against its model, with each mistake at its place in the file.

Valid parts are kept as a draft for further checks, so that one pass finds all mistakes.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Union, cast, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from contactlab.errors import suggestion
from contactlab.plan.mistakes import MISTAKES
from contactlab.plan.yaml_document import Document, KeyPath
from contactlab.schema.drive import DRIVE_FORMS, DRIVE_WORDS
from contactlab.schema.requirement import said_now
from contactlab.schema.setting_values import split_unit, without_unit
from contactlab.schema.sweep_schema import Sweep, scene_reference
from contactlab.schema.vocabulary import FORMS

_WANTED_KINDS = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a word",
    "bool_type": "true or false",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "tuple_type": "a list",
}
_MISTAKE_CODES = {
    "finite_number": "not-finite",
    **dict.fromkeys(
        ("greater_than", "greater_than_equal", "less_than", "less_than_equal"), "out-of-range"
    ),
    **dict.fromkeys(("string_too_short", "literal_error", "string_pattern_mismatch"), "bad-value"),
}
_COUNTED_FORMS = set(FORMS) - {"values"}
_KIND_EXAMPLES = {
    "a mapping": "write NAME: VALUE",
    "a list": "write [VALUE, VALUE]",
    "a number": "write a number, such as 2",
    "a whole number": "write a whole number, such as 2",
    "true or false": "write true or false",
    "a word": "write a word",
}
_KEY_EXAMPLES: Mapping[str, str] = {
    "version": "write version: 1",
    "duration": "write 2 or 2s",
    "timeout": "write 60 or 1min",
    "axes": "write axes: {timestep: [1e-3, 2e-3]}",
    "seeds": "write a count above 0, or a list such as [0, 7]",
    "range": "write [first, last, step], with a step above 0 for a last above the first",
    "drive": "",
}
_EMPTY_FILE_HINT = (
    "begin with `version: 1`, `scene: NAME` and `axes:`; `contactlab init` writes one"
)


def add_validation_errors(
    document: Document, error: ValidationError, model: type[BaseModel] = Sweep
) -> None:
    """Add every validation error to the document, once each, at its place."""
    reported: set[tuple[str, KeyPath]] = set()
    details = error.errors(include_url=False)
    paths = [file_path(detail["loc"]) for detail in details]
    above = {path[:length] for path in paths for length in range(len(path))}
    for detail, exact in zip(details, paths, strict=True):
        if detail["type"] == "too_short" and exact in above:
            continue
        entry_of_form = detail["type"] in {"missing", "too_long"} and _is_form(exact[:-1])
        path = exact[:-1] if entry_of_form else exact
        if (detail["type"], path) not in reported:
            reported.add((detail["type"], path))
            kind = detail["type"]
            if kind == "extra_forbidden":
                _add_unknown_key(document, path, _model_at(detail["loc"][:-1], model))
            elif kind == "axis_form":
                _add_axis_form(document, path)
            elif kind in {"missing", "too_long", "too_short"}:
                _add_length(document, kind, path)
            elif kind in _WANTED_KINDS:
                _add_type(document, _WANTED_KINDS[kind], path)
            else:
                _add_value(document, detail, path)


def file_path(loc: tuple[str | int, ...]) -> KeyPath:
    """Return the path of an error in the file: its location without the tags of unions."""
    return tuple(part for part in loc if not (isinstance(part, str) and part.startswith("@")))


def _is_form(path: KeyPath) -> bool:
    return len(path) > 2 and path[-1] in _COUNTED_FORMS and path[0] in {"axes", "zip"}


def _add_unknown_key(document: Document, path: KeyPath, model: type[BaseModel]) -> None:
    name = str(path[-1])
    known_keys = [field.alias or key for key, field in model.model_fields.items()]
    hint = suggestion(name, known_keys) or f"known here: {', '.join(known_keys)}"
    hint = "an axis takes one form" if name in FORMS else hint
    if path == (name,) and name in {"keyframe", "start"}:
        hint = "the start is an axis: write axes: {keyframe: [NAME]}, or use --keyframe NAME"
    if path in {("model",), ("mjcf",), ("file",)}:
        hint = "write scene: MODEL.xml"
    hint = said_now(path, document.value_at(path)) or hint
    document.add_mistake("unknown-key", document.key_place(path), f"unknown key '{name}'", hint)


def _add_axis_form(document: Document, path: KeyPath) -> None:
    data, name = document.value_at(path), path[-1]
    forms = f"one of: {', '.join(FORMS)}"
    keys = [key for key in document.mapping_at(*path) if key != "role"]
    if keys:
        hint = suggestion(keys[0], FORMS) or forms
        document.add_mistake(
            "unknown-key", document.key_place((*path, keys[0])), f"no form '{keys[0]}'", hint
        )
    elif data is None or isinstance(data, dict):
        hint = "write a list: [...]" if data is None else forms
        document.add_mistake("empty-axis", path, f"axis '{name}' has no values", hint)
    else:
        value = data if (plain := without_unit(data)) is None else f"{plain:g}"
        document.add_mistake("wrong-type", path, f"axis '{name}' takes a list", f"write [{value}]")


def _add_length(document: Document, kind: str, path: KeyPath) -> None:
    name = path[-1]
    if _is_form(path):
        description = (FORMS[str(name)].model_fields[str(name)].description or "").split(":")[0]
        example = f"write {{{name}: {description}}}"
        document.add_mistake("wrong-length", path, f"'{name}' takes {description}", example)
    elif kind == "missing":
        place = document.key_place(path[:-1]) if path[:-1] else document.value_place(())
        example = {"version": "1", "scene": "NAME"}.get(str(name), "...")
        hint = f"add {name}: {example}"
        document.add_mistake("missing-key", place.narrow_range(0, 1), f"missing key '{name}'", hint)
    elif axis := path[1:2] if path[0] == "axes" else path[2:3] if path[0] == "zip" else ():
        hint = "write some, or leave the axis out"
        document.add_mistake("empty-axis", path, f"axis '{axis[0]}' has no values", hint)
    else:
        many, hint = ("many", "leave some out") if kind == "too_long" else ("few", "add one")
        document.add_mistake(
            "wrong-length", path, f"'{_innermost_key(path)}' has too {many} entries", hint
        )


def _innermost_key(path: KeyPath) -> str:
    return next((part for part in reversed(path) if isinstance(part, str)), "")


def _add_type(document: Document, kind_words: str, path: KeyPath) -> None:
    data = document.value_at(path)
    kinds = "a mapping" if isinstance(data, dict) else "a list"
    actual = "nothing" if data is None else kinds if isinstance(data, dict | list) else repr(data)
    name = _innermost_key(path)
    subject = f"'{name}' takes" if name else "the file is"
    place = document.key_place(path) if data is None and path else document.value_place(path)
    hint = _KEY_EXAMPLES.get(name, _KIND_EXAMPLES.get(kind_words, "")) if path else _EMPTY_FILE_HINT
    if path and split_unit(data)[1]:
        hint = "write a number, or one with the unit of this metric" if name != "duration" else hint
    message = (
        f"{subject} {kind_words}, not {actual}" if path or data is not None else "the file is empty"
    )
    document.add_mistake("wrong-type", place, message, hint)


def _add_value(document: Document, detail: ErrorDetails, path: KeyPath) -> None:
    kind, input_text = detail["type"], str(detail["input"])
    wording, hint = detail["msg"].replace("a finite number", "finite"), ""
    wording = wording.replace("Input should be", "must be").replace("String should", "must")
    if kind == "string_pattern_mismatch":
        wording = f"has no choice {input_text!r}"
        hint = "write all, flagged, none, sample:N or flagged+sample:N"
    if kind == "literal_error":
        choices = str(detail.get("ctx", {}).get("expected", "")).replace("'", "")
        hint = (
            suggestion(input_text, choices.replace(" or ", ", ").split(", ")) or f"write {choices}"
        )
    if kind == "drive_form":
        hint = suggestion(input_text, DRIVE_WORDS) or "write one of these"
    key = _innermost_key(path)
    name = f"'{key}' " if key else ""
    hint = hint or _KEY_EXAMPLES.get(key, "write a finite number" * (kind == "finite_number"))
    bound = re.search(r"(greater|less) than (or equal to )?([-+.\de]+)$", wording)
    if bound and not hint:
        side = "above" if bound[1] == "greater" else "below"
        hint = f"write a number {f'of {bound[3]}, or one ' if bound[2] else ''}{side} {bound[3]}"
    code = _MISTAKE_CODES.get(kind, kind.replace("_", "-"))
    document.add_mistake(code if code in MISTAKES else "bad-value", path, f"{name}{wording}", hint)


def _model_at(loc: tuple[str | int, ...], model: type[BaseModel]) -> type[BaseModel]:
    tagged = {**FORMS, **DRIVE_FORMS}
    for part in loc:
        if isinstance(part, str) and part.startswith("@") and part[1:] in tagged:
            model = tagged[part[1:]]
        elif part in model.model_fields:
            model = next(_models_in(model.model_fields[str(part)].annotation), model)
    return model


def _models_in(annotation: object) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif get_origin(annotation) in {Annotated, Union, UnionType, tuple, dict}:
        for part in get_args(annotation):
            yield from _models_in(part)


@dataclass(frozen=True)
class Draft:
    """A sweep file without the entries that cannot be read."""

    document: Document
    sweep: Sweep  # the valid entries
    scene: object  # as the file names it, whether or not that is valid
    kept_positions: Mapping[str, Sequence[int]]
    """For every list that lost entries, the positions of the others in the file."""

    def entry_path(self, key: str, index: int, *below: str | int) -> KeyPath:
        """Return the path in the file of an entry of one of the sweep's lists."""
        positions = self.kept_positions.get(key)
        return (key, positions[index] if positions else index, *below)


def read_draft(document: Document) -> Draft:
    """Check a document against the model of a sweep. Add its mistakes."""
    try:
        sweep = Sweep.model_validate(document.data)
        return Draft(document, sweep, sweep.scene, {})
    except ValidationError as error:
        add_validation_errors(document, error)
        remaining = error
    # Leave out the wrong entries of keys and lists or, if others depend on these, the whole keys.
    data, positions = document.mapping_at(), dict[str, list[int]]()
    scene = scene_reference(document.value_at(("scene",)))
    for depth in (2, 1):
        data, lists = _prune_errors(data, remaining, depth)
        positions |= lists
        try:
            sweep = Sweep.model_validate({"version": 1, "scene": "?", **data})
            return Draft(document, sweep, scene, positions)
        except ValidationError as error:
            remaining = error
    return Draft(document, Sweep(version=1, scene="?"), scene, {})


def _prune_errors(
    data: dict[str, object], error: ValidationError, depth: int
) -> tuple[dict[str, object], dict[str, list[int]]]:
    bad = {file_path(detail["loc"])[:depth] for detail in error.errors(include_url=False)}
    pruned_data: dict[str, object] = {}
    positions: dict[str, list[int]] = {}
    for key, value in data.items():
        if (key,) in bad:
            continue
        pruned_data[key] = value
        if isinstance(value, dict):
            inner = cast("dict[str, object]", value)
            pruned_data[key] = {
                name: part for name, part in inner.items() if (key, name) not in bad
            }
        elif isinstance(value, list) and depth == 2:
            items = cast("list[object]", value)
            positions[key] = [index for index in range(len(items)) if (key, index) not in bad]
            pruned_data[key] = [items[index] for index in positions[key]]
    return pruned_data, positions
