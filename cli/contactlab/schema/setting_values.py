"""Values of settings and amounts in sweep files and options, with their units.

Each parser says what to write instead. A text such as `2ms`, `1 mm`, `5deg` or `10%` has a unit.
"""

import math
import re
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress

from contactlab.errors import check_digits

Settings = dict[str, object]
"""Every setting of a model or a run, by name, in the units of the parameters.

A value is a float, an int, a word or a tuple of floats.
"""


def as_number(value: object) -> float:
    """Return a setting's or an axis' value, which is a number, as a float."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is not a number")
    return float(value)


def as_vector(value: object) -> tuple[float, ...]:
    """Return a setting's or an axis' value, which is a tuple of floats."""
    if not isinstance(value, tuple):
        raise TypeError(f"{value!r} is not several numbers")
    return value


Parser = Callable[[object], object]


def number_parser(
    least: float = -math.inf,
    above: float = -math.inf,
    most: float = math.inf,
    allowed: Collection[float] = (),
) -> Callable[[object], float]:
    """Return a parser of finite numbers, known ones or within bounds; `above` is exclusive."""

    def parse(value: object) -> float:
        if isinstance(value, str):
            with suppress(ValueError):
                value = parse_decimal(value)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ValueError(f"write a number, not {value!r}")
        if not math.isfinite(value):
            raise ValueError(f"write a finite number, not {value!r}")
        if not (least <= value <= most and value > above):
            limits = {"of at least": least, "above": above, "of at most": most}
            bounds = [f"{side} {end:g}" for side, end in limits.items() if math.isfinite(end)]
            raise ValueError(f"write a number {' and '.join(bounds)}, not {value!r}")
        if allowed and value not in allowed:
            near = min(allowed, key=lambda candidate: abs(candidate - value))
            raise ValueError(f"there is no {value:g}; the nearest is {near:g}")
        return float(value)

    return parse


positive_number, nonnegative_number = number_parser(above=0), number_parser(least=0)
"""Parsers of numbers above 0, and of 0 or more."""


def or_off(off: float, parse: Parser) -> Parser:
    """Return a parser that reads `false` as the value that turns an effect off."""
    return lambda value: off if value is False else parse(value)


def integer_parser(least: int, most: int = 2**31 - 1) -> Callable[[object], int]:
    """Return a parser of whole numbers within bounds, by default those of a 32-bit int."""
    inner = number_parser(least=least, most=most)

    def parse(value: object) -> int:
        number = inner(value)
        if number != int(number):
            raise ValueError(f"write a whole number, not {value!r}")
        return int(number)

    return parse


def vector_parser(
    count: int, names: str, check: Callable[[tuple[float, ...]], str | None]
) -> Parser:
    """Return a parser of a fixed count of numbers, as a list or as in MJCF: "0.02 1".

    Messages give their names; the check returns the mistake in them, or None.
    """
    one = number_parser()

    def parse(value: object) -> tuple[float, ...]:
        parts = value.split() if isinstance(value, str) else value
        if not isinstance(parts, Sequence) or isinstance(parts, str) or len(parts) != count:
            raise ValueError(f"write {count} numbers ({names}), not {value!r}")
        vector = tuple(map(one, parts))
        if wrong := check(vector):
            raise ValueError(wrong)
        return vector

    return parse


def choice_parser(words: Sequence[str]) -> Callable[[object], str]:
    """Return a parser of one of a few words, ignoring case."""
    canonical = {word.lower(): word for word in words}

    def parse(value: object) -> str:
        if not isinstance(value, str) or value.lower() not in canonical:
            raise ValueError(f"write one of {', '.join(words)}, not {value!r}")
        return canonical[value.lower()]

    return parse


def parse_switch(value: object) -> bool:
    """Parse true or false; also on and off, which YAML 1.2 leaves as words."""
    words = {"on": True, "true": True, "off": False, "false": False}
    if isinstance(value, str) and value.lower() in words:
        return words[value.lower()]
    if not isinstance(value, bool):
        raise ValueError(f"write true or false, not {value!r}")
    return value


_KINDS = {
    "s": {"us": 1e-6, "µs": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0},
    "m": {"um": 1e-6, "µm": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0},
    "kg": {"g": 1e-3, "kg": 1.0},
    "rad": {"deg": math.pi / 180, "rad": 1.0},
    "m/s": {"mm/s": 1e-3, "cm/s": 1e-2, "m/s": 1.0},
    "rad/s": {"deg/s": math.pi / 180, "rad/s": 1.0},
    "N": {"mN": 1e-3, "N": 1.0, "kN": 1e3},
    "Hz": {"Hz": 1.0, "kHz": 1e3},
    "N/m": {"N/m": 1.0, "kN/m": 1e3, "N/mm": 1e3},
}
SI_UNITS = {unit: (kind, size) for kind, units in _KINDS.items() for unit, size in units.items()}
"""The SI unit that each unit measures the same as, and its size in it."""
MEASURED_TEXT = re.compile(rf"([-+]?\d*\.?\d+(?:e[-+]?\d+)?)\s*({'|'.join(SI_UNITS)})", re.ASCII)
"""A number with its unit."""


def parse_decimal(text: str) -> float:
    """Return the number of a text with the digits 0 to 9; Python would read others, too."""
    check_digits(text)
    return float(text)


def without_unit(value: object, unit: str = "") -> float | None:
    """Return the number that a text such as `2ms` means, in a unit or in SI.

    It is None for other texts, and for other quantities.
    """
    number, own = split_unit(value)
    kind, size = SI_UNITS.get(own, ("", 1.0))
    wanted_kind, scale = SI_UNITS.get(unit, ("", 1.0)) if unit else (kind, 1.0)
    return float(f"{number * size / scale:.12g}") if own and kind == wanted_kind else None


def split_unit(value: object) -> tuple[float, str]:
    """Return number and unit of a text such as `2ms`; not a number, and no unit, of others."""
    parts = MEASURED_TEXT.fullmatch(value.strip()) if isinstance(value, str) else None
    return (float(parts[1]), parts[2]) if parts else (math.nan, "")


def read_quantity(text: str) -> tuple[float, str]:
    """Return a number in SI, and its unit there: `2ms` is 0.002 and s; a share has no unit.

    It is NaN for other texts.
    """
    value = text.strip()
    try:
        if value.endswith("%"):
            return parse_decimal(value[:-1]) / 100, ""
        return parse_decimal(value), ""
    except ValueError:
        number, unit = split_unit(value)
        kind, size = SI_UNITS.get(unit, ("", math.nan))
        return float(f"{number * size:.12g}"), kind
