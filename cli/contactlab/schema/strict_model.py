"""The base of all models of files: closed, frozen, strict about numbers and words."""

import math
import re
import sys
from collections.abc import Sequence
from typing import Annotated, Any, cast, dataclass_transform

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    WithJsonSchema,
)
from pydantic_core import PydanticCustomError

from contactlab.schema.setting_values import MEASURED_TEXT, parse_decimal, without_unit

_PERCENT = r"[0-9]*\.?[0-9]+([eE][-+]?[0-9]+)?%"
_BRACKET = re.compile(r"[\[\]{}]")
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]


def finite_or_none(number: float | None) -> float | None:
    """Return a number, or None for NaN and infinity, which JSON lacks."""
    return None if number is None or not math.isfinite(number) else float(number)


def _null_unless_finite(value: object) -> object:
    return finite_or_none(value) if isinstance(value, float) else value


FiniteOrNull = Annotated[float | None, BeforeValidator(_null_unless_finite)]
"""A measured number of a report: NaN and infinity become null here, and nowhere else."""


def _infinite_if_null(value: object) -> object:
    return math.inf if value is None else value


InfiniteAsNull = Annotated[
    float,
    Field(allow_inf_nan=True),
    BeforeValidator(_infinite_if_null),
    PlainSerializer(finite_or_none, return_type=float | None),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "null"}]}),
]
"""A measured number that may be infinite, which JSON writes as null."""
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
MEASURED = {"type": ["number", "string"], "pattern": f"^({MEASURED_TEXT.pattern}|{_PERCENT})$"}
"""JSON schema of a number, or of a text with a unit."""


def measured_in(unit: str) -> BeforeValidator:
    """Return a reader of texts such as `8 ms` as numbers in a unit; other values are unchanged."""

    def read_number(value: object) -> object:
        return value if (number := without_unit(value, unit)) is None else number

    return BeforeValidator(read_number)


_MOST_SECONDS = 1e9  # 31 years, which every clock and timer of a system can count
Seconds = Annotated[
    Positive,
    Field(le=_MOST_SECONDS),
    measured_in("s"),
    WithJsonSchema({**MEASURED, "exclusiveMinimum": 0, "maximum": _MOST_SECONDS}),
]
"""A time [s]: a number, or a text such as `2s`, `500ms`."""
Hertz = Annotated[
    Positive,
    measured_in("Hz"),
    WithJsonSchema({**MEASURED, "exclusiveMinimum": 0}),
]
"""A frequency [Hz]: a number, or a text such as `250 Hz`."""
Whole = Annotated[int, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]
Word = Annotated[str, Field(strict=True, min_length=1)]
Term = Number | Word
"""A number, or an expression over the scene's initial values."""
Hash = Annotated[str, Field(pattern=r"^[0-9a-f]{1,64}$")]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


def is_inner_name(name: str) -> bool:
    """Return whether a relative name with slashes stays below the folder that it starts in."""
    return "\0" not in name and not {"", ".", ".."} & set(name.split("/"))


def _inner_name(name: str) -> str:
    if not is_inner_name(name):
        raise PydanticCustomError("inner_name", "must be a relative path without '..'")
    return name


InnerName = Annotated[str, AfterValidator(_inner_name)]


def check_extent(text: str) -> None:
    """Raise ValueError if a YAML text is larger, or its brackets deeper, than any that is meant.

    Parsers take a time that grows with the square of the depth.
    """
    most_text, most_depth = 64 << 20, 100
    if len(text) > most_text:
        raise ValueError(f"it has more than {most_text:,} characters")
    depth = 0
    for bracket in _BRACKET.finditer(text):
        depth += 1 if bracket[0] in "[{" else -min(depth, 1)
        if depth > most_depth:
            raise ValueError("nested too deeply")


def about(description: str, *, unit: str = "", better: str = "", **rules: Any) -> Any:  # noqa: ANN401 - of the field's own type
    """Return a field with a description; `default` and other rules are those of pydantic.

    The unit is that of its number, `1` for counts and ratios; `better` is lower, higher or none
    for a measured value. JSON schema, table and documentation state both.
    """
    facts = {name: text for name, text in (("unit", unit), ("better", better)) if text}
    if facts:
        rules["json_schema_extra"] = facts
    return Field(description=description, **rules)


@dataclass_transform(kw_only_default=True, field_specifiers=(about, Field))
class _Described(type(BaseModel)):
    """Lets type checkers see that a field which is described may yet have no default."""


class Model(BaseModel, metaclass=_Described):
    """A mapping with known keys only, immutable once read."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


def _checked_number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise PydanticCustomError("number", "takes numbers only in a list")
    # isfinite would raise an error for a whole number that no float can hold.
    if not abs(value) <= sys.float_info.max:
        raise PydanticCustomError("finite_number", "must be finite")
    return value


def _checked_value(value: object) -> object:
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int | float):
        return _checked_number(value)
    if isinstance(value, list | tuple):
        return tuple(_checked_number(part) for part in cast("Sequence[object]", value))
    raise PydanticCustomError("value", "takes numbers, words, true, false or lists of numbers")


# A value of an axis as written, before its own parser makes it canonical.
Value = Annotated[
    object,
    AfterValidator(_checked_value),
    WithJsonSchema(
        {
            "type": ["number", "string", "boolean", "array"],
            "items": {"type": "number"},
            "description": "a number, a word, true or false, or a list of numbers such as a pair",
        }
    ),
]


def _read_fraction(value: object) -> object:
    if not isinstance(value, str):
        return value
    try:
        return parse_decimal(value.removesuffix("%")) / 100 if value.endswith("%") else value
    except ValueError:
        return value


# A bound in the metric's own unit; `1%` is another way to write 0.01.
_Percent = Annotated[str, Field(pattern=f"^{_PERCENT}$")]
Tolerance = Annotated[
    float,
    Field(strict=True, allow_inf_nan=False, ge=0),
    BeforeValidator(
        _read_fraction, json_schema_input_type=Annotated[float, Field(ge=0)] | _Percent
    ),
]


def list_word(value: object) -> object:
    """Return a word as a list of one."""
    return (value,) if isinstance(value, str) else value


_Several = Annotated[tuple[Word, ...], Field(min_length=1)]
Words = Annotated[_Several, BeforeValidator(list_word, json_schema_input_type=Word | _Several)]
