"""Which effects a sweep or a scene asks for."""

from collections.abc import Mapping
from typing import Annotated, Literal, cast

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema
from pydantic_core import PydanticCustomError

Rest = Literal["auto", "all"]
_BASE = "base"
_RESTS = ("auto", "all")


def _spelled_out(value: object) -> object:
    return {_BASE: value} if isinstance(value, str) else value


def _checked(value: dict[str, bool | Rest]) -> dict[str, bool | Rest]:
    for name, each in value.items():
        if (name == _BASE) == isinstance(each, bool):
            wanted = "auto or all" if name == _BASE else "true or false"
            raise PydanticCustomError(
                "effects", "'{name}' takes {wanted}", {"name": name, "wanted": wanted}
            )
    return value


_WORDS = {
    "type": "string",
    "enum": list(_RESTS),
    "description": "auto: leave out what provably changes nothing; all: leave out nothing",
}
# `auto` and `all` alone are short for {base: auto} and {base: all}.
Effects = Annotated[
    dict[str, Annotated[bool, Field(strict=True)] | Rest],
    BeforeValidator(_spelled_out),
    AfterValidator(_checked),
    WithJsonSchema(
        {
            "anyOf": [
                _WORDS,
                {
                    "type": "object",
                    "properties": {_BASE: _WORDS},
                    "additionalProperties": {
                        "type": "boolean",
                        "description": "whether an effect is on",
                    },
                },
            ]
        }
    ),
]


def switches(effects: Mapping[str, bool | Rest]) -> dict[str, bool]:
    """Return the effects that are switched by name."""
    return {name: bool(value) for name, value in effects.items() if name != _BASE}


def rest(effects: Mapping[str, bool | Rest]) -> Rest | None:
    """Return what holds for all other effects; None where nothing is said."""
    return cast("Rest | None", effects.get(_BASE))
