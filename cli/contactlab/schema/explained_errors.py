"""Validation errors of files in the words of contactlab, with their lines."""

import re
from collections.abc import Iterator, Mapping
from typing import Any, cast

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from contactlab.errors import did_you_mean
from contactlab.schema.requirement import said_now

_KINDS: Mapping[str, str] = {
    **dict.fromkeys(("tuple_type", "list_type"), "a list, [VALUE, VALUE]"),
    **dict.fromkeys(
        ("dict_type", "model_type", "model_attributes_type", "mapping_type"),
        "a mapping, {NAME: VALUE}",
    ),
    **dict.fromkeys(("float_type", "float_parsing"), "a number"),
    **dict.fromkeys(("int_type", "int_parsing"), "a whole number"),
    "bool_type": "true or false",
    "string_type": "a word",
}
_FOREIGN = re.compile("^(Value error, |Input should be (a valid )?)")


def explain_error(detail: ErrorDetails, model: type[BaseModel]) -> str:
    """Return the message of a validation error, or the requirement that replaces its key."""
    name, kind = str(detail["loc"][-1]) if detail["loc"] else "", detail["type"]
    if kind == "extra_forbidden":
        return said_now(detail["loc"], detail["input"]) or (
            f"unknown key{did_you_mean(name, _list_keys(model.model_json_schema()))}"
        )
    if kind == "missing":
        return "it is missing"
    if kind in _KINDS:
        return f"write {_KINDS[kind]}, not {detail['input']!r}"
    message, count = _FOREIGN.subn("", detail["msg"])
    # A constraint, as in `greater than 0`, or a text of our own.
    return f"must be {message}" if count and detail["msg"].startswith("Input") else message


def _list_keys(schema: Mapping[str, Any]) -> Iterator[str]:
    for part in (schema, *schema.get("$defs", {}).values()):
        yield from part.get("properties", ())


def explain_file_errors(error: ValidationError, model: type[BaseModel], text: str) -> list[str]:
    """Return each error of a YAML file as `line 3: pairs.0: write a mapping, ...`."""
    lines = list[str]()
    for detail in error.errors():
        # Parts with @ distinguish forms of a value; they are not keys.
        place = [part for part in detail["loc"] if "@" not in str(part)]
        where = ".".join(map(str, place))
        number = _line_of(text, place)
        lines.append(f"line {number}: {where}: {explain_error(detail, model)}")
    return lines


def _line_of(text: str, place: list[str | int]) -> int:
    from ruamel.yaml import YAML  # noqa: PLC0415 - only files with mistakes need it
    from ruamel.yaml.nodes import MappingNode, Node, SequenceNode  # noqa: PLC0415 - as above

    node = cast("Node", YAML(pure=True).compose(text))
    line = node.start_mark.line
    for part in place:
        if isinstance(node, MappingNode):
            pairs = [pair for pair in node.value if pair[0].value == str(part)]
            if not pairs:
                break
            line, node = pairs[0][0].start_mark.line, pairs[0][1]
        elif isinstance(node, SequenceNode) and isinstance(part, int):
            node = node.value[part]
            line = node.start_mark.line
        else:
            break
    return line + 1
