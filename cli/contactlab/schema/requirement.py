"""Requirements of a run, in words: `still(box, 1 mm)`, `held(mug, by: hand, from: 0.5 s)`.

A requirement is a word with arguments in parentheses: the names that it is about, then a tolerance,
then `from:` and `until:`, the time in which it has to hold.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Literal, cast

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from contactlab.errors import did_you_mean
from contactlab.schema.setting_values import read_quantity
from contactlab.schema.strict_model import Word, listed

RequirementWord = Literal["held", "still", "upright", "passes", "slides", "stays"]
_KEYS = ("by", "from", "until")


@dataclass(frozen=True)
class _Form:
    """Grammar of one word: the number of names that it takes, and its tolerance."""

    example: str
    names: int = 1
    unit: str = ""  # of its tolerance in SI; empty without one
    default: float = math.nan  # tolerance [m or rad]
    others: tuple[str, ...] = ()  # further units that the tolerance may have
    has_holder: bool = False


_FORMS: Mapping[RequirementWord, _Form] = {
    "held": _Form("held(mug, by: hand)", unit="m", default=0.01, has_holder=True),
    "still": _Form("still(box, 1 mm)", unit="m", default=1e-3, others=("rad",)),
    "upright": _Form("upright(torso, 30deg)", unit="rad", default=math.pi / 6),
    "passes": _Form("passes(peg, hole, 5 mm)", names=2, unit="m", default=0.01),
    "slides": _Form("slides(box, from: 0.1 s)"),
    "stays": _Form("stays(box, 10 mm)", unit="m", default=0.01),
}


@dataclass(frozen=True)
class Requirement:
    """One requirement, read."""

    text: str  # as written
    word: RequirementWord
    names: tuple[str, ...]  # what it is about: a body, of `passes` also where that has to pass
    holder: str | None  # the body that holds it
    limit: float  # tolerance [m or rad]; not a number where there is none
    unit: str  # `m` or `rad`; empty without a tolerance
    start: float  # from when [s]
    stop: float  # until when [s]; infinite for the end of the run


@lru_cache(maxsize=256)
def read_requirement(text: str) -> Requirement:
    """Read a requirement; a ValueError says what is wrong, and how it is written."""
    head, opened, rest = text.strip().partition("(")
    word = head.strip()
    if word not in _FORMS:
        forms = ", ".join(form.example for form in _FORMS.values())
        hint = did_you_mean(word, _FORMS) or f"; write one of {forms}"
        raise ValueError(f"no requirement '{word}'{hint}")
    known = cast("RequirementWord", word)
    form = _FORMS[known]
    if not opened or not rest.endswith(")"):
        raise ValueError(f"'{text}' is not whole; write {form.example}")
    plain: list[str] = []
    keyed: dict[str, str] = {}
    for argument in (part.strip() for part in rest[:-1].split(",")):
        key, colon, value = argument.partition(":")
        if colon and key.strip() in _KEYS:
            keyed[key.strip()] = value.strip()
        else:
            plain.append(argument)
    names, amounts = tuple(plain[: form.names]), plain[form.names :]
    if not all(names) or len(names) < form.names or len(amounts) > bool(form.unit):
        raise ValueError(f"'{text}': '{word}' is written {form.example}")
    if form.has_holder != ("by" in keyed):
        missing = "needs" if form.has_holder else "takes no"
        raise ValueError(f"'{text}': '{word}' {missing} `by:`; write {form.example}")
    limit, unit = _tolerance(text, amounts[0], form) if amounts else (form.default, form.unit)
    start, stop = _time(text, keyed, "from", 0.0), _time(text, keyed, "until", math.inf)
    if not start < stop:
        raise ValueError(f"'{text}': `until` is not after `from`")
    return Requirement(text.strip(), known, names, keyed.get("by"), limit, unit, start, stop)


def _tolerance(text: str, amount: str, form: _Form) -> tuple[float, str]:
    number, unit = read_quantity(amount)
    if not 0 < number < math.inf or unit not in (form.unit, *form.others):
        raise ValueError(f"'{text}': '{amount}' is no tolerance here; write {form.example}")
    return number, unit


def _time(text: str, keyed: Mapping[str, str], key: str, default: float) -> float:
    if key not in keyed:
        return default
    number, unit = read_quantity(keyed[key])
    if not 0 <= number < math.inf or unit not in ("", "s"):
        raise ValueError(f"'{text}': `{key}: {keyed[key]}` is no time; write {key}: 0.5 s")
    return number


def _checked(text: str) -> str:
    try:
        return read_requirement(text).text
    except ValueError as error:
        raise PydanticCustomError("requirement", "{why}", {"why": str(error)}) from error


_WRITTEN = rf"^\s*({'|'.join(_FORMS)})\s*\(.+\)\s*$"
_Text = Annotated[Word, AfterValidator(_checked), Field(json_schema_extra={"pattern": _WRITTEN})]
_Texts = tuple[_Text, ...]
Requirements = Annotated[_Texts, BeforeValidator(listed, json_schema_input_type=_Text | _Texts)]
"""Requirements as written, checked; one alone needs no list."""
