"""Requirements of a run, in words: `still(box, 1 mm)`, `slides(floor-box, until: 0.5 s)`.

A requirement is a word with arguments in parentheses: its names, then an amount, then `from:` and
`until:`, the limits of its time.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, cast

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from contactlab.contact.required_words import ContactWord, End, MotionWord
from contactlab.errors import did_you_mean
from contactlab.expression import Expression, ExpressionError
from contactlab.schema.setting_values import read_quantity
from contactlab.schema.strict_model import Term, Word, list_word

RequirementWord = MotionWord | ContactWord
_KEYS = ("by", "from", "until")
_ENDS: Mapping[str, End] = {"first": "first", "last": "last"}
# Commas within parentheses are those of a function in a time.
_COMMA = re.compile(r",(?![^(]*\))")


@dataclass(frozen=True)
class _Form:
    """Grammar of one word: the number of names that it takes, and its amount."""

    example: str
    names: int = 1
    unit: str = ""  # of its amount in SI; empty without one
    default: float = math.nan  # tolerance [m or rad]
    others: tuple[str, ...] = ()  # further units that the tolerance may have
    has_holder: bool = False
    is_range: bool = False  # whether the amount has two ends; one is enough
    may_end: bool = False  # whether `first` or `last` may stand for the amount


_MOTIONS: Mapping[MotionWord, _Form] = {
    "held": _Form("held(mug, by: hand)", unit="m", default=0.01, has_holder=True),
    "still": _Form("still(box, 1 mm)", unit="m", default=1e-3, others=("rad",)),
    "upright": _Form("upright(torso, 30deg)", unit="rad", default=math.pi / 6),
    "passes": _Form("passes(peg, hole, 5 mm)", names=2, unit="m", default=0.01),
    "stays": _Form("stays(box, 10 mm)", unit="m", default=0.01),
}
_CONTACTS: Mapping[ContactWord, _Form] = {
    "sticks": _Form("sticks(floor-box, last)", may_end=True),
    "slides": _Form("slides(box, first)", may_end=True),
    "rolls": _Form("rolls(ball)"),
    "apart": _Form("apart(finger-palm)"),
    "presses": _Form("presses(pad-box, 1..5 N)", unit="N", is_range=True),
    "shallow": _Form("shallow(floor-*, 1 mm)", unit="m", default=1e-3),
}
_FORMS: Mapping[str, _Form] = {**_MOTIONS, **_CONTACTS}


@dataclass(frozen=True)
class Requirement:
    """One requirement, read."""

    text: str  # as written
    word: RequirementWord
    names: tuple[str, ...]
    """Its subject: a body, and for `passes` also the hole. For contact a body or a pair, GEOM-GEOM
    or BODY-BODY, or a pattern of such names."""
    holder: str | None  # the body that holds it
    least: float  # least force [N]; -inf without one
    limit: float  # tolerance [m or rad], or greatest force [N]; not a number where there is none
    unit: str  # `m`, `rad` or `N`; empty without an amount
    end: End | None  # whether it is about the first or last mode of contact alone
    start: Term | None  # from when [s]: a number, or an expression over the scene's initial values
    stop: Term | None  # until when [s], likewise


@lru_cache(maxsize=256)
def read_requirement(text: str) -> Requirement:
    """Read a requirement; a ValueError describes the mistake and the form to write."""
    head, opened, rest = text.strip().partition("(")
    word = head.strip()
    if word not in _FORMS:
        forms = ", ".join(form.example for form in _FORMS.values())
        hint = did_you_mean(word, _FORMS) or f"; write one of {forms}"
        raise ValueError(f"no requirement '{word}'{hint}")
    form = _FORMS[word]
    if not opened or not rest.endswith(")"):
        raise ValueError(f"'{text}' is not whole; write {form.example}")
    # Arguments are plain or have a key, such as `until: 2s`.
    plain: list[str] = []
    keyed: dict[str, str] = {}
    for argument in (part.strip() for part in _COMMA.split(rest[:-1])):
        key, colon, value = argument.partition(":")
        if colon and key.strip() in _KEYS:
            keyed[key.strip()] = value.strip()
        else:
            plain.append(argument)
    names, amounts = tuple(plain[: form.names]), plain[form.names :]
    end = _ENDS.get(amounts[0]) if amounts and form.may_end else None
    most = bool(form.unit) or end is not None
    if not all(names) or len(names) < form.names or not form.is_range <= len(amounts) <= most:
        raise ValueError(f"'{text}': '{word}' is written {form.example}")
    if form.has_holder != ("by" in keyed):
        missing = "needs" if form.has_holder else "takes no"
        raise ValueError(f"'{text}': '{word}' {missing} `by:`; write {form.example}")
    least, limit, unit = -math.inf, form.default, form.unit
    if form.is_range:
        least, limit = _read_range(text, amounts[0], form)
    elif form.unit and amounts:
        amount = amounts[0]
        number, unit = read_quantity(amount)
        if not 0 < number < math.inf or unit not in (form.unit, *form.others):
            raise ValueError(f"'{text}': '{amount}' is not a tolerance here; write {form.example}")
        limit = number
    start, stop = _read_time(text, keyed, "from"), _read_time(text, keyed, "until")
    if isinstance(start, float) and isinstance(stop, float) and not start < stop:
        raise ValueError(f"'{text}': `until` is not after `from`")
    holder = keyed.get("by")
    return Requirement(
        text.strip(),
        cast("RequirementWord", word),
        names,
        holder,
        least,
        limit,
        unit,
        end,
        start,
        stop,
    )


def _read_range(text: str, amount: str, form: _Form) -> tuple[float, float]:
    """Read `1..5 N`, `1 N..` or `..5 N`."""
    ends = [part.strip() for part in amount.split("..")]
    # The unit of the second end is that of a first end without one.
    (low, own), (high, unit) = map(read_quantity, ends) if len(ends) == 2 else [(math.nan, "")] * 2
    least = -math.inf if ends[0] == "" else low
    most = math.inf if ends[-1] == "" else high
    units = {unit or own, own or unit} if all(ends) else {unit if ends[-1] else own}
    if units != {form.unit} or math.isnan(least) or math.isnan(most):
        example = f"write {form.example}, 1 {form.unit}.. or ..5 {form.unit}"
        raise ValueError(f"'{text}': '{amount}' is no range here; {example}")
    if least > most:
        raise ValueError(f"'{text}': '{amount}' has its least above its most")
    return least, most


def _read_time(text: str, keyed: Mapping[str, str], key: str) -> Term | None:
    if key not in keyed:
        return None
    value_text = keyed[key]
    number, unit = read_quantity(value_text)
    if 0 <= number < math.inf and unit in ("", "s"):
        return number
    mistake = f"'{text}': `{key}: {value_text}` is no time; write {key}: 0.5 s"
    if not math.isnan(number):
        raise ValueError(mistake)
    try:
        Expression(value_text)
    except ExpressionError as error:
        raise ValueError(mistake) from error
    return value_text


def _check_text(text: str) -> str:
    try:
        return read_requirement(text).text
    except ValueError as error:
        raise PydanticCustomError("requirement", "{why}", {"why": str(error)}) from error


_WRITTEN = rf"^\s*({'|'.join(_FORMS)})\s*\(.+\)\s*$"
_Text = Annotated[Word, AfterValidator(_check_text), Field(json_schema_extra={"pattern": _WRITTEN})]
_Texts = tuple[_Text, ...]
Requirements = Annotated[_Texts, BeforeValidator(list_word, json_schema_input_type=_Text | _Texts)]
"""Requirements as written, checked; one alone needs no list."""


_MODES = {"stick": "sticks", "slide": "slides", "rolls": "rolls", "apart": "apart"}


def said_now(path: Sequence[str | int], value: object) -> str | None:
    """Return the requirement in `must` that replaces an old key; None for other keys."""
    key, fields = path[-1], cast("dict[str, object]", value) if isinstance(value, dict) else {}
    if path == ("pairs",):
        words = [form.example for form in _CONTACTS.values()]
    elif path != ("modes",) and not (len(path) == 3 and path[0] in {"pairs", "expect"}):
        return None
    elif key in {"mode", "modes"}:
        subject = "*" if path[0] == "modes" else "X"
        ends = fields.items() if fields else [("", value)]
        words = [
            f"{_MODES.get(str(mode), mode)}({', '.join(filter(None, (subject, end)))})"
            for end, mode in ends
        ]
    elif key == "force":
        least, most = (fields.get(end, "") for end in ("min", "max"))
        words = [f"presses(X, {least}..{most} N)" if most != "" else f"presses(X, {least} N..)"]
    elif key == "depth":
        words = [f"shallow(X, {fields.get('max', '')} m)"]
    elif key in {"pair", "body"}:
        words = [f"WORD({value})"]
    elif key in {"from", "to"}:
        words = [f"WORD(X, {'from' if key == 'from' else 'until'}: {value})"]
    else:
        return None
    quoted_words = ", ".join(f'"{word}"' for word in words)
    return f"`{key}` is `must: [{quoted_words}]` now"
