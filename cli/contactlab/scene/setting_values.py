"""Values of settings: parsed from what a sweep file says, and read as numbers, vectors, words.

Each parser says what to write instead.
"""

import math
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress

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
_INT_MAX = 2**31 - 1


def number(
    least: float = -math.inf,
    above: float = -math.inf,
    most: float = math.inf,
    known: Collection[float] = (),
) -> Callable[[object], float]:
    """Return a parser of finite numbers, known ones or within bounds; `above` is exclusive."""

    def parse(value: object) -> float:
        if isinstance(value, str):
            with suppress(ValueError):
                value = float(value)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ValueError(f"write a number, not {value!r}")
        if not math.isfinite(value):
            raise ValueError(f"write a finite number, not {value!r}")
        if not (least <= value <= most and value > above):
            raise ValueError(f"write a number {_range(least, above, most)}, not {value!r}")
        if known and value not in known:
            near = min(known, key=lambda candidate: abs(candidate - value))
            raise ValueError(f"there is no {value:g}; the nearest is {near:g}")
        return float(value)

    return parse


def or_off(off: float, parse: Parser) -> Parser:
    """Return a parser that reads `false` as the value that turns an effect off."""
    return lambda value: off if value is False else parse(value)


def integer(least: int, most: int = _INT_MAX) -> Callable[[object], int]:
    """Return a parser of whole numbers within bounds, by default those of a 32-bit int."""
    inner = number(least=least, most=most)

    def parse(value: object) -> int:
        parsed = inner(value)
        if parsed != int(parsed):
            raise ValueError(f"write a whole number, not {value!r}")
        return int(parsed)

    return parse


def numbers(count: int, names: str, check: Callable[[tuple[float, ...]], str | None]) -> Parser:
    """Return a parser of a fixed count of numbers, as a list or as in MJCF: "0.02 1".

    Messages give their names; the check returns what is wrong with them, or None.
    """
    one = number()

    def parse(value: object) -> tuple[float, ...]:
        parts = value.split() if isinstance(value, str) else value
        if not isinstance(parts, Sequence) or isinstance(parts, str) or len(parts) != count:
            raise ValueError(f"write {count} numbers ({names}), not {value!r}")
        parsed = tuple(one(part) for part in parts)
        if wrong := check(parsed):
            raise ValueError(wrong)
        return parsed

    return parse


def choice(words: Sequence[str]) -> Callable[[object], str]:
    """Return a parser of one of a few words, ignoring case."""
    canonical = {word.lower(): word for word in words}

    def parse(value: object) -> str:
        if not isinstance(value, str) or value.lower() not in canonical:
            raise ValueError(f"write one of {', '.join(words)}, not {value!r}")
        return canonical[value.lower()]

    return parse


def switch(value: object) -> bool:
    """Parse true or false; also on and off, which YAML 1.2 leaves as words."""
    words = {"on": True, "true": True, "off": False, "false": False}
    if isinstance(value, str) and value.lower() in words:
        return words[value.lower()]
    if not isinstance(value, bool):
        raise ValueError(f"write true or false, not {value!r}")
    return value


def _range(least: float, above: float, most: float) -> str:
    parts = [f"of at least {least:g}"] if math.isfinite(least) else []
    parts += [f"above {above:g}"] if math.isfinite(above) else []
    parts += [f"of at most {most:g}"] if math.isfinite(most) else []
    return " and ".join(parts)
